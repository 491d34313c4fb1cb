"""Predict the measured signals of a campaign, and their sensitivities, from a machine with unknown parameters."""

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np

from edhas_jax.machine.components.set_points import Steps
from edhas_jax.machine.parameters import ParameterError, get_parameter, has_parameter, short_names
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import BenchRun, Campaign
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.replay import Replay, machine_with_replay
from edhas_jax.measurements.unknown_parameters import ShapeCoefficient, UnknownParameter
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

    Of the parts of a run only the one with the highest sampling rate is simulated, for all of them. Runs with
    irregular time stamps are interpolated from a grid that is finer than the sample interval (`is_finer`).
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
            uncertain in the campaign.
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
        of_machine = [u for u, is_of_machine in zip(self.unknowns, self._is_of_machine, strict=True) if is_of_machine]
        varied = {name for u in of_machine for name in u.parameters}
        for name in sorted({u.name for u in of_machine if not u.run} & conditions - set(campaign.uncertain)):
            raise ParameterError(f"{name}: is set by the runs, so it cannot be sought; name it as uncertain")
        self._acting = [[j for j, u in enumerate(self.unknowns) if self._acts(j, u, run)] for run in self.runs]
        self._lane_parameters = tuple(sorted(varied | conditions)) or (placeholder_parameter(machine),)
        self._nominal = {n: float(get_parameter(machine, n)) for n in varied}
        self._run_values = [{n: float(get_parameter(m, n)) for n in self._lane_parameters} for m in machines]
        self._step_times = [_step_times(m) for m in machines]
        self._hosts = _hosts(self.runs) if replay is Replay.SET_POINT else list(range(len(self.runs)))
        self._groups = _group_runs(self.runs, machines, self._hosts)

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
            members: dict[tuple[int, int], list[int]] = {}  # runs by point and the run that is simulated for them
            for p, point in enumerate(points):
                for r in (r for r in point.runs if self._hosts[r] in group.runs):
                    members.setdefault((p, self._hosts[r]), []).append(r)
            if not members:
                continue
            jobs = list(members)
            # with sensitivities a run has one lane for each unknown that acts in it, carrying its tangent
            lanes = [max(len(self._acting[r]), 1) if with_sensitivities else 1 for _, r in jobs]
            firsts = np.cumsum([0, *lanes])
            lane_rows = [self._lane(points[p].x, r) for p, r in jobs]
            columns = {n: np.repeat([values[n] for values, _ in lane_rows], lanes) for n in self._lane_parameters}
            tangents = None
            if with_sensitivities:
                tangents = {n: np.zeros(firsts[-1]) for n in self._lane_parameters}
                for (_, r), first, (_, derivatives) in zip(jobs, firsts, lane_rows, strict=False):
                    for lane, j in enumerate(self._acting[r], first):
                        if self._is_of_machine[j]:
                            for name, slope in derivatives[j].items():
                                tangents[name][lane] = slope
            points_per_sample = group.points_per_sample(steps_per_sample)
            grid_interval = group.interval / points_per_sample
            samples = (max(self._sample_count(r, group) for r in of) for of in members.values())
            counts = [points_per_sample * (count - 1) + 1 for count in samples]
            sample_counts = np.repeat(counts, lanes)
            grid = grid_interval * np.arange(sample_counts.max())
            traces = simulate_batch(
                group.machine, columns, tangents, group.interval / steps_per_sample,
                steps_per_sample // points_per_sample, sample_counts, self.signals,
            )  # fmt: skip
            for k, (p, r) in enumerate(jobs):
                n, slopes = counts[k], None
                values = {s: trace[:n, firsts[k]] for s, trace in traces.values.items()}
                if with_sensitivities:
                    slopes = {s: self._slopes(trace[:n], firsts[k], r) for s, trace in traces.slopes.items()}
                values, slopes = self.instruments.record(grid[:n], values, slopes, self.unknowns, points[p].x)
                for member in members[p, r]:
                    results[p][member] = self._at_samples(member, grid_interval, values, slopes)
        return results

    def _at_samples(
        self, r: int, interval: float, values: dict[str, np.ndarray], slopes: dict[str, np.ndarray] | None
    ) -> PredictedSignals:
        """Signals and sensitivities on a grid of an interval [s], at the time stamps of run `r`."""
        values = {s: self._at_time_stamps(r, interval, v) for s, v in values.items()}
        if slopes is not None:
            slopes = {s: self._at_time_stamps(r, interval, v) for s, v in slopes.items()}
        for signal, channel in self.campaign.channels.items():
            if signal in values and any(map(math.isfinite, channel.limits)):  # beyond which the sensor shows its end
                exact, values[signal] = values[signal], np.clip(values[signal], *channel.limits)
                if slopes is not None:
                    slopes[signal] = slopes[signal] * (values[signal] == exact)[:, None]
        return PredictedSignals(values, slopes)

    def acting(self, r: int) -> np.ndarray:
        """Which unknowns act in run `r` (unknowns,): all but the own ones of other runs, and those that it replaces."""
        return np.isin(np.arange(len(self.unknowns)), self._acting[r])

    def _acts(self, j: int, u: UnknownParameter, run: BenchRun) -> bool:
        return u.run == run.whole if u.run else not (self._is_of_machine[j] and u.name in run.uncertain)

    def _slopes(self, lanes: np.ndarray, first: int, r: int) -> np.ndarray:
        """The sensitivities (points, unknowns) of run `r` from the lanes (points, lanes) that begin at `first`."""
        acting = self._acting[r]
        if len(acting) == len(self.unknowns):
            return lanes[:, first : first + len(acting)]
        slopes = np.zeros((len(lanes), len(self.unknowns)))
        slopes[:, acting] = lanes[:, first : first + len(acting)]
        return slopes

    def _lane(self, x: np.ndarray, r: int) -> tuple[dict[str, float], dict[int, dict[str, float]]]:
        """The parameter values of run `r` at `x`, and by unknown the derivatives of these by its coordinate."""
        values, derivatives = dict(self._run_values[r]), {}
        for j in (j for j in self._acting[r] if self._is_of_machine[j]):
            u = self.unknowns[j]
            if isinstance(u, ShapeCoefficient):
                derivatives[j] = dict(u.weights)
                values |= u.added_to(values, float(x[j]))
            else:
                derivatives[j] = {u.parameter: float(u.derivative(x[j])) * self._in_run(r, u)[0]}
                values[u.parameter] = self.run_value(r, u, x[j])
        return values, derivatives

    def run_value(self, r: int, u: UnknownParameter, x: float) -> float:
        """The value (SI) in run `r` of an unknown of the machine that acts there, at coordinate `x`."""
        factor, difference = self._in_run(r, u)
        return float(u.value(x)) * factor + difference

    def _in_run(self, r: int, u: UnknownParameter) -> tuple[float, float]:
        """Factor and difference (SI) between an unknown and the value in run `r`, as of `Spread.carried_over`."""
        given, known, spread = self._run_values[r][u.parameter], self._nominal[u.parameter], self.campaign.uncertain
        if u.run:
            return 1.0, 0.0
        is_absolute = u.name in spread and spread[u.name].is_absolute
        return (1.0, given - known) if is_absolute or known == 0.0 else (given / known, 0.0)

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
            from scipy.interpolate import CubicSpline  # slow to load, and most records need none

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


