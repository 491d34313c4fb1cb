"""Speed of rigs of one's own against the rigs of the package: design-steps per second, and operations per second.

    python benchmarks/own_rig.py [--designs N]

Both kinds pass through the same translation, so that a step takes as long as its operations: the rates of operations
are to be compared, the design-steps of rigs of like size. Each rig advances a batch on one core, in turn, and the best
of the rounds counts. The last line sums up as key=value: the rates of a rig over that of the actuator bench.
"""

import argparse
import sys
import time
from pathlib import Path

import jax
import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from benchmarks.operations import count_operations  # noqa: E402
from edhas_jax.compiler.engines import compile_loop  # noqa: E402
from edhas_jax.compiler.loop_engine import LoopBody  # noqa: E402
from edhas_jax.machine.effects import LugreFriction  # noqa: E402
from edhas_jax.machine.parameters import get_parameter, set_parameters, short_names  # noqa: E402
from edhas_jax.machine.rigs import ActuatorBench, PumpBench  # noqa: E402
from edhas_jax.simulation.integrator import step  # noqa: E402
from studies.emps.rig import LinearDrive  # noqa: E402
from studies.mbari.rig import PowerTakeOff  # noqa: E402
from studies.tanks.rig import TwoTanks  # noqa: E402

MACHINES = {
    "actuator_bench": ActuatorBench(effects=(LugreFriction(),)), "pump_bench": PumpBench(), "two_tanks": TwoTanks(),
    "linear_drive": LinearDrive(effects=(LugreFriction(),)), "power_take_off": PowerTakeOff(),
}  # fmt: skip
STEPS, ROUNDS, VARIED = 400, 5, 3
OF_THE_PACKAGE = "actuator_bench"


def main() -> None:
    """Print the table; the last line sums it up."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--designs", type=int, default=1024)
    designs = parser.parse_args().designs
    runs = {name: _runner(machine, designs) for name, machine in MACHINES.items()}
    seconds = dict.fromkeys(runs, np.inf)
    for _ in range(ROUNDS):
        for name, run in runs.items():
            start = time.perf_counter()
            run()
            seconds[name] = min(seconds[name], time.perf_counter() - start)
    print(f"one core, float64, {designs} designs, {VARIED} numbers varied")
    print(f"{'rig':<16}{'states':>8}{'operations':>12}{'M design-steps/s':>18}{'G operations/s':>16}")
    rates, work = {}, {}
    for name, machine in MACHINES.items():
        operations = count_operations(_step_of(machine), *_inputs(machine))
        rates[name] = designs * STEPS / seconds[name]
        work[name] = rates[name] * operations
        print(f"{name:<16}{len(machine.initial_state()):8d}{operations:12d}{rates[name] / 1e6:18.2f}"
              f"{work[name] / 1e9:16.2f}")  # fmt: skip
    print(" ".join(f"{name}={work[name] / work[OF_THE_PACKAGE]:.2f}" for name in MACHINES if name != OF_THE_PACKAGE))


def _inputs(machine) -> tuple[dict[str, float], dict[str, float]]:
    """The varied numbers and the state."""
    names = list(short_names(machine).values())[:VARIED]
    return dict.fromkeys(names, 0.0), {n: 0.0 for n in machine.initial_state()}


def _step_of(machine):
    def one(values, state):
        return step(set_parameters(machine, values), state, 0.0, _time_step(machine))[0]

    return one


def _runner(machine, designs: int):
    """A function that takes a batch through the steps."""
    values, state = _inputs(machine)

    def advance(n, carry, lane, uniform):
        base, h = uniform
        return step(set_parameters(base, lane), carry, n * h, h)[0]

    loop = compile_loop(LoopBody(advance, float, state, values, (machine, 0.0)))
    base = jax.tree.map(lambda leaf: np.asarray(leaf, float), machine)
    numbers = {n: np.full(designs, float(get_parameter(machine, n))) for n in values}
    begin = {n: np.full(designs, float(v)) for n, v in machine.initial_state().items()}

    def run():
        return loop(begin, numbers, (base, _time_step(machine)), 0, STEPS, 1)

    run()
    return run


def _time_step(machine) -> float:
    """The time step [s] that the rig states, or that of the package."""
    return machine.time_step


if __name__ == "__main__":
    main()
