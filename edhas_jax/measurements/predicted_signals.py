"""What a model says the sensors of a campaign would have read, and how far that is from what they read."""


import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import jax
import numpy as np
from scipy.interpolate import CubicSpline

from edhas_jax.machine.parameters import ParameterError, get_parameter
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import BenchRun, Campaign, Use
from edhas_jax.measurements.measurement_chain import Instruments
from edhas_jax.measurements.prior import Unknown
from edhas_jax.measurements.replay import Replay, has_parameter, mount
from edhas_jax.simulation.batch_trajectories import march_lanes
from edhas_jax.simulation.integrator import LARGEST_STEP

OVERALL = "overall"
EVERYWHERE = "force_constant"  # a parameter of every rig: lanes need one that may vary
EVEN = 1e-4  # share of the interval by which time stamps may be off and still count as even


class Case(NamedTuple):
    """Values to try: coordinates of the unknowns (n,), and the runs (by index) that are wanted with them."""

    x: np.ndarray
    runs: tuple[int, ...]


class Outcome(NamedTuple):
    """Signals (samples,) of one run by name, SI, and their derivatives (samples, unknowns) by the coordinates."""

    values: dict[str, np.ndarray]
    slopes: dict[str, np.ndarray] | None


@dataclasses.dataclass(frozen=True)
class _Group:
    """Runs that one program marches: the same sampling and the same set point, numbers apart."""

    machine: Rig
    interval: float
    runs: tuple[int, ...]


class Model:
    """A machine with unknown parameters, and its sensors, under runs of a campaign.

    `watch` names the signals that are wanted, those measured by default; `replay` says what drives the machine.

    Raises:
        ParameterError: an unknown or a condition that the machine does not have, or an unknown that runs set.
    """

    def __init__(
        self, campaign: Campaign, machine: Rig, unknowns: Sequence[Unknown], runs: Sequence[BenchRun],
        instruments: Instruments = Instruments(), watch: Sequence[str] | None = None,
        replay: Replay = Replay.SET_POINT,
    ):  # fmt: skip
        self.campaign, self.machine, self.runs = campaign, machine, tuple(runs)
        self.unknowns, self.instruments = tuple(unknowns), instruments
        self.watch = tuple(campaign.channels) if watch is None else tuple(watch)
        mounted = [mount(campaign, run, machine, replay) for run in self.runs]
        self._own = [instruments.find(u.name) is None for u in self.unknowns]
        conditions = {n for run in self.runs for n in run.conditions if has_parameter(mounted[0], n)}
        varied = {u.name for u, own in zip(self.unknowns, self._own, strict=True) if own}
        for name in sorted(varied & conditions - set(campaign.uncertain)):
            raise ParameterError(f"{name}: is set by the runs, so it cannot be sought; name it as uncertain")
        self._names = tuple(sorted(varied | conditions)) or (EVERYWHERE,)
        self._nominal = {n: float(get_parameter(machine, n)) for n in varied}
        self._base = [{n: float(get_parameter(m, n)) for n in self._names} for m in mounted]
        self._groups = _groups(self.runs, mounted)

    def coarsest(self) -> int:
        """The fewest steps from sample to sample that the largest step allows, for the slowest sampling."""
        return max(1, math.ceil(self.longest_interval() / LARGEST_STEP - 1e-9))

    def longest_interval(self) -> float:
        """The time from sample to sample [s] of the slowest sampling."""
        return max(group.interval for group in self._groups)

    def outcomes(self, cases: Sequence[Case], per_sample: int, derive: bool) -> list[dict[int, Outcome]]:
        """For each case its runs, with `per_sample` steps from sample to sample; `derive` asks for the slopes."""
        out: list[dict[int, Outcome]] = [{} for _ in cases]
        for group in self._groups:
            jobs = [(c, r) for c, case in enumerate(cases) for r in case.runs if r in group.runs]
            if not jobs:
                continue
            many = len(self.unknowns) if derive else 1
            table = [self._lane(cases[c].x, r) for c, r in jobs]
            columns = {n: np.repeat([values[n] for values, _ in table], many) for n in self._names}
            seeds = {n: np.zeros(len(jobs) * many) for n in self._names} if derive else None
            if derive:
                for j, u in enumerate(self.unknowns):
                    if self._own[j]:
                        seeds[u.name][j::many] = [slopes[j] for _, slopes in table]
            counts = np.repeat([self._samples(r, group) for _, r in jobs], many)
            h = group.interval / per_sample
            grid = group.interval * np.arange(counts.max())
            traces = march_lanes(group.machine, columns, seeds, h, per_sample, counts, self.watch)
            for k, (c, r) in enumerate(jobs):
                lanes = slice(k * many, (k + 1) * many)
                n = counts[k * many]
                values = {s: column[:n, k * many] for s, column in traces.values.items()}
                slopes = {s: column[:n, lanes] for s, column in traces.slopes.items()} if derive else None
                values, slopes = self.instruments.record(grid[:n], values, slopes, self.unknowns, cases[c].x)
                values = {s: self._measured(r, group, v) for s, v in values.items()}
                slopes = {s: self._measured(r, group, v) for s, v in slopes.items()} if derive else None
                out[c][r] = Outcome(values, slopes)
        return out

    def _lane(self, x: np.ndarray, r: int) -> tuple[dict[str, float], list[float]]:
        """The parameters of run `r` at `x`, and the derivative of each unknown's own parameter there."""
        values, slopes = dict(self._base[r]), []
        for u, own, coordinate in zip(self.unknowns, self._own, x, strict=True):
            if not own:
                slopes.append(0.0)
                continue
            # where the run sets the parameter itself, the unknown is a common factor on what it sets
            factor = values[u.name] / nominal if (nominal := self._nominal[u.name]) else 1.0
            values[u.name], slope = u.value(coordinate) * factor, u.slope(coordinate) * factor
            slopes.append(float(slope))
        return values, slopes

    def _samples(self, r: int, group: _Group) -> int:
        return math.ceil(self.runs[r].time[-1] / group.interval - EVEN) + 1

    def _measured(self, r: int, group: _Group, rows: np.ndarray) -> np.ndarray:
        """What was sampled evenly, at the instants of the measurements."""
        time, interval = self.runs[r].time, group.interval
        at = np.round(time / interval)
        if np.abs(time / interval - at).max() <= EVEN:
            return rows[at.astype(int)]
        if not np.isfinite(rows).all():
            return np.full((len(time), *rows.shape[1:]), np.nan)
        return CubicSpline(interval * np.arange(len(rows)), rows)(time)


