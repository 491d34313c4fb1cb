"""Configuration of a sizing task: design variables, objective, constraints, tolerances."""

import dataclasses
import enum
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from edhas_jax.config.run_settings import quantity_text
from edhas_jax.config.yaml_with_lines import KeyPath
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.structs import Parameter
from edhas_jax.core.trusted_code import Trust
from edhas_jax.core.units import UnitError, format_quantity, format_result, to_si
from edhas_jax.design.batch.batch import BatchSettings
from edhas_jax.design.batch.design_table import resolve_parameter
from edhas_jax.design.batch.experiment_design import Axis, full_factorial
from edhas_jax.design.task_reader import TaskReader
from edhas_jax.machine.interface.metrics import metrics_of_batch
from edhas_jax.machine.parameters import ParameterError, get_parameter, list_parameters, short_names
from edhas_jax.machine.rigs import Rig

SECTIONS = ("points", "free", "objective", "front", "constraints", "robust", "starts", "iterations", "seed")


@dataclasses.dataclass(frozen=True)
class Constraint:
    """A bound on a metric at every operating point.

    Attributes:
        metric: the metric.
        upper: whether `value` is an upper bound, or else a lower one.
        value: the bound, SI.
        unit: SI unit of the metric.
        shown: the unit in which it is shown.
    """

    metric: str
    upper: bool
    value: float
    unit: str
    shown: str

    def __str__(self) -> str:
        return f"{self.metric} {'≤' if self.upper else '≥'} {self.text(self.value)}"

    def text(self, value: float) -> str:
        """A value of the metric (SI) as text."""
        return format_result(value, self.unit, self.shown)


class ToleranceKind(enum.Enum):
    """The meaning of the ends of a tolerance."""

    RANGE = "range"
    DIFFERENCE = "difference"
    FACTOR = "factor"


@dataclasses.dataclass(frozen=True)
class Tolerance:
    """The variation of a parameter between manufactured machines or conditions.

    Attributes:
        name: the parameter.
        kind: whether the ends are values (SI), differences from the nominal value (SI), or factors on it.
        low: lower end.
        high: upper end.
    """

    name: str
    kind: ToleranceKind
    low: float
    high: float

    def apply(self, value, fraction: float):
        """The value (SI) of a machine from the nominal one, at a fraction 0 … 1 of the tolerance."""
        end = self._end(fraction)
        return {ToleranceKind.RANGE: end + 0.0 * value, ToleranceKind.DIFFERENCE: value + end,
                ToleranceKind.FACTOR: value * end}[self.kind]  # fmt: skip

    def derivative(self, fraction: float) -> float:
        """The derivative of `apply` by the nominal value."""
        return {ToleranceKind.RANGE: 0.0, ToleranceKind.DIFFERENCE: 1.0,
                ToleranceKind.FACTOR: self._end(fraction)}[self.kind]  # fmt: skip

    def _end(self, fraction: float) -> float:
        return self.low + fraction * (self.high - self.low)


class RobustObjective(enum.Enum):
    """The statistic over the tolerances that is optimised."""

    EXPECTED = "expected"
    WORST_CASE = "worst_case"


@dataclasses.dataclass(frozen=True)
class SizingTask:
    """An optimisation of dimensions: maximise J = Σ weight · ln(metric) within bounds and constraints.

    Attributes:
        machine: the machine to size; its parameters are the first start.
        variables: the design variables with their bounds.
        weights: weight of each metric of the objective, negative for one to minimise.
        constraints: bounds on metrics at every operating point.
        points: axes that span a grid of operating points.
        front: number of designs on a Pareto front of the two metrics of the objective; 0 for a single design.
        robust: statistic over the tolerances; None without them.
        tolerances: variations of parameters.
        starts: number of starts.
        iterations: of the descent from each start.
        seed: of the starts.
        settings: settings of the batch.
        name: title of the task.
        text: the configuration file.
    """

    machine: Rig
    variables: tuple[Axis, ...]
    weights: Mapping[str, float]
    constraints: tuple[Constraint, ...]
    points: tuple[Axis, ...] = ()
    front: int = 0
    robust: RobustObjective | None = None
    tolerances: tuple[Tolerance, ...] = ()
    starts: int = 32
    iterations: int = 60
    seed: int = 0
    settings: BatchSettings = BatchSettings()
    name: str = ""
    text: str = ""

    def operating_points(self) -> dict[str, np.ndarray]:
        """The columns (SI) of the operating points, shape (points,) each; empty for the machine as it is."""
        return full_factorial(self.points) if self.points else {}


