"""Exact derivatives of the metrics of a machine by its parameters, as a table with units and elasticities."""

import dataclasses
import enum
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.units import UnitError
from edhas_jax.design.batch.batch import runs_designs
from edhas_jax.design.batch.design_table import resolve_parameter
from edhas_jax.design.gradient.fixed_point import Derivatives, GradientSettings
from edhas_jax.design.gradient.forward import forward
from edhas_jax.design.gradient.reverse import reverse
from edhas_jax.machine.interface.metrics import metrics_of_batch
from edhas_jax.machine.parameters import ParameterError, find_parameter, get_parameter, parse_value, short_names
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.validity import REASONS, Status

# what is said of a design whose metrics change by leaps, or not at all
_NO_DERIVATIVE = (Status.NOT_PERIODIC, Status.STALLED, *(status for status in Status if not status.is_valid))


class GradientError(ParameterError):
    """This derivative cannot be asked for; the text names what is wrong and what is there."""


class Mode(enum.Enum):
    """Forward: the cost grows with the number of parameters; reverse: with that of metrics."""

    FORWARD = "forward"
    REVERSE = "reverse"


@dataclasses.dataclass(frozen=True)
class Gradient:
    """Derivatives of metrics by parameters at one or several operating points.

    `frame` has a row per point, metric and parameter: `point` (its number), the columns of the points (SI), `metric`,
    `value`, `value_unit`, `parameter`, `parameter_value`, `parameter_unit`, `derivative`, `derivative_unit`,
    `elasticity` (relative change of the metric per relative change of the parameter) and `note`, which says why a
    derivative or elasticity is missing (NaN) and is empty elsewhere.
    """

    frame: pd.DataFrame
    machine: Rig
    settings: GradientSettings

    def elasticities(self, point: int = 0) -> pd.DataFrame:
        """Elasticities (parameters × metrics) at the operating point of this number."""
        rows = self.frame[self.frame["point"] == point]
        found = rows.pivot(index="parameter", columns="metric", values="elasticity")
        return found.reindex(index=rows["parameter"].unique(), columns=rows["metric"].unique())


def gradient(
    machine: Rig,
    metrics: Sequence[str] | None = None,
    parameters: Sequence[str] | None = None,
    points: Mapping[str, Sequence[Any]] | None = None,
    settings: GradientSettings = GradientSettings(),
    mode: Mode = Mode.FORWARD,
    on_cycle: Callable[[float], None] | None = None,
) -> Gradient:
    """Derivatives of metrics by parameters of a bench driven by a sine, in its periodic state.

    The derivatives are those of the program that computes the metrics, through valve impact, friction reversal and
    saturation; their error falls with the step (docs/gradients.md).

    Args:
        machine: the bench.
        metrics: names of metrics; None: all.
        parameters: names of parameters; None: all that act in the periodic state.
        points: operating points, by parameter a list of values (SI, or text with unit), all of one length; None: the
            machine as it stands.
        settings: steps per cycle and tolerances.
        mode: forward or reverse mode; the result is the same to rounding.
        on_cycle: called in forward mode with the share of the work that is done, 0 … 1.

    Returns:
        A table with a row per operating point, metric and parameter, with units and elasticities.

    Raises:
        GradientError: a name or value is wrong, or the machine has no periodic state.
    """
    metrics, names, columns = _parse_request(machine, metrics, parameters, points)
    if mode is Mode.FORWARD or machine.cycle is None:
        found = forward(machine, columns, names, metrics, settings, on_cycle)
    else:
        found = reverse(machine, columns, names, metrics, settings)
    shown = [n for n in columns if points and n in {resolve_parameter(machine, p)[1] for p in points}]
    return Gradient(_frame(machine, columns, names, metrics, shown, found), machine, settings)


