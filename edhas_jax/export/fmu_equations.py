"""The machine of an FMU: its variables, and its start, step and signals as programs of scalars."""

import enum
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp

from edhas_jax.compiler.c_source import C_LIBRARY
from edhas_jax.compiler.jaxpr_to_ir import Untranslatable, trace_to_ir
from edhas_jax.compiler.scalar_ir import Dependence, Program
from edhas_jax.config.run_settings import SIMULATION_SETTINGS
from edhas_jax.core import structs
from edhas_jax.export.fmu_inputs import FmuError, Outside, inputs_of, mount, read_inputs, replaced_signals
from edhas_jax.machine.components.controllers import OpenLoop
from edhas_jax.machine.components.set_points import Recorded, RecordedInterval
from edhas_jax.machine.interface.signals import SIGNALS, Signal
from edhas_jax.machine.parameters import find_parameter, list_parameters, replace_value, short_names
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.integrator import evaluate_signals, step
from edhas_jax.simulation.time_loop import check_names, failed_checks

STEP = "step"  # the name of the variable that holds the largest step


class Causality(enum.Enum):
    """What a variable is to the tool that runs the unit."""

    PARAMETER = "parameter"
    INPUT = "input"
    OUTPUT = "output"


class Variable(NamedTuple):
    """A variable of the unit, in SI; `start` is None for an output, `span` where any finite number is allowed."""

    name: str
    unit: str
    shown: str
    doc: str
    causality: Causality
    start: float | None = None
    span: tuple[float, float] | None = None


class Source(NamedTuple):
    """Where an input of a program comes from.

    `table` is "values" or "y" for the value or state `name`, "curve SECTION" for a field of a recorded set point's
    `RecordedInterval`, or "t", "h" and "since" for the time, the step and the time of the last inputs [s].
    """

    table: str
    name: str = ""


class UnitProgram(NamedTuple):
    """A machine as an FMU computes it.

    `values` are parameters and inputs, `outputs` signals. `start` gives the states from the values, `step` the states
    after a step and the number of the first of `checks` that fails (−1: none), `see` the outputs. `sources` says where
    the inputs of all three come from; `recorded` are the set points that are looked up, by section. `influence` names
    for each output the inputs that act on it at once.
    """

    values: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    states: tuple[str, ...]
    checks: tuple[str, ...]
    start: Program
    step: Program
    see: Program
    sources: tuple[Source, ...]
    recorded: dict[str, Recorded]
    influence: dict[str, tuple[str, ...]]


def unit_program(machine: Rig, inputs: Sequence[str], largest_step: float) -> UnitProgram:
    """The program of `machine` with `inputs` from outside (see `fmu_inputs`), in steps of at most `largest_step` [s].

    Raises:
        FmuError: an input does not exist or has no effect; the machine uses an operation that has no counterpart in C.
    """
    outside, held = read_inputs(machine, inputs)
    candidates, places = _candidates(machine, outside, held)
    span = SIMULATION_SETTINGS[STEP].span
    candidates.append(Variable(STEP, "s", "", "largest internal time step", Causality.PARAMETER, largest_step, span))
    replaced = replaced_signals(outside)
    set_points = {n: getattr(machine, n, None) for n in ("reference", "target") if n not in replaced}
    recorded = {n: r for n, r in set_points.items() if isinstance(r, Recorded)}

    def made(values, curves, since):
        m = machine
        for section, stretch in curves.items():
            m = structs.replace(m, **{section: stretch})
        for name, (path, own) in places.items():
            m = replace_value(m, path, own, values[name])
        return mount(m, outside, values, since)

    example = {v.name: v.start for v in candidates}
    still = {n: RecordedInterval(**dict.fromkeys(_STRETCH, 1.0)) for n in recorded}
    at_rest = made(example, still, 0.0)
    states = tuple(sorted(at_rest.initial_state()))
    seen = jax.eval_shape(lambda y: evaluate_signals(at_rest, y, 0.0, 1.0), {n: jnp.zeros(()) for n in states})
    hidden = {"time", *(v.name for v in candidates), *replaced}
    outputs = [n for n in SIGNALS if n in seen and n not in hidden]

    def start(a):
        y = made(a["values"], a["curves"], a["since"]).initial_state()
        return [jnp.zeros(()) + y[n] for n in states]

    def go(a):
        m, t, h = made(a["values"], a["curves"], a["since"]), a["t"], a["h"]
        y = step(m, a["y"], t, h)[0]
        return [*(y[n] for n in states), _first(failed_checks(m, y, t + h, h))]

    def see(a):
        row = evaluate_signals(made(a["values"], a["curves"], a["since"]), a["y"], a["t"], a["h"])
        return [row[n] for n in outputs]

    sources = {
        "values": {n: Source("values", n) for n in example},
        "curves": {n: RecordedInterval(**{f: Source(f"curve {n}", f) for f in _STRETCH}) for n in recorded},
        "y": {n: Source("y", n) for n in states},
        **{n: Source(n) for n in ("t", "h", "since")},
    }
    is_source = {"is_leaf": lambda x: isinstance(x, Source)}
    levels = jax.tree.map(_level, sources, **is_source)
    try:
        programs = [trace_to_ir(f, jnp.float64, levels, functions=C_LIBRARY)[0] for f in (start, go, see)]
    except Untranslatable as error:
        rule = "scalars, jnp.where and elementary functions are what C has"
        raise FmuError(f"{_culprit(machine)} cannot be written in C: {error}; {rule}") from None
    leaves = tuple(jax.tree.leaves(sources, **is_source))
    acting = {leaves[i].name for p in programs for i in _inputs(p, p.outputs.values()) if leaves[i].table == "values"}
    for v in candidates:
        if v.causality is Causality.INPUT and v.name not in acting and v.name in places:
            raise FmuError(f"--input {v.name}: nothing in this machine depends on it")
    values = tuple(v for v in candidates if v.name in acting or v.name == STEP or v.causality is Causality.INPUT)
    by_input = {v.name for v in values if v.causality is Causality.INPUT}
    influence = {
        name: tuple(sorted(by_input & {leaves[i].name for i in _inputs(programs[2], [programs[2].outputs[k]])}))
        for k, name in enumerate(outputs)
    }
    signals = tuple(Variable(n, *_signal(machine, n), Causality.OUTPUT) for n in outputs)
    return UnitProgram(values, signals, states, check_names(at_rest), *programs, leaves, recorded, influence)


