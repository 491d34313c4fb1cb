"""Predict the measured signals of a campaign, and their sensitivities, from a machine with unknown parameters."""

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from scipy.interpolate import CubicSpline

from edhas_jax.machine.components.set_points import Steps
from edhas_jax.machine.parameters import ParameterError, get_parameter, short_names
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import BenchRun, Campaign, has_parameter
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.replay import Replay, machine_with_replay
from edhas_jax.measurements.unknown_parameters import UnknownParameter
from edhas_jax.simulation.batch_trajectories import simulate_batch

MAX_TIMESTAMP_ERROR = 1e-4  # in sample intervals; time stamps further off the regular grid need interpolation
FINER_GRIDS = 4, 5, 3, 2  # points per sample interval that they are interpolated from; the first that divides the steps


class EvaluationPoint(NamedTuple):
    """Coordinates `x` of the unknown parameters (unknowns,), and the indices of the runs to be predicted there."""

    x: np.ndarray
    runs: tuple[int, ...]


class PredictedSignals(NamedTuple):
    """Signals of one run by name: `values` (samples,) in SI, `sensitivities` (samples, unknowns) = ∂values/∂x."""

    values: dict[str, np.ndarray]
    sensitivities: dict[str, np.ndarray] | None


@dataclasses.dataclass(frozen=True)
class _RunGroup:
    """Runs simulated in one batch: the same sample interval [s] and set point, different parameter values.

    Runs with irregular time stamps are interpolated from a grid that is finer than the sample interval (`is_finer`).
    """

    machine: Rig
    interval: float
    is_finer: bool
    runs: tuple[int, ...]

    def points_per_sample(self, steps_per_sample: int) -> int:
        """Number of points per sample interval at which the signals are recorded."""
        if not self.is_finer:
            return 1
        return next((n for n in FINER_GRIDS if steps_per_sample % n == 0), 1)