def _groups(runs: Sequence[BenchRun], mounted: Sequence[Rig]) -> list[_Group]:
    groups: dict[tuple, list[int]] = {}
    for r, (run, machine) in enumerate(zip(runs, mounted, strict=True)):
        recorded = any(np.ndim(leaf) for leaf in jax.tree.leaves(machine))
        groups.setdefault((float(f"{run.interval:.6g}"), r if recorded else -1), []).append(r)
    return [_Group(mounted[found[0]], interval, tuple(found)) for (interval, _), found in groups.items()]


def whitened(campaign: Campaign, run: BenchRun, outcome: Outcome) -> dict[str, np.ndarray]:
    """(measured − model)/noise (n,) by signal; NaN where a sample is missing."""
    return {
        n: (values - outcome.values[n]) / campaign.channels[n].noise
        for n, values in run.signals.items()
        if n in outcome.values
    }


def level(residuals: Iterable[np.ndarray]) -> float:
    """The rms of residuals in units of their noise over all samples that were measured; inf if the model failed."""
    square, count = 0.0, 0
    for values in residuals:
        square += float(np.nansum(np.square(values)))
        count += int(np.isfinite(values).sum())
    return math.sqrt(square / count) if count else math.inf


def levels(campaign: Campaign, residuals: Mapping[str, Mapping[str, np.ndarray]], use: Use) -> dict[str, float]:
    """Residual over noise of the runs of one use, overall and by signal, from `residuals` by run and signal."""
    chosen = [residuals[run.name] for run in campaign.runs_for(use) if run.name in residuals]
    names = dict.fromkeys(n for signals in chosen for n in signals)
    out = {OVERALL: level(v for signals in chosen for v in signals.values())} if chosen else {}
    return out | {n: level(signals[n] for signals in chosen if n in signals) for n in names}
