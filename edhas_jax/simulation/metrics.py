"""Metrics of runs from their samples, energies and volumes, and their derivatives along changes of the signals."""

import math
import types
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import jax
import numpy as np

from edhas_jax.core import runtime
from edhas_jax.core.units import from_si
from edhas_jax.machine.interface.metrics import (
    Mean,
    Metric,
    Taken,
    all_taken,
    instant,
    metrics_of_batch,
    metrics_of_run,
    signals_read,
    values_of,
)
from edhas_jax.machine.parameters import replace_values
from edhas_jax.machine.rigs import Rig


class MetricValue(NamedTuple):
    """A metric of a run: SI value, SI unit, unit for display, meaning; as text it is in the unit for display."""

    value: float
    unit: str
    display_unit: str
    doc: str

    def __str__(self) -> str:
        return f"{self.shown()} {self.display_unit}".removesuffix(" -")

    def shown(self) -> str:
        """The number in the unit for display, with five digits."""
        return f"{from_si(self.value, self.unit, self.display_unit):.5g}"


class RunTooShortError(ValueError):
    """A run ends before one whole cycle after the ramp."""


class Window(NamedTuple):
    """The part of a run over which metrics are taken.

    Attributes:
        time: times of the samples [s], (samples,), increasing.
        first: its start [s]; it need not be a sample.
        last: its end [s].
        balances: energies [J] and volumes [m³] since the start of the run by row, each (samples,).
    """

    time: np.ndarray
    first: float
    last: float
    balances: Mapping[str, np.ndarray] = types.MappingProxyType({})

    @property
    def is_whole(self) -> bool:
        """Whether it is the whole run."""
        return self.first <= self.time[0] and self.last >= self.time[-1]

    @property
    def inside(self) -> slice | np.ndarray:
        """Selects the samples inside."""
        near = 1e-12  # s: the ends are computed
        return slice(None) if self.is_whole else (self.time >= self.first - near) & (self.time <= self.last + near)

    def mean(self, values: np.ndarray | None, integral: np.ndarray | None = None) -> Any:
        """The mean of what has these values at the samples, (samples, …), if known with its integral."""
        if len(self.time) < 2:
            return math.nan if values is None else values[0]
        if integral is not None:
            return np.float64(mean_rate(self.time, integral, self.first, self.last, values))
        if self.is_whole:
            return np.trapezoid(values, self.time, axis=0) / (self.time[-1] - self.time[0])
        pieces = 0.5 * np.diff(self.time) * (values[1:] + values[:-1])
        integral = np.concatenate([[0.0], np.cumsum(pieces)])
        return np.float64(mean_rate(self.time, integral, self.first, self.last, values))


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # what is not finite is told by the status
def run_metrics(
    machine: Rig, signals: Mapping[str, np.ndarray], energy: Mapping[str, np.ndarray] = types.MappingProxyType({}),
    volume: Mapping[str, np.ndarray] = types.MappingProxyType({}),
) -> dict[str, Any]:  # fmt: skip
    """All metrics of a run, or of runs of a rig of one's own side by side.

    On a bench with a sine as set point they are taken over the whole cycles after the ramp, otherwise over the whole
    run. Means come from the energies and volumes cumulated step by step where there are any, all else from the samples.

    Args:
        machine: the machine; of several runs its numbers may be arrays (runs,).
        signals: SI arrays (samples,) by name, with "time" [s]; of several runs (samples, runs).
        energy: energy since the start [J] by row, each (samples,).
        volume: volume since the start [m³] by row, each (samples,).

    Returns:
        The metrics by name in SI; each a number, or (runs,).

    Raises:
        RunTooShortError: the run has no whole cycle after the ramp.
    """
    time = signals["time"]
    window = Window(time, *metric_window(machine, time[-1]), {**energy, **volume})
    is_one, at = all(values.ndim == 1 for values in signals.values()), _instants(machine, window, signals)
    wanted = metrics_of_run(machine) if is_one else metrics_of_batch(machine)
    found = {taken: taken.over(window, _values(machine, taken, at)) for taken in all_taken(wanted).values()}
    if is_one:
        wanted = {n: k for n, k in wanted.items() if k.defined is None or k.defined(machine, *map(found.get, k.taken))}
    return values_of(wanted, machine, found)


def _instants(machine: Rig, window: Window, signals: Mapping[str, np.ndarray]) -> types.SimpleNamespace:
    if machine.cycle is None:
        return types.SimpleNamespace(**signals)
    return instant(signals, float(machine.reference.frequency) * (window.time - window.first))


