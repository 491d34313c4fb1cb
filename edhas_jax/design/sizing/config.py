"""Configurations of sizing tasks."""

import dataclasses
import enum
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from edhas_jax.config.run_settings import quantity_text
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.structs import Parameter
from edhas_jax.core.units import UnitError, format_quantity, to_si
from edhas_jax.design.batch.batch import BatchSettings
from edhas_jax.design.batch.design_table import resolve_parameter
from edhas_jax.design.batch.experiment_design import Axis, full_factorial
from edhas_jax.design.gradient.table import metrics_of
from edhas_jax.design.task_reader import TaskReader
from edhas_jax.machine.parameters import ParameterError, get_parameter
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.metrics import METRICS

SECTIONS = ("points", "free", "objective", "front", "constraints", "robust", "starts", "iterations", "seed")


@dataclasses.dataclass(frozen=True)
class Limit:
    """A metric must not exceed (`upper`) or fall below (not `upper`) a value (SI) at any operating point."""

    metric: str
    upper: bool
    value: float

    def __str__(self) -> str:
        unit = METRICS[self.metric][0]
        return f"{self.metric} {'≤' if self.upper else '≥'} {format_quantity(self.value, unit)}"


@dataclasses.dataclass(frozen=True)
class Tolerance:
    """A parameter of made machines: within `low` … `high`, which are values (SI), differences or factors."""

    name: str
    kind: "ToleranceKind"
    low: float
    high: float

    def applied(self, value, share: float):
        """The parameter of a machine for a design's `value`, from the lower (share 0) to the upper end (share 1)."""
        at = self.low + share * (self.high - self.low)
        return {ToleranceKind.RANGE: at + 0.0 * value, ToleranceKind.DIFFERENCE: value + at,
                ToleranceKind.FACTOR: value * at}[self.kind]  # fmt: skip

    def slope(self, share: float) -> float:
        """d applied / d value."""
        at = self.low + share * (self.high - self.low)
        return {ToleranceKind.RANGE: 0.0, ToleranceKind.DIFFERENCE: 1.0, ToleranceKind.FACTOR: at}[self.kind]


class ToleranceKind(enum.Enum):
    """What the ends of a tolerance are."""

    RANGE = "range"
    DIFFERENCE = "difference"
    FACTOR = "factor"


class Robust(enum.Enum):
    """What is made best when a machine varies within its tolerances."""

    EXPECTED = "expected"
    WORST_CASE = "worst_case"


@dataclasses.dataclass(frozen=True)
class Sizing:
    """What is to be made best (`weights` of the logarithms of metrics), by which dimensions, within which limits.

    `points` are operating points, all at once. With a `front` of n the two metrics of the objective are traded off
    by n weightings. `robust` and `tolerances` make the objective one over machines as they are made.
    """

    machine: Rig
    free: tuple[Axis, ...]
    weights: Mapping[str, float]
    limits: tuple[Limit, ...]
    points: tuple[Axis, ...] = ()
    front: int = 0
    robust: Robust | None = None
    tolerances: tuple[Tolerance, ...] = ()
    starts: int = 32
    iterations: int = 60
    seed: int = 0
    settings: BatchSettings = BatchSettings()
    name: str = ""
    text: str = ""

    def operating_points(self) -> dict[str, np.ndarray]:
        """The columns (SI) of the operating points; none: the machine as it stands."""
        return full_factorial(self.points) if self.points else {}


def load_sizing(path: Path | str) -> Sizing:
    """The task in a YAML file.

    Raises:
        ConfigError: every problem of the file, one line each.
    """
    r = TaskReader(path, SECTIONS, "free")
    points = r.operating_points("points")
    for name in sorted({a.name for a in points} & {a.name for a in r.axes}):
        r.add(("free", name), "is held at the operating points; leave it out here or there")
    known = metrics_of(r.machine) if r.machine is not None and not r.problems else list(METRICS)
    weights = _objective(r, known)
    front = r.read_integer(("front",), r.data.get("front", "0"), 0, 100)
    if front and len(weights) != 2:
        r.add(("front",), f"trades off two metrics; `objective:` names {len(weights)}")
    limits = _limits(r, known)
    robust, tolerances = _robust(r)
    starts = r.read_integer(("starts",), r.data.get("starts", "32"), 1, 4096)
    iterations = r.read_integer(("iterations",), r.data.get("iterations", "60"), 5, 10_000)
    seed = r.read_integer(("seed",), r.data.get("seed", "0"), 0, 2**32 - 1)
    if r.machine is not None:
        for axis in r.axes:
            value, unit = float(get_parameter(r.machine, axis.name)), resolve_parameter(r.machine, axis.name)[0].unit
            if not axis.low <= value <= axis.high:
                low, high, at = (format_quantity(x, unit) for x in (axis.low, axis.high, value))
                r.add(("free", axis.name), f"the range {low} … {high} excludes the start, {at}; widen it, or set "
                      "another start under `parameters:`")  # fmt: skip
    r.finish()
    return Sizing(r.machine, r.axes, weights, limits, points, front, robust, tolerances, starts, iterations, seed,
                  r.settings, r.name, r.text)  # fmt: skip


