"""Operations of a step: without derivatives, and with tangents by `jax.jvp` and by the shared linearisation.

    python benchmarks/operations.py

Counted in the package's translation of the step of the pump bench with its metrics, after simplification: what depends
on the state, without constants and inputs. The last line sums up as key=value.
"""

import argparse

import jax
import numpy as np

from edhas_jax.compiler.jaxpr_to_ir import trace_to_ir
from edhas_jax.compiler.multi_jvp import multi_jvp
from edhas_jax.compiler.scalar_ir import Dependence
from edhas_jax.core import runtime
from edhas_jax.design.batch.cycle_metrics import cycle_step, empty_sums
from edhas_jax.machine.effects import EntrainedAir, LugreFriction, PistonLeakage
from edhas_jax.machine.parameters import get_parameter, set_parameters
from edhas_jax.machine.rigs import PumpBench

NAMES = ("piston_diameter", "piston_clearance", "valve_spring_rate", "valve_mass", "valve_seat_diameter",
         "valve_preload", "frequency", "amplitude")  # fmt: skip
LEAVES = ("input", "const", "bool")


def main() -> None:
    """Print the table; the last line sums it up."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    machine = PumpBench(effects=(LugreFriction(), PistonLeakage(), EntrainedAir()))
    values = {n: float(get_parameter(machine, n)) for n in NAMES}
    sums = {n: np.asarray(v, float) for n, v in empty_sums(machine, float).items()}
    state = dict.fromkeys(machine.initial_state(), 0.0), dict.fromkeys(sums, 0.0)

    def step(values, state, n=0.0, steps=1000.0):
        return cycle_step(set_parameters(machine, values), *state, n, steps, False)

    def directions(count, tangents):
        return [({n: float(n == name) for n in values}, t) for name, t in zip(NAMES[:count], tangents, strict=True)]

    def by_jvp(values, state, tangents):
        pushed = [jax.jvp(step, (values, state), seed) for seed in directions(len(tangents), tangents)]
        return [part for pair in pushed for part in pair]

    def shared(values, state, tangents):
        return multi_jvp(step, (values, state), directions(len(tangents), tangents))

    print("operations of a step of the pump bench")
    plain = count_operations(step, values, state)
    print(f"  {'without derivatives':<42}{plain:6d}")
    found = {}
    for title, f, counts in (("jax.jvp", by_jvp, (1, 2)), ("shared linearisation", shared, (1, 2, 4, 8))):
        for count in counts:
            found[title, count] = count_operations(f, values, state, [state] * count)
            print(f"  {f'{count} tangents, {title}':<42}{found[title, count]:6d}")
    print(f"plain={plain} jvp1={found['jax.jvp', 1]} jvp2={found['jax.jvp', 2]} "
          f"shared1={found['shared linearisation', 1]} shared8={found['shared linearisation', 8]}")  # fmt: skip


def count_operations(f, values, *carries) -> int:
    """Operations of the translation of `f` that depend on the carried state."""
    depends = [jax.tree.map(lambda _: Dependence.CARRY, carry) for carry in carries]
    with runtime.double_precision():
        program, _ = trace_to_ir(f, float, jax.tree.map(lambda _: Dependence.INVARIANT, values), *depends)
    needed, stack = set(), list(program.outputs.values())
    while stack:
        i = stack.pop()
        if i not in needed:
            needed.add(i)
            stack += () if program.nodes[i][0] in LEAVES else program.nodes[i][1:]
    carried = (i for i in needed if program.dependence[i] >= Dependence.CARRY)
    return sum(program.nodes[i][0] not in LEAVES for i in carried)


if __name__ == "__main__":
    main()
