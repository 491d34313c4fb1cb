"""The model inside an FMU: its variables, and its initial state, step and outputs as scalar programs."""

import enum
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from edhas_jax.compiler.c_source import C_LIBRARY
from edhas_jax.compiler.jaxpr_to_ir import Untranslatable, trace_to_ir
from edhas_jax.compiler.scalar_ir import Dependence, Program
from edhas_jax.config.run_settings import setting_span
from edhas_jax.core import runtime, structs
from edhas_jax.export.fmu_inputs import (
    ExternalSource,
    FmuError,
    connect_inputs,
    external_inputs,
    parse_inputs,
    rate_unit,
    replaced_signals,
)
from edhas_jax.machine.components.controllers import OpenLoop
from edhas_jax.machine.components.set_points import Recorded, RecordedInterval
from edhas_jax.machine.interface.signals import SIGNALS, Signal
from edhas_jax.machine.parameters import find_parameter, list_parameters, replace_value, short_names
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.integrator import evaluate_signals, rates, step
from edhas_jax.simulation.time_loop import check_names, failed_checks

STEP = "step"  # name of the variable that holds the largest internal step


class Causality(enum.Enum):
    """The role of a variable for the importing tool, by the words of FMI 2.0."""

    PARAMETER = "parameter"
    INPUT = "input"
    OUTPUT = "output"
    LOCAL = "local"


class Variable(NamedTuple):
    """A variable of the unit.

    Attributes:
        name: name in the model description.
        unit: SI unit.
        display_unit: unit in which tools show the quantity; empty: the SI unit.
        doc: meaning.
        causality: role of the variable.
        start: value before the first one is set; None for what is computed.
        span: smallest and largest allowed value; None where any finite number is allowed.
        derivative_of: the state whose derivative by time it is; empty: of none.
    """

    name: str
    unit: str
    display_unit: str
    doc: str
    causality: Causality
    start: float | None = None
    span: tuple[float, float] | None = None
    derivative_of: str = ""


class ProgramInput(NamedTuple):
    """Where an input of a program comes from.

    Attributes:
        table: "values" or "y" for the value or state `name`, "dvalues" or "dy" for its component of a direction;
            "recorded SECTION" for the field `name` of the
            `RecordedInterval` of a recorded set point; "t", "h" or "input_time" for the time, the step and the time of
            the last inputs [s].
        name: the name in the table.
    """

    table: str
    name: str = ""


class UnitProgram(NamedTuple):
    """The model of an FMU.

    Attributes:
        values: parameters and inputs.
        outputs: signals of the machine.
        locals: the states that are no signals, then the derivative of each state by time, in the order of `states`.
        states: names of the states.
        checks: names of the checks of the physical range.
        initial_state: program from the values to the states.
        step: program of one step to the new states and the number of the first check that fails, −1 if none.
        evaluate_outputs: program to the outputs and locals.
        initial_direction: program to the change of the initial states along a direction of the values.
        output_direction: program to the change of outputs and locals along a direction of values and states.
        sources: where each input of these programs comes from.
        recorded: recorded set points by section of the configuration; they are interpolated in a table.
        dependencies: for each output and derivative the inputs and states on which it depends without delay.
    """

    values: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    locals: tuple[Variable, ...]
    states: tuple[str, ...]
    checks: tuple[str, ...]
    initial_state: Program
    step: Program
    evaluate_outputs: Program
    initial_direction: Program
    output_direction: Program
    sources: tuple[ProgramInput, ...]
    recorded: dict[str, Recorded]
    dependencies: dict[str, tuple[str, ...]]


class _Arguments(NamedTuple):
    """The arguments of the traced functions; in `unit_program` also their sources, of the same structure."""

    recorded: dict[str, RecordedInterval]
    h: Any
    input_time: Any
    t: Any
    values: dict[str, Any]
    y: dict[str, Any]
    dvalues: dict[str, Any]
    dy: dict[str, Any]


_INTERVAL_FIELDS = tuple(n for n in RecordedInterval.__dataclass_fields__ if n != "steps")  # `value` has the level