def _objective(r: TaskReader, known: list[str]) -> dict[str, float]:
    """{metric: weight}, negative where it is to be small."""
    given = r.section("objective", "{maximise: {mean_flow: 1, overall_efficiency: 1}}")
    r.add_unknown_keys(("objective",), given, ("maximise", "minimise"))
    weights = {}
    for way, sign in (("maximise", 1.0), ("minimise", -1.0)):
        rows = given.get(way) or {}
        rows = {rows: "1"} if isinstance(rows, str) else {n: "1" for n in rows} if isinstance(rows, list) else rows
        for name, weight in rows.items():
            key = ("objective", way, name)
            if name not in known:
                r.add(key, f"no metric `{name}`; {suggest(str(name), known)}")
            try:
                number = float(str(weight))
            except ValueError:
                number = -1.0
            if not 0.0 < number < np.inf:
                r.add(key, f"a weight above 0 belongs here, not {weight}")
            weights[name] = sign * number
    if not weights:
        r.add(("objective",), "nothing is to be made best; write for example {maximise: [mean_flow]}")
    return weights


def _limits(r: TaskReader, known: list[str]) -> tuple[Limit, ...]:
    limits = []
    for name, spec in r.section("constraints", "{rms_current: {max: 4 A}}").items():
        key = ("constraints", name)
        if name not in known:
            r.add(key, f"no metric `{name}`; {suggest(str(name), known)}")
        elif not isinstance(spec, Mapping) or not set(spec) & {"min", "max"}:
            r.add(key, f"`max:` or `min:` and a quantity in {METRICS[name][0]} belong here")
        else:
            r.add_unknown_keys(key, spec, ("min", "max"))
            unit = METRICS[name][0]
            p = Parameter(name, 1.0, unit, (-np.inf, np.inf), METRICS[name][2], "", Limit)
            for way in ("min", "max"):
                if way in spec:
                    value = _quantity(r, (*key, way), p, spec[way])
                    if value is not None:
                        limits.append(Limit(name, way == "max", value))
            if {"min", "max"} <= set(spec) and len(limits) > 1 and limits[-2].value > limits[-1].value:
                r.add(key, "`min` lies above `max`: they cannot be met together")
    return tuple(limits)


def _quantity(r: TaskReader, key, p: Parameter, value: Any) -> float | None:
    try:
        return to_si(quantity_text(p, value), p.unit)
    except (ParameterError, UnitError) as error:
        return r.add(key, str(error))


def _robust(r: TaskReader) -> tuple[Robust | None, tuple[Tolerance, ...]]:
    given = r.section("robust", "{judge: expected, tolerances: {piston_clearance: {plus_minus: 3 um}}}")
    if not given:
        return None, ()
    r.add_unknown_keys(("robust",), given, ("judge", "tolerances"))
    valid = [kind.value for kind in Robust]
    if given.get("judge") not in valid:
        r.add(("robust", "judge"), f"one of {', '.join(valid)} belongs here")
        return None, ()
    tolerances = []
    rows = given.get("tolerances")
    if not isinstance(rows, Mapping) or not rows:
        r.add(("robust", "tolerances"), "at least one belongs here, for example {piston_clearance: {plus_minus: 3 um}}")
        return None, ()
    for name, spec in rows.items() if r.machine is not None else ():
        key = ("robust", "tolerances", name)
        try:
            p, own = resolve_parameter(r.machine, str(name))
        except ParameterError as error:
            r.add(key, str(error))
            continue
        if isinstance(spec, Mapping) and set(spec) == {"plus_minus"}:
            text = str(spec["plus_minus"])
            if text.rstrip().endswith("%"):
                share = _quantity(r, (*key, "plus_minus"), Parameter(name, 0.05, "-", (0, 1), "", "", Limit), text)
                if share is not None:
                    tolerances.append(Tolerance(own, ToleranceKind.FACTOR, 1.0 - share, 1.0 + share))
            else:
                size = _quantity(r, (*key, "plus_minus"), p, text)
                if size is not None:
                    tolerances.append(Tolerance(own, ToleranceKind.DIFFERENCE, -size, size))
        elif isinstance(spec, Mapping) and set(spec) == {"from", "to"}:
            ends = [r.read_quantity((*key, end), p, spec[end]) for end in ("from", "to")]
            if None not in ends:
                tolerances.append(Tolerance(own, ToleranceKind.RANGE, *ends))
        else:
            r.add(key, "{plus_minus: 3 um}, {plus_minus: 5 %} or {from: 20 degC, to: 60 degC} belongs here")
    return Robust(given["judge"]), tuple(tolerances)