def load_sizing(source: Path | str | Mapping[str, Any], trust: Trust = ()) -> SizingTask:
    """Read a sizing task from a YAML file.

    Args:
        source: the configuration file, or a mapping with the same keys, whose machine may be a machine.
        trust: Python files (or modules) of your own that may run if the file names them, besides those that were
            allowed by `edhas trust`.

    Returns:
        The task.

    Raises:
        ConfigError: every problem of the file, one line each.
    """
    r = TaskReader(source, SECTIONS, "free", trust=trust, machine_file="start.yaml")
    points = r.operating_points("points")
    for name in sorted({a.name for a in points} & {a.name for a in r.axes}):
        r.add(("free", name), "is fixed by the operating points; remove it from one of the two sections")
    known = None if r.machine is None else list(metrics_of_batch(r.machine))
    weights = _read_objective(r, known)
    front = r.read_integer(("front",), r.data.get("front", "0"), 0, 100)
    if front and len(weights) != 2:
        r.add(("front",), f"trades off two metrics; `objective:` names {len(weights)}")
    constraints = _read_constraints(r, known)
    robust, tolerances = _read_robust(r)
    starts = r.read_integer(("starts",), r.data.get("starts", "32"), 1, 4096)
    iterations = r.read_integer(("iterations",), r.data.get("iterations", "60"), 5, 10_000)
    seed = r.read_integer(("seed",), r.data.get("seed", "0"), 0, 2**32 - 1)
    if r.machine is not None:
        for axis in (a for a in r.axes if not a.values):
            value = float(get_parameter(r.machine, axis.name))
            unit = resolve_parameter(r.machine, axis.name)[0].unit
            if not axis.low <= value <= axis.high:
                low, high, start = (format_quantity(x, unit) for x in (axis.low, axis.high, value))
                r.add(("free", axis.name), f"the range {low} … {high} excludes the start, {start}; widen it, or set "
                      "another start under `parameters:`")  # fmt: skip
        for name, problem in _order_problems(r.machine, r.axes):
            r.add(("free", name), problem)
    r.finish()
    return SizingTask(r.machine, r.axes, weights, constraints, points, front, robust, tolerances, starts, iterations,
                      seed, r.settings, r.name, r.text)  # fmt: skip


def _order_problems(machine: Rig, axes: Sequence[Axis]) -> list[tuple[str, str]]:
    """Free parameters whose ranges allow an order of values that a law excludes, each with a sentence."""
    ranges, names, problems = {axis.name: (axis.low, axis.high) for axis in axes}, short_names(machine), []
    for p, value, path in list_parameters(machine):
        if not p.at_least:
            continue
        larger, smaller = names[path, p.name], names[path, p.at_least]
        limit = float(get_parameter(machine, f"{path}.{p.at_least}"))
        lowest, highest = ranges.get(larger, (float(value),))[0], ranges.get(smaller, (limit,))[-1]
        if lowest < highest and (free := [name for name in (larger, smaller) if name in ranges]):
            low, high = (format_quantity(v, p.unit) for v in (lowest, highest))
            sentence = f"{larger} must be at least {smaller}, but may become {low} with {smaller} at {high}"
            problems.append((free[0], f"{sentence}; narrow the range"))
    return problems


def _read_objective(r: TaskReader, known: list[str] | None) -> dict[str, float]:
    """By metric its weight, negative where it is to be minimised; without a machine no metric is `known`."""
    section = r.section("objective", "{maximise: {mean_flow: 1, overall_efficiency: 1}}")
    r.add_unknown_keys(("objective",), section, ("maximise", "minimise"))
    weights = {}
    for direction, sign in (("maximise", 1.0), ("minimise", -1.0)):
        rows = section.get(direction) or {}
        rows = {rows: "1"} if isinstance(rows, str) else {n: "1" for n in rows} if isinstance(rows, list) else rows
        for name, weight in rows.items():
            key = ("objective", direction, name)
            if known is not None and name not in known:
                r.add(key, f"no metric `{name}`; {suggest(str(name), known)}")
            try:
                number = float(str(weight))
            except ValueError:
                number = -1.0
            if not 0.0 < number < np.inf:
                r.add(key, f"a weight above 0 belongs here, not {weight}")
            if name in weights:
                r.add(key, "given twice")
            weights[name] = sign * number
    if not weights:
        r.add(("objective",), "no metric is given; write for example {maximise: [mean_flow]}")
    return weights