def unit_program(machine: Rig, inputs: Sequence[str], largest_step: float) -> UnitProgram:
    """Trace a machine as the model of an FMU.

    Args:
        machine: the machine of the configuration.
        inputs: names of the external inputs, see `fmu_inputs.parse_inputs`.
        largest_step: default of the largest internal step [s].

    Returns:
        The model with its variables.

    Raises:
        FmuError: an input does not exist or has no effect; the machine uses an operation that has no counterpart in C.
    """
    external, parameter_inputs = parse_inputs(machine, inputs)
    candidates, parameter_paths = _settable_variables(machine, external, parameter_inputs)
    span = setting_span(STEP, type(machine))
    candidates.append(Variable(STEP, "s", "", "largest internal time step", Causality.PARAMETER, largest_step, span))
    replaced = replaced_signals(external)
    drives = (n for n in (*machine.drives, "reference", "target") if n not in replaced)
    set_points = {n: getattr(machine, n, None) for n in drives}
    recorded = {n: r for n, r in set_points.items() if isinstance(r, Recorded)}

    def machine_with(values, intervals, input_time) -> Rig:
        """The machine with these parameters and inputs, and each recorded set point at its present interval."""
        m = machine
        for section, interval in intervals.items():
            m = structs.replace(m, **{section: interval})
        for name, (path, parameter) in parameter_paths.items():
            m = replace_value(m, path, parameter, values[name])
        return connect_inputs(m, external, values, input_time)

    start_values = {v.name: v.start for v in candidates}
    unit_intervals = {n: RecordedInterval(**dict.fromkeys(_INTERVAL_FIELDS, 1.0)) for n in recorded}
    example = machine_with(start_values, unit_intervals, 0.0)
    states = tuple(sorted(example.initial_state()))
    signals = runtime.eval_shape(lambda y: evaluate_signals(example, y, 0.0, 1.0), {n: jnp.zeros(()) for n in states})
    hidden = {"time", *(v.name for v in candidates), *replaced}
    outputs = [n for n in machine.signals if n in signals and n not in hidden]
    local_variables = _local_variables(machine, states, outputs)

    def initial_state(a: _Arguments):
        y = machine_with(a.values, a.recorded, a.input_time).initial_state()
        return [jnp.zeros(()) + y[n] for n in states]

    def initial_direction(a: _Arguments):
        return jax.jvp(lambda values: initial_state(a._replace(values=values)), (a.values,), (a.dvalues,))[1]

    def one_step(a: _Arguments):
        m = machine_with(a.values, a.recorded, a.input_time)
        y = step(m, a.y, a.t, a.h)[0]
        return [*(y[n] for n in states), _first_true(failed_checks(m, y, a.t + a.h, a.h))]

    def evaluate_outputs(a: _Arguments):
        m = machine_with(a.values, a.recorded, a.input_time)
        row, derivatives = evaluate_signals(m, a.y, a.t, a.h), rates(m, a.y, a.t, a.h)[0]
        found = [row[n] for n in outputs]
        for v in local_variables:
            found.append(jnp.zeros(()) + (derivatives.get(v.derivative_of, 0.0) if v.derivative_of else a.y[v.name]))
        return found

    def output_direction(a: _Arguments):
        def along(values, y):
            return evaluate_outputs(a._replace(values=values, y=y))

        return jax.jvp(along, (a.values, a.y), (a.dvalues, a.dy))[1]

    sources = _Arguments(
        recorded={
            n: RecordedInterval(**{f: ProgramInput(f"recorded {n}", f) for f in _INTERVAL_FIELDS}) for n in recorded
        },
        **{n: ProgramInput(n) for n in ("h", "input_time", "t")},
        values={n: ProgramInput("values", n) for n in start_values},
        y={n: ProgramInput("y", n) for n in states},
        dvalues={n: ProgramInput("dvalues", n) for n in start_values},
        dy={n: ProgramInput("dy", n) for n in states},
    )
    is_source = {"is_leaf": lambda x: isinstance(x, ProgramInput)}
    dependences = jax.tree.map(_dependence, sources, **is_source)
    functions = initial_state, one_step, evaluate_outputs, initial_direction, output_direction
    try:
        programs = [trace_to_ir(f, jnp.float64, dependences, functions=C_LIBRARY)[0] for f in functions]
    except Untranslatable as error:
        rule = "only scalars, jnp.where and elementary functions have a counterpart"
        raise FmuError(f"{_untranslatable_part(machine)} cannot be written in C: {error}; {rule}") from None
    leaves = tuple(jax.tree.leaves(sources, **is_source))
    used = {leaves[i].name for p in programs for i in _inputs(p, p.outputs.values()) if leaves[i].table == "values"}
    for v in candidates:
        if v.causality is Causality.INPUT and v.name not in used and v.name in parameter_paths:
            raise FmuError(f"--input {v.name}: nothing in this machine depends on it")
    values = tuple(v for v in candidates if v.name in used or v.name == STEP or v.causality is Causality.INPUT)
    knowns = {*states, *(v.name for v in values if v.causality is Causality.INPUT)}
    output_variables = tuple(Variable(n, *_signal(machine, n), Causality.OUTPUT) for n in outputs)
    dependencies = {}
    for k, v in enumerate((*output_variables, *local_variables)):
        acting = {leaves[i].name for i in _inputs(programs[2], [programs[2].outputs[k]])}
        dependencies[v.name] = tuple(sorted(knowns & acting))
    return UnitProgram(
        values, output_variables, local_variables, states, check_names(example), *programs, leaves, recorded,
        dependencies,
    )  # fmt: skip