_STRETCH = tuple(RecordedInterval.__dataclass_fields__)


def _candidates(
    machine: Rig, outside: Sequence[Outside], held: Sequence[str]
) -> tuple[list[Variable], dict[str, tuple[str, str]]]:
    """Every parameter and every input from outside; and the part and the name of each parameter.

    A parameter is called as in a configuration, but `part.name` where something else has that name too.
    """
    rows = list_parameters(machine)
    inputs = {(path, p.name) for p, path in (find_parameter(machine, name) for name in held)}
    given = [Variable(i.name, i.unit, "", i.doc, Causality.INPUT, 0.0) for i in inputs_of(machine, outside)]
    others = {*SIGNALS, STEP, *(v.name for v in given)}
    names = short_names(machine)
    variables, places = [], {}
    for p, value, path in rows:
        is_input = (path, p.name) in inputs
        name = f"{path}.{p.name}" if p.name in others else names[path, p.name]
        kind = Causality.INPUT if is_input else Causality.PARAMETER
        variables.append(Variable(name, p.unit, "", p.doc, kind, float(value), p.span))
        places[name] = path, p.name
    return variables + given, places


def _culprit(machine: Rig) -> str:
    """What of a machine cannot be read: the first effect that cannot by itself, else the controller."""
    for effect in machine.effects:
        alone = structs.replace(machine, effects=(effect,))
        try:
            carry = dict.fromkeys(alone.initial_state(), Dependence.CARRY)
            trace_to_ir(lambda y, m=alone: step(m, y, 0.0, 1.0)[0], jnp.float64, carry)
        except Untranslatable:
            return f"the effect {effect.id}"
    return f"the controller {type(machine.controller).__name__}"


def _level(source: Source) -> Dependence:
    return Dependence.INVARIANT if source.table in ("values", "h") else Dependence.CARRY


def _first(failed: list):
    """The number of the first that is true, or −1."""
    out = -jnp.ones(())
    for k in reversed(range(len(failed))):
        out = jnp.where(failed[k], float(k), out)
    return out


def _inputs(program: Program, roots) -> set[int]:
    """The inputs that the nodes `roots` are computed from."""
    seen, stack = set(), list(roots)
    while stack:
        i = stack.pop()
        if i not in seen:
            seen.add(i)
            stack += program.operands(i)
    return {program.nodes[i][1] for i in seen if program.nodes[i][0] == "input"}


def _signal(machine: Rig, name: str) -> Signal:
    """A signal; without a controller the reference is the command."""
    if isinstance(machine.controller, OpenLoop) and name in ("reference", "reference_velocity"):
        unit = SIGNALS[name].unit.replace("m", "V")
        return Signal(unit, unit, SIGNALS[name].doc.replace("set point of the piston", "command"))
    return SIGNALS[name]
