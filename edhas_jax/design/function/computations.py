"""What a `HostFunction` computes for a model: metrics of the periodic state, and signals at given times."""

import math
from typing import NamedTuple

import jax
import numpy as np

from edhas_jax.design.function.host_function import Outcome
from edhas_jax.design.gradient.fixed_point import GradientSettings, periodic_state, status_of
from edhas_jax.design.gradient.forward import MOST_TANGENTS, forward
from edhas_jax.design.gradient.reverse import reverse
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.batch_trajectories import simulate_batch
from edhas_jax.simulation.validity import Status

GRID_TOLERANCE = 1e-6  # of the interval, by which times may miss a grid and still count as on it
MOST_NUMBERS = 16_000_000  # that are held at a time; more runs than that are divided into parts


def has_value(status: np.ndarray) -> np.ndarray:
    """Where the metrics are those of a periodic state within the model's validity."""
    return np.isin(status, [s for s in Status if s.is_valid and s is not Status.NOT_PERIODIC])


class PeriodicMetrics:
    """Computes metrics, and their derivatives by some parameters, of many designs at once.

    NaN stands where there is no number: values as `has_value` says, derivatives also of a machine that stalls.
    """

    def __init__(self, machine: Rig, metrics: tuple[str, ...], settings: GradientSettings):
        self._machine = jax.tree.map(lambda leaf: np.asarray(leaf, float), machine)
        self._metrics, self._settings = metrics, settings

    def __call__(self, columns: dict[str, np.ndarray], fixed: None, active: tuple[str, ...]) -> Outcome:
        """See `host_function.Compute`."""
        state = periodic_state(self._machine, columns, self._settings)
        status = status_of(self._machine, columns, state, self._settings, True)
        values = {n: np.where(has_value(status), state.metrics[n], np.nan) for n in self._metrics}
        if not active:
            return Outcome(values, {})
        # forward mode carries a group of parameters at a time, reverse mode a metric: the fewer passes, the cheaper
        mode = forward if len(self._metrics) * MOST_TANGENTS >= len(active) else reverse
        found = mode(self._machine, columns, active, self._metrics, self._settings, state=state)
        exists = (has_value(found.status) & (found.status != Status.STALLED))[:, None]
        return Outcome(values, {n: np.where(exists, found.slopes[n], np.nan) for n in self._metrics})

    def status(self, columns: dict[str, np.ndarray]) -> np.ndarray:
        """The status (designs,) of each design, an integer of `Status`."""
        state = periodic_state(self._machine, columns, self._settings)
        return status_of(self._machine, columns, state, self._settings, True)


class Grid(NamedTuple):
    """The samples of a run that holds given times.

    Attributes:
        step: time step [s].
        steps_per_sample: steps between two samples.
        samples: number of samples from 0 on.
        index: the sample of each time, or None where times lie between samples.
    """

    step: float
    steps_per_sample: int
    samples: int
    index: np.ndarray | None


def grid_of(times: np.ndarray, largest_step: float) -> Grid:
    """A grid of samples that starts at 0 and holds the times; if they are not evenly spaced, one sample per step.

    Args:
        times: of the samples [s], (times,), none negative.
        largest_step: largest time step [s].
    """
    last = float(times.max())
    interval = (last - float(times.min())) / max(len(times) - 1, 1) or last
    if interval > 0.0:
        index = np.rint(times / interval)
        if np.abs(times / interval - index).max() <= GRID_TOLERANCE:
            steps = max(1, math.ceil(interval / largest_step - 1e-9))
            return Grid(interval / steps, steps, int(index.max()) + 1, index.astype(int))
    return Grid(largest_step, 1, math.ceil(last / largest_step) + 2, None)


class SampledTrajectory:
    """Computes signals, and their derivatives by some parameters, of many runs from rest at once.

    Times that are not evenly spaced are interpolated linearly between the steps. After a run has left the range of
    finite numbers its signals are NaN.
    """

    def __init__(self, machine: Rig, signals: tuple[str, ...], largest_step: float):
        self._machine, self._signals, self._step = machine, signals, largest_step

    def __call__(self, columns: dict[str, np.ndarray], fixed: np.ndarray, active: tuple[str, ...]) -> Outcome:
        """See `host_function.Compute`; `fixed` are the times [s]."""
        count, width = len(next(iter(columns.values()))), max(1, len(active))
        shape = count, len(fixed)
        if not np.isfinite(fixed).all() or (fixed < 0.0).any():
            unknown = {n: np.full(shape, np.nan) for n in self._signals}
            return Outcome(unknown, {n: np.full((*shape, width), np.nan) for n in self._signals} if active else {})
        grid = grid_of(fixed, self._step)
        values = {n: np.empty(shape) for n in self._signals}
        slopes = {n: np.empty((*shape, width)) for n in self._signals} if active else {}
        part = max(1, MOST_NUMBERS // (grid.samples * len(self._signals) * width * (2 if active else 1)))
        for first in range(0, count, part):
            rows = slice(first, first + part)
            some = {n: np.repeat(v[rows], width) for n, v in columns.items()}
            runs = len(next(iter(some.values()))) // width
            seeds = {n: np.tile([float(n == other) for other in active], runs) for n in active} or None
            found = simulate_batch(
                self._machine, some, seeds, grid.step, grid.steps_per_sample, grid.samples, self._signals
            )
            for n in self._signals:
                values[n][rows] = self._at(found.values[n][:, ::width], grid, fixed).T
                if active:
                    slope = self._at(found.slopes[n], grid, fixed)
                    slopes[n][rows] = slope.reshape(len(fixed), runs, width).transpose(1, 0, 2)
        return Outcome(values, slopes)

    def _at(self, table: np.ndarray, grid: Grid, times: np.ndarray) -> np.ndarray:
        """The rows (times, runs) of a table (samples, runs)."""
        if grid.index is not None:
            return table[grid.index]
        place = times / grid.step
        before = np.minimum(place.astype(int), grid.samples - 2)
        share = (place - before)[:, None]
        return (1.0 - share) * table[before] + share * table[before + 1]