class MeasurementModel:
    """A machine with unknown parameters and its instruments, simulated as the runs of a campaign were made.

    Args:
        campaign: gives the conditions of the runs and the known values of the uncertain parameters.
        machine: the machine to simulate, before the conditions of the runs are set.
        unknowns: parameters of the machine or the instruments; their coordinates are the arguments of the prediction.
        runs: the runs to predict; all methods refer to them by index.
        instruments: measurement chains by signal.
        signals: names of the signals to predict; the measured ones by default.
        replay: the input that drives the machine.

    Raises:
        ParameterError: the machine lacks an unknown or a condition, or the runs set a parameter that is unknown but not
            listed as uncertain in the campaign.
        CampaignError: a run cannot be driven by the input that `replay` names.
    """

    def __init__(
        self, campaign: Campaign, machine: Rig, unknowns: Sequence[UnknownParameter], runs: Sequence[BenchRun],
        instruments: Instruments = Instruments(), signals: Sequence[str] | None = None,
        replay: Replay = Replay.SET_POINT,
    ):  # fmt: skip
        self.campaign, self.machine, self.runs = campaign, machine, tuple(runs)
        self.unknowns, self.instruments = tuple(unknowns), instruments
        self.signals = tuple(campaign.channels) if signals is None else tuple(signals)
        machines = [machine_with_replay(campaign, run, machine, replay) for run in self.runs]
        self._is_of_machine = [instruments.find(u.name) is None for u in self.unknowns]
        conditions = {n for run in self.runs for n in run.conditions if has_parameter(machines[0], n)}
        varied = {u.name for u, of_machine in zip(self.unknowns, self._is_of_machine, strict=True) if of_machine}
        for name in sorted(varied & conditions - set(campaign.uncertain)):
            raise ParameterError(f"{name}: is set by the runs, so it cannot be sought; name it as uncertain")
        self._lane_parameters = tuple(sorted(varied | conditions)) or (placeholder_parameter(machine),)
        self._nominal = {n: float(get_parameter(machine, n)) for n in varied}
        self._run_values = [{n: float(get_parameter(m, n)) for n in self._lane_parameters} for m in machines]
        self._step_times = [_step_times(m) for m in machines]
        self._groups = _group_runs(self.runs, machines)

    def min_steps_per_sample(self) -> int:
        """The smallest number of time steps per sample that keeps to the integrator's largest step in every run."""
        return max(1, math.ceil(self.longest_interval() / self.machine.largest_step() - 1e-9))

    def longest_interval(self) -> float:
        """The longest sample interval of the runs [s]."""
        return max(group.interval for group in self._groups)

    def predict_all_runs(
        self, x: np.ndarray, steps_per_sample: int, with_sensitivities: bool = False
    ) -> dict[int, PredictedSignals]:
        """Predict every run at one point.

        Args:
            x: coordinates of the unknowns (unknowns,).
            steps_per_sample: time steps from sample to sample.
            with_sensitivities: whether to compute the derivatives with respect to the coordinates as well.

        Returns:
            The signals by index of the run, at the time stamps of the measurements; NaN where the simulation failed.
        """
        return self.predict([EvaluationPoint(x, tuple(range(len(self.runs))))], steps_per_sample, with_sensitivities)[0]

    def predict(
        self, points: Sequence[EvaluationPoint], steps_per_sample: int, with_sensitivities: bool
    ) -> list[dict[int, PredictedSignals]]:
        """Predict the runs of several points in common batches.

        Args:
            points: coordinates of the unknowns, each with the runs to predict there.
            steps_per_sample: time steps from sample to sample.
            with_sensitivities: whether to compute the derivatives with respect to the coordinates as well.

        Returns:
            For each point its runs by index, at the time stamps of the measurements; NaN where the simulation failed.
        """
        results: list[dict[int, PredictedSignals]] = [{} for _ in points]
        for group in self._groups:
            jobs = [(p, r) for p, point in enumerate(points) for r in point.runs if r in group.runs]
            if not jobs:
                continue
            # with sensitivities every run has one lane per unknown, each carrying the tangent of that unknown
            lanes_per_job = len(self.unknowns) if with_sensitivities else 1
            lane_rows = [self._lane(points[p].x, r) for p, r in jobs]
            columns = {
                n: np.repeat([values[n] for values, _ in lane_rows], lanes_per_job) for n in self._lane_parameters
            }
            tangents = None
            if with_sensitivities:
                tangents = {n: np.zeros(len(jobs) * lanes_per_job) for n in self._lane_parameters}
                for j, u in enumerate(self.unknowns):
                    if self._is_of_machine[j]:
                        tangents[u.name][j::lanes_per_job] = [derivatives[j] for _, derivatives in lane_rows]
            points_per_sample = group.points_per_sample(steps_per_sample)
            grid_interval = group.interval / points_per_sample
            counts = [points_per_sample * (self._sample_count(r, group) - 1) + 1 for _, r in jobs]
            sample_counts = np.repeat(counts, lanes_per_job)
            grid = grid_interval * np.arange(sample_counts.max())
            traces = simulate_batch(
                group.machine, columns, tangents, group.interval / steps_per_sample,
                steps_per_sample // points_per_sample, sample_counts, self.signals,
            )  # fmt: skip
            for k, (p, r) in enumerate(jobs):
                lanes = slice(k * lanes_per_job, (k + 1) * lanes_per_job)
                n = sample_counts[k * lanes_per_job]
                values = {s: trace[:n, k * lanes_per_job] for s, trace in traces.values.items()}
                slopes = {s: trace[:n, lanes] for s, trace in traces.slopes.items()} if with_sensitivities else None
                values, slopes = self.instruments.record(grid[:n], values, slopes, self.unknowns, points[p].x)
                values = {s: self._at_time_stamps(r, grid_interval, v) for s, v in values.items()}
                inside = {s: self._within_limits(s, v) for s, v in values.items()}
                if with_sensitivities:
                    slopes = {s: self._at_time_stamps(r, grid_interval, v) for s, v in slopes.items()}
                    slopes = {s: v if inside[s] is None else v * inside[s][1][:, None] for s, v in slopes.items()}
                values = {s: v if inside[s] is None else inside[s][0] for s, v in values.items()}
                results[p][r] = PredictedSignals(values, slopes)
        return results

    def _lane(self, x: np.ndarray, r: int) -> tuple[dict[str, float], list[float]]:
        """The parameter values of run `r` at `x`, and the derivative of each unknown's value by its coordinate."""
        values, derivatives = dict(self._run_values[r]), []
        for u, of_machine, coordinate in zip(self.unknowns, self._is_of_machine, x, strict=True):
            if not of_machine:
                derivatives.append(0.0)
                continue
            # where the run sets the parameter itself, the unknown is a factor common to all runs
            factor = values[u.name] / nominal if (nominal := self._nominal[u.name]) else 1.0
            values[u.name], derivative = u.value(coordinate) * factor, u.derivative(coordinate) * factor
            derivatives.append(float(derivative))
        return values, derivatives

    def _within_limits(self, signal: str, values: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """What a sensor that ends at its limits shows, and where it still moves (1 or 0); None for one without."""
        channel = self.campaign.channels.get(signal)
        if channel is None or not any(map(math.isfinite, channel.limits)):
            return None
        shown = np.clip(values, *channel.limits)
        return shown, (shown == values).astype(float)

    def _sample_count(self, r: int, group: _RunGroup) -> int:
        return math.ceil(self.runs[r].time[-1] / group.interval - MAX_TIMESTAMP_ERROR) + 1

    def _at_time_stamps(self, r: int, interval: float, rows: np.ndarray) -> np.ndarray:
        """Rows (points, …) on a grid of an interval [s], at the time stamps of run `r`; a cubic spline between.

        Where drives step, a cubic through the points between two steps.
        """
        time, steps = self.runs[r].time, self._step_times[r]
        if (indices := _grid_indices(time, interval)) is not None:
            is_whole_grid = np.array_equal(indices, np.arange(len(indices)))
            return rows[: len(indices)] if is_whole_grid else rows[indices]
        if not np.isfinite(rows).all():
            return np.full((len(time), *rows.shape[1:]), np.nan)
        if not len(steps):
            return CubicSpline(interval * np.arange(len(rows)), rows)(time)
        at, steps = time / interval, steps / interval - MAX_TIMESTAMP_ERROR
        ends, part = np.array([0, *np.ceil(steps), len(rows)], int), np.searchsorted(steps, at)
        # four points of the part; of its neighbours too where it has fewer
        first = np.minimum(np.maximum(np.floor(at) - 1.0, ends[part]), np.maximum(ends[part + 1] - 4, ends[part]))
        first = np.clip(first, 0, len(rows) - 4).astype(int)
        found = 0.0
        for j in range(4):
            weights = np.prod([(at - first - m) / (j - m) for m in range(4) if m != j], axis=0)
            found = found + weights.reshape(-1, *[1] * (rows.ndim - 1)) * rows[first + j]
        return found


def placeholder_parameter(machine: Rig) -> str:
    """A parameter of the machine: a batch needs at least one that varies between its lanes."""
    names = short_names(machine)
    return next((n for n in names.values() if n == "force_constant"), None) or next(iter(names.values()))


def _grid_indices(time: np.ndarray, interval: float) -> np.ndarray | None:
    """Time stamps as multiples of an interval [s]; None where one of them is not a multiple."""
    indices = np.round(time / interval)
    return indices.astype(int) if np.abs(time / interval - indices).max() <= MAX_TIMESTAMP_ERROR else None


def _step_times(machine: Rig) -> np.ndarray:
    """The times [s] at which the recorded drives of a machine step."""
    parts = jax.tree.leaves(machine, is_leaf=lambda part: isinstance(part, Steps))
    return np.unique(np.concatenate([[], *(part.times for part in parts if isinstance(part, Steps))]))


def _group_runs(runs: Sequence[BenchRun], machines: Sequence[Rig]) -> list[_RunGroup]:
    groups: dict[tuple, list[int]] = {}
    for r, (run, machine) in enumerate(zip(runs, machines, strict=True)):
        # a recorded set point is an array of its own, so its run cannot share a batch
        has_recording = any(np.ndim(leaf) for leaf in jax.tree.leaves(machine))
        interval = float(f"{run.interval:.6g}")
        is_finer = _grid_indices(run.time, interval) is None
        groups.setdefault((interval, is_finer, r if has_recording else -1), []).append(r)
    return [
        _RunGroup(machines[members[0]], interval, is_finer, tuple(members))
        for (interval, is_finer, _), members in groups.items()
    ]