def _read_constraints(r: TaskReader, known: list[str] | None) -> tuple[Constraint, ...]:
    constraints = []
    for name, spec in r.section("constraints", "{rms_current: {max: 4 A}}").items():
        key = ("constraints", name)
        if known is None:
            continue
        if name not in known:
            r.add(key, f"no metric `{name}`; {suggest(str(name), known)}")
        elif not isinstance(spec, Mapping) or not set(spec) & {"min", "max"}:
            r.add(key, f"`max:` or `min:` and a quantity in {r.machine.metrics[name].unit} belong here")
        else:
            r.add_unknown_keys(key, spec, ("min", "max"))
            about = r.machine.metrics[name]
            p = Parameter(name, 1.0, about.unit, (-np.inf, np.inf), about.doc, "", Constraint)
            for bound in ("min", "max"):
                if bound in spec:
                    value = _read_quantity(r, (*key, bound), p, spec[bound])
                    if value is not None:
                        constraints.append(Constraint(name, bound == "max", value, about.unit, about.display_unit))
            if {"min", "max"} <= set(spec) and len(constraints) > 1 and constraints[-2].value > constraints[-1].value:
                r.add(key, "`min` lies above `max`: they cannot be met together")
    return tuple(constraints)


def _read_quantity(r: TaskReader, key: KeyPath, p: Parameter, value: Any) -> float | None:
    try:
        return to_si(quantity_text(p, value), p.unit)
    except (ParameterError, UnitError) as error:
        return r.add(key, str(error))


def _read_robust(r: TaskReader) -> tuple[RobustObjective | None, tuple[Tolerance, ...]]:
    section = r.section("robust", "{judge: expected, tolerances: {piston_clearance: {plus_minus: 3 um}}}")
    if not section:
        return None, ()
    r.add_unknown_keys(("robust",), section, ("judge", "tolerances"))
    valid = [kind.value for kind in RobustObjective]
    if section.get("judge") not in valid:
        r.add(("robust", "judge"), f"one of {', '.join(valid)} belongs here")
        return None, ()
    tolerances, given = [], {}
    rows = section.get("tolerances")
    if not isinstance(rows, Mapping) or not rows:
        r.add(("robust", "tolerances"), "at least one belongs here, for example {piston_clearance: {plus_minus: 3 um}}")
        return None, ()
    for name, spec in rows.items() if r.machine is not None else ():
        key = ("robust", "tolerances", name)
        try:
            p, column = resolve_parameter(r.machine, str(name))
        except ParameterError as error:
            r.add(key, str(error))
            continue
        if column in given:
            r.add(key, f"given twice, also as {given[column]}")
        given[column] = name
        if isinstance(spec, Mapping) and set(spec) == {"plus_minus"}:
            text = str(spec["plus_minus"])
            if text.rstrip().endswith("%"):
                percentage = Parameter(name, 0.05, "-", (0, 1), "", "", Constraint)
                share = _read_quantity(r, (*key, "plus_minus"), percentage, text)
                if share is not None:
                    tolerances.append(Tolerance(column, ToleranceKind.FACTOR, 1.0 - share, 1.0 + share))
            else:
                size = _read_quantity(r, (*key, "plus_minus"), p, text)
                if size is not None:
                    tolerances.append(Tolerance(column, ToleranceKind.DIFFERENCE, -size, size))
        elif isinstance(spec, Mapping) and set(spec) == {"from", "to"}:
            ends = [r.read_quantity((*key, end), p, spec[end]) for end in ("from", "to")]
            if None not in ends:
                tolerances.append(Tolerance(column, ToleranceKind.RANGE, *ends))
        else:
            r.add(key, "{plus_minus: 3 um}, {plus_minus: 5 %} or {from: 20 degC, to: 60 degC} belongs here")
    return RobustObjective(section["judge"]), tuple(tolerances)