def _parse_request(machine: Rig, metrics, parameters, points) -> tuple[list[str], list[str], dict[str, np.ndarray]]:
    """The metrics, the parameters by their own names, and the columns (SI) of what is run.

    Raises:
        GradientError: see `gradient`.
    """
    if not runs_designs(machine):
        raise GradientError(f"a gradient needs a bench that is driven by a sine; this is {machine.name}")
    known = list(metrics_of_batch(machine))
    for name in metrics or ():
        if name not in known:
            raise GradientError(f"{name}: no metric of {machine.name}; {suggest(name, known)}")
    names = _own_names(machine, parameters if parameters is not None else parameters_of(machine))
    if not names or metrics is not None and not len(metrics):
        raise GradientError("at least one parameter and one metric are needed")
    given = {}
    for name, values in (points or {}).items():
        try:
            p, own = resolve_parameter(machine, name)
            given[own] = np.array([float(parse_value(p, v)) for v in values])
        except (ParameterError, UnitError) as error:
            raise GradientError(f"{name}: {error}") from None
    lengths = {len(v) for v in given.values()}
    if len(lengths) > 1 or 0 in lengths:
        counts = ", ".join(f"{n} {len(v)}" for n, v in given.items())
        raise GradientError(f"every parameter of the operating points needs equally many values; got {counts}")
    count = lengths.pop() if lengths else 1
    columns = {n: np.full(count, float(get_parameter(machine, n))) for n in names}
    return list(metrics or known), names, columns | given


def parameters_of(machine: Rig) -> list[str]:
    """Every parameter of a machine that can act in its periodic state."""
    return [
        called for (path, name), called in short_names(machine).items() if name != "ramp_time" and path != "sampling"
    ]


def _own_names(machine: Rig, parameters: Sequence[str]) -> list[str]:
    names = []
    for name in parameters:
        try:
            names.append(resolve_parameter(machine, name)[1])
        except ParameterError as error:
            raise GradientError(f"{name}: {error}") from None
        if find_parameter(machine, names[-1])[1] == "sampling":
            raise GradientError(f"{name}: has no derivative; the controller's instants are whole numbers of steps")
    if twice := next((n for n in names if names.count(n) > 1), None):
        raise GradientError(f"{twice}: asked for twice")
    return names


def _frame(machine, columns, names, metrics, shown, found: Derivatives) -> pd.DataFrame:
    units = {n: resolve_parameter(machine, n)[0].unit for n in names}
    rows = []
    for point, status in enumerate(found.status):
        at = {n: columns[n][point] for n in shown}
        for metric in metrics:
            value, unit = found.values[metric][point], machine.metrics[metric].unit
            for j, name in enumerate(names):
                size, slope = columns[name][point], found.slopes[metric][point, j]
                note = _why_missing(machine, columns, point, metric, value, slope, Status(int(status)))
                elasticity = np.nan
                if note:
                    slope = np.nan
                elif value == 0.0 or size == 0.0:
                    note = f"no elasticity: the {'metric' if value == 0.0 else 'parameter'} is zero"
                else:
                    elasticity = slope * size / value
                rows.append({
                    "point": point, **at, "metric": metric, "value": value, "value_unit": unit, "parameter": name,
                    "parameter_value": size, "parameter_unit": units[name], "derivative": slope,
                    "derivative_unit": _per(unit, units[name]), "elasticity": elasticity, "note": note,
                })  # fmt: skip
    return pd.DataFrame(rows)


def _why_missing(machine: Rig, columns, point: int, metric: str, value: float, slope: float, status: Status) -> str:
    """Why this derivative does not exist; empty if it does."""
    if status in _NO_DERIVATIVE:
        return f"no derivative: {REASONS[status]}"
    if metric == "peak_voltage" and machine.cycle is not None:
        supply = columns["supply_voltage"][point] if "supply_voltage" in columns else machine.supply.supply_voltage
        if value >= float(supply) * (1.0 - 1e-9):
            return "no derivative: the voltage is clipped, its peak is the supply voltage"
    return "" if np.isfinite(slope) else "no derivative: it is not finite"


def _per(unit: str, by: str) -> str:
    if by == "-":
        return unit
    simple = not set(by) & set("/*")
    return f"{'1' if unit == '-' else unit}/{by if simple else f'({by})'}"