def _values(machine: Rig, taken: Taken, at: types.SimpleNamespace) -> np.ndarray | None:
    """The values at the samples; None where their signals are not recorded, so that only the integral is known."""
    if isinstance(taken, Mean) and taken.rows and not all(hasattr(at, n) for n in signals_read(machine, (taken,))):
        return None
    return taken.of(machine, at)


def metric_slopes(
    machine: Rig, columns: Mapping[str, np.ndarray], seeds: Mapping[str, np.ndarray], metrics: Mapping[str, Metric],
    signals: Mapping[str, np.ndarray], changes: Mapping[str, np.ndarray],
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:  # fmt: skip
    """Metrics of runs of a rig of one's own side by side, and their derivatives along changes of numbers and signals.

    Args:
        machine: what the runs have in common.
        columns: parameters that differ, by name in SI, each (runs,).
        seeds: their changes, by name, each (runs,).
        metrics: those that are wanted.
        signals: SI arrays (samples, runs) by name, with "time" [s], (samples,).
        changes: those of the signals, arrays of the same shapes.

    Returns:
        Values by metric and derivatives by metric, each (runs,).
    """
    window = Window(signals["time"], signals["time"][0], signals["time"][-1])
    seeds = {n: np.asarray(seeds[n], float) if n in seeds else np.zeros(np.shape(v)) for n, v in columns.items()}
    found, slopes, shape = {}, {}, next(iter(changes.values())).shape
    signals = {**signals, "time": np.broadcast_to(window.time[:, None], shape)}
    changes = {**changes, "time": np.zeros(shape)}

    def along(function, values, changes, at_samples=False):
        """Value and derivative of function(machine, values) of one run, or of a sample of it, for all of them."""
        of_run = jax.vmap(lambda c, v: function(replace_values(machine, c), v))
        of_all = jax.vmap(of_run, (None, 0)) if at_samples else of_run
        with runtime.double_precision():
            both = jax.jvp(of_all, (dict(columns), values), (seeds, changes))
        return tuple(np.asarray(part) for part in both)

    for taken in all_taken(metrics).values():
        names = signals_read(machine, (taken,))
        values, change = along(
            lambda m, v, taken=taken: taken.of(m, types.SimpleNamespace(**v)),
            {n: signals[n] for n in names}, {n: changes[n] for n in names}, True,
        )  # fmt: skip
        found[taken], slopes[taken] = taken.over(window, values), taken.slope(window, values, change)
    both = {
        name: along(lambda m, v, k=k: k.value(m, *v), [found[a] for a in k.taken], [slopes[a] for a in k.taken])
        for name, k in metrics.items()
    }
    return {n: value for n, (value, _) in both.items()}, {n: slope for n, (_, slope) in both.items()}


def signals_of(machine: Rig, metrics: Mapping[str, Metric]) -> Collection[str]:
    """The names of the signals from which metrics of a machine are computed."""
    return signals_read(machine, all_taken(metrics).values())


def metric_window(machine: Rig, end: float) -> tuple[float, float]:
    """The time [s] from which and to which metrics are taken: the whole cycles after the ramp, or the whole run.

    Args:
        machine: the machine.
        end: end of the run [s].

    Raises:
        RunTooShortError: there is no whole cycle after the ramp.
    """
    if machine.cycle is None:
        return 0.0, end
    period = 1.0 / float(machine.reference.frequency)
    ramp = float(machine.reference.ramp_time)
    cycles = math.floor((end - ramp) / period + 1e-9)
    if cycles < 1:
        raise RunTooShortError(
            f"no whole cycle after the ramp: the run ends at {end:.4g} s, the ramp at {ramp:.4g} s, "
            f"a cycle takes {period:.4g} s; let it run for at least {ramp + period:.4g} s"
        )
    return end - cycles * period, end


def mean_rate(t, cumulated, first: float, last: float, rate=None) -> float:
    """The mean of a rate between two times that need not be samples, from its integral at the samples.

    Args:
        t: times of the samples [s], (samples,).
        cumulated: integral of the rate, (samples,).
        first: start of the interval [s].
        last: end of the interval [s].
        rate: the rate at the samples; with it the integral is interpolated by cubics, otherwise linearly.
    """
    if rate is None or not (np.isfinite(rate).all() and np.isfinite(cumulated).all()):
        ends = np.interp([first, last], t, cumulated)
    else:
        from scipy.interpolate import CubicHermiteSpline  # slow to load, and most commands need none

        ends = CubicHermiteSpline(t, cumulated, rate)([first, last])
    return float((ends[1] - ends[0]) / (last - first))
