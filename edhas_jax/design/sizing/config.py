"""Configuration of a sizing task: design variables, objective, constraints, tolerances."""

import dataclasses
import enum
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from edhas_jax.config.declared_keys import (
    QUANTITY,
    Key,
    Keys,
    by_name,
    by_parameter,
    choice,
    own_value,
    quantity,
    size_in,
    whole_number,
)
from edhas_jax.config.document import Entry
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.trusted_code import Trust
from edhas_jax.core.units import format_quantity, format_result
from edhas_jax.design.batch.batch import BatchSettings
from edhas_jax.design.batch.design_table import resolve_parameter
from edhas_jax.design.batch.experiment_design import Axis, full_factorial
from edhas_jax.design.task_file import AXES, COMMON, SEED, TaskFile
from edhas_jax.machine.interface.metrics import metrics_of_batch
from edhas_jax.machine.parameters import get_parameter, list_parameters, short_names
from edhas_jax.machine.rigs import Rig


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


@dataclasses.dataclass(frozen=True)
class Tolerance:
    """The variation of a parameter between manufactured machines or conditions: offset + factor · nominal value.

    Attributes:
        name: the parameter.
        offset: at the two ends of the tolerance, SI.
        factor: likewise.
    """

    name: str
    offset: tuple[float, float]
    factor: tuple[float, float]

    def apply(self, value, fraction: float):
        """The value (SI) of a machine from the nominal one, at a fraction 0 … 1 of the tolerance."""
        return _between(*self.offset, fraction) + _between(*self.factor, fraction) * value

    def derivative(self, fraction: float) -> float:
        """The derivative of `apply` by the nominal value."""
        return _between(*self.factor, fraction)


def _between(low: float, high: float, fraction: float) -> float:
    return low + fraction * (high - low)


class RobustObjective(enum.Enum):
    """The statistic over the tolerances that is optimised."""

    EXPECTED = "expected"
    WORST_CASE = "worst_case"


_WEIGHTS = own_value({"type": ["object", "array", "string"]}, "a metric, a list of metrics, or weights by metric")
ROBUST = Keys({
    "judge": Key(choice(RobustObjective), "optimise the mean over the tolerances, or their worst case"),
    "tolerances": Key(by_name(own_value({"type": "object"}), "{piston_clearance: {plus_minus: 3 um}}", "parameter"),
                      "`{plus_minus: 3 um}`, `{plus_minus: 5 %}` or `{from: 20 degC, to: 60 degC}`"),
}, "{judge: expected, tolerances: {piston_clearance: {plus_minus: 3 um}}}")  # fmt: skip
KEYS = Keys(COMMON | {
    "points": Key(AXES, "every combination is an operating point; limits hold at each, the objective is the mean"),
    "free": Key(AXES, "`{from, to, spacing}` of the dimensions: what can be made", needed=True),
    "objective": Key(Keys({"maximise": Key(_WEIGHTS, "metrics to raise"), "minimise": Key(_WEIGHTS, "to lower")},
                          "{maximise: {mean_flow: 1, overall_efficiency: 1}}").kind, "weights of metrics", needed=True),
    "front": Key(whole_number(0, 100), "designs from one of two metrics to the other, instead of weights", 0),
    "constraints": Key(by_name(own_value({"type": "object", "properties": {"min": QUANTITY, "max": QUANTITY}}),
                              "{rms_current: {max: 4 A}}", "metric"), "limits of metrics"),
    "robust": Key(ROBUST.kind, "manufactured machines instead of nominal ones"),
    "starts": Key(whole_number(1, 4096), "starts of the search", 32),
    "iterations": Key(whole_number(5, 10_000), "of the descent", 60),
    "seed": SEED,
})  # fmt: skip


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
    file = TaskFile(source, KEYS, trust)
    file.require_batch()
    values, top = file.values, file.top
    axes = file.ranges("free")
    points = file.operating_points(axes, "free")
    known = None if file.machine is None else list(metrics_of_batch(file.machine))
    weights = _read_objective(top["objective"], known)
    if values["front"] and len(weights) != 2:
        top["front"].add(f"trades off two metrics; `objective:` names {len(weights)}")
    constraints, tolerances = _read_constraints(file, known), _read_tolerances(file)
    if file.machine is not None:
        for axis in (a for a in axes if not a.values):
            value = float(get_parameter(file.machine, axis.name))
            if not axis.low <= value <= axis.high:
                low, high, start = (format_quantity(x, axis.unit) for x in (axis.low, axis.high, value))
                top["free"][axis.name].add(f"the range {low} … {high} excludes the start, {start}; widen it, or set "
                                           "another start under `parameters:`")  # fmt: skip
        for name, problem in _order_problems(file.machine, axes):
            top["free"][name].add(problem)
    file.finish()
    return SizingTask(
        file.machine, axes, weights, constraints, points, values["front"], values["robust"]["judge"], tolerances,
        values["starts"], values["iterations"], values["seed"], file.settings, values["name"], file.text("start.yaml"),
    )  # fmt: skip


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