def _hosts(runs: Sequence[BenchRun]) -> list[int]:
    """For each run the index of the one that is simulated for it: the fastest of the parts of the same run."""
    keys = [(run.whole, id(run.drives), id(run.reference), *sorted(run.conditions.items())) for run in runs]
    fastest: dict[tuple, int] = {}
    for r, key in enumerate(keys):
        if key not in fastest or runs[r].interval < runs[fastest[key]].interval:
            fastest[key] = r
    return [fastest[key] for key in keys]


def _group_runs(runs: Sequence[BenchRun], machines: Sequence[Rig], hosts: Sequence[int]) -> list[_RunGroup]:
    groups: dict[tuple, list[int]] = {}
    for r in dict.fromkeys(hosts):
        run, machine = runs[r], machines[r]
        members = [member for member, host in zip(runs, hosts, strict=True) if host == r]
        # a recorded set point is an array of its own, so its run cannot share a batch
        has_recording = any(np.ndim(leaf) for leaf in jax.tree.leaves(machine))
        interval = float(f"{run.interval:.6g}")
        is_finer = any(_grid_indices(member.time, interval) is None for member in members)
        groups.setdefault((interval, is_finer, r if has_recording else -1), []).append(r)
    return [
        _RunGroup(machines[members[0]], interval, is_finer, tuple(members))
        for (interval, is_finer, _), members in groups.items()
    ]