def _local_variables(machine: Rig, states: Sequence[str], outputs: Sequence[str]) -> tuple[Variable, ...]:
    """The states that are no outputs, and the derivative of each state."""
    effects = {f"{e.id}.{n}": (st.unit, st.doc) for e in machine.effects for n, st in e.states.items()}
    about = {n: effects.get(n, ("", n.replace("_", " "))) for n in states}
    about |= {n: machine.signals[n][:3:2] for n in states if n in machine.signals}
    found = [Variable(n, unit, "", doc, Causality.LOCAL) for n, (unit, doc) in about.items() if n not in outputs]
    for n, (unit, doc) in about.items():
        rate = rate_unit(unit) if unit else ""
        found.append(Variable(f"der({n})", rate, "", f"rate of: {doc}", Causality.LOCAL, derivative_of=n))
    return tuple(found)


def _settable_variables(
    machine: Rig, external: Sequence[ExternalSource], parameter_inputs: Sequence[str]
) -> tuple[list[Variable], dict[str, tuple[str, str]]]:
    """All parameters and external inputs, and {variable: (path of the part, name in it)} of each parameter.

    A parameter has its name in a configuration, but `part.name` where something else has that name as well.
    """
    rows = list_parameters(machine)
    varied = {(path, p.name) for p, path in (find_parameter(machine, name) for name in parameter_inputs)}
    inputs = [Variable(i.name, i.unit, "", i.doc, Causality.INPUT, i.start) for i in external_inputs(machine, external)]
    other_names = {*machine.signals, *machine.initial_state(), STEP, *(v.name for v in inputs)}
    names = short_names(machine)
    parameters, paths = [], {}
    for p, value, path in rows:
        name = f"{path}.{p.name}" if p.name in other_names else names[path, p.name]
        causality = Causality.INPUT if (path, p.name) in varied else Causality.PARAMETER
        parameters.append(Variable(name, p.unit, "", p.doc, causality, float(value), p.span))
        paths[name] = path, p.name
    return parameters + inputs, paths


def _untranslatable_part(machine: Rig) -> str:
    """The part of a machine that cannot be translated: the first such effect, else the controller."""
    for effect in machine.effects:
        single = structs.replace(machine, effects=(effect,))
        try:
            carry = dict.fromkeys(single.initial_state(), Dependence.CARRY)
            trace_to_ir(lambda y, m=single: step(m, y, 0.0, 1.0)[0], jnp.float64, carry)
        except Untranslatable:
            return f"the effect {effect.id}"
    part = next((part for part in machine.replaceable_parts() if part not in machine.effects), machine)
    return f"the {'rig' if part is machine else 'controller'} {type(part).__name__}"


def _dependence(source: ProgramInput) -> Dependence:
    """Values and step are invariant between two inputs, all else changes in every step."""
    return Dependence.INVARIANT if source.table in ("values", "h") else Dependence.CARRY


def _first_true(conditions: list):
    """The index of the first condition that is true, or −1."""
    index = -jnp.ones(())
    for k in reversed(range(len(conditions))):
        index = jnp.where(conditions[k], float(k), index)
    return index


def _inputs(program: Program, roots) -> set[int]:
    """The inputs on which the nodes `roots` depend."""
    visited, stack = set(), list(roots)
    while stack:
        i = stack.pop()
        if i not in visited:
            visited.add(i)
            stack += program.operands(i)
    return {program.nodes[i][1] for i in visited if program.nodes[i][0] == "input"}


def _signal(machine: Rig, name: str) -> Signal:
    """A signal; without a controller the reference is the command."""
    if isinstance(getattr(machine, "controller", None), OpenLoop) and name in ("reference", "reference_velocity"):
        unit = SIGNALS[name].unit.replace("m", "V")
        return Signal(unit, unit, SIGNALS[name].doc.replace("set point of the piston", "command"))
    return machine.signals[name]