def _read_objective(section: Entry, known: list[str] | None) -> dict[str, float]:
    """By metric its weight, negative where it is to be minimised; without a machine no metric is `known`."""
    weights = {}
    for direction, sign in (("maximise", 1.0), ("minimise", -1.0)):
        rows = section[direction].value or {}
        rows = {rows: "1"} if isinstance(rows, str) else {n: "1" for n in rows} if isinstance(rows, list) else rows
        for name, weight in rows.items():
            entry = Entry(weight, (*section.key, direction, name), section.problems)
            if known is not None and name not in known:
                entry.add(f"no metric `{name}`; {suggest(str(name), known)}")
            try:
                number = float(str(weight))
            except ValueError:
                number = -1.0
            if not 0.0 < number < np.inf:
                entry.add(f"a weight above 0 belongs here, not {weight}")
            if name in weights:
                entry.add("given twice")
            weights[name] = sign * number
    if not weights:
        section.add("no metric is given; write for example {maximise: [mean_flow]}")
    return weights


def _read_constraints(file: TaskFile, known: list[str] | None) -> tuple[Constraint, ...]:
    constraints = []
    for name, entry in (file.values["constraints"] or {}).items() if known is not None else ():
        if name not in known:
            entry.add(f"no metric `{name}`; {suggest(str(name), known)}")
            continue
        about = file.machine.metrics[name]
        size = size_in(about.unit)
        if "min" not in entry and "max" not in entry:
            entry.add(f"`max:` or `min:` and a quantity in {about.unit} belong here")
            continue
        bounds = Keys({"min": Key(size, ""), "max": Key(size, "")}).read(entry)
        shown = about.unit, about.display_unit
        constraints += [Constraint(name, end == "max", v, *shown) for end, v in bounds.items() if v is not None]
        if None not in bounds.values() and bounds["min"] > bounds["max"]:
            entry.add("`min` lies above `max`: they cannot be met together")
    return tuple(constraints)


def _read_tolerances(file: TaskFile) -> tuple[Tolerance, ...]:
    section, rows = file.top["robust"], file.values["robust"]["tolerances"]
    if not section.value:
        return ()
    if "judge" not in section:
        ROBUST.keys["judge"].kind.read(section["judge"])
    if not rows:
        section["tolerances"].add("at least one belongs here, for example {piston_clearance: {plus_minus: 3 um}}")
    tolerances = []
    if file.machine is None:
        return ()
    for entry, p, column in by_parameter(rows.values(), partial(resolve_parameter, file.machine)):
        if isinstance(entry.value, Mapping) and set(entry.value) == {"plus_minus"}:
            inside = entry["plus_minus"]
            is_share = str(inside.value).rstrip().endswith("%")
            size = size_in("-" if is_share else p.unit).read(inside)
            if size is not None:
                ends = ((0.0, 0.0), (1.0 - size, 1.0 + size)) if is_share else ((-size, size), (1.0, 1.0))
                tolerances.append(Tolerance(column, *ends))
        elif isinstance(entry.value, Mapping) and set(entry.value) == {"from", "to"}:
            ends = [quantity(p).read(entry[end]) for end in ("from", "to")]
            if None not in ends:
                tolerances.append(Tolerance(column, tuple(ends), (0.0, 0.0)))
        else:
            entry.add("{plus_minus: 3 um}, {plus_minus: 5 %} or {from: 20 degC, to: 60 degC} belongs here")
    return tuple(tolerances)
