"""A sizing task as a problem in numbers: objective and constraints of many designs at once, with their derivatives."""

import dataclasses
import itertools
from collections.abc import Mapping

import numpy as np

from edhas_jax.design.batch.cycle import Status
from edhas_jax.design.batch.experiment_design import designs_at
from edhas_jax.design.gradient.fixed_point import GradientSettings
from edhas_jax.design.gradient.forward import forward
from edhas_jax.design.sizing.config import Limit, Robust, Sizing, Tolerance
from edhas_jax.machine.parameters import get_parameter, set_parameters

# a supply that no design reaches: where it would clip, the real one is a constraint, whose derivative then exists
UNREACHED = 20.0
SHARPNESS = 60.0  # of the smooth minimum that stands for the worst case
FAILED = (Status.STALLED, Status.OUT_OF_RANGE, Status.NOT_FINITE)


@dataclasses.dataclass(frozen=True)
class Judged:
    """Designs with their objectives (to be made large) and constraints (to be kept ≤ 0).

    `objective` (n,), `slope` (n, d), `excess` (n, m), `excess_slope` (n, m, d); derivatives are by the shares (0 … 1)
    of the free dimensions. `goals` (n, k) are the single metrics of the objective, as logarithms, `goal_slopes`
    (n, k, d) theirs. A design that fails has NaN everywhere. `values` by metric: (n, cases).
    """

    objective: np.ndarray
    slope: np.ndarray
    excess: np.ndarray
    excess_slope: np.ndarray
    goals: np.ndarray
    goal_slopes: np.ndarray
    values: Mapping[str, np.ndarray]

    @property
    def violation(self) -> np.ndarray:
        """The largest excess over a limit, as a share of it; infinite for a design that fails."""
        most = self.excess.max(axis=1) if self.excess.shape[1] else np.zeros(len(self.objective))
        return np.where(np.isfinite(self.objective), np.maximum(most, 0.0), np.inf)


class Problem:
    """The designs of a task, judged at its operating points, and with its tolerances.

    `cases` are operating points × corners of the tolerances. `limits` are those of the task, and that the voltage is
    not clipped. `machine_seconds` counts the simulated time of everything that was judged.
    """

    def __init__(self, task: Sizing, steps_per_cycle: int):
        self.task = task
        self.names = [axis.name for axis in task.free]
        self.steps_per_cycle = steps_per_cycle
        self.machine_seconds = 0.0
        self.supply = float(get_parameter(task.machine, "supply_voltage"))
        self._machine = set_parameters(task.machine, {"supply_voltage": min(UNREACHED * self.supply, 1e4)})
        self.limits = (*task.limits, Limit("peak_voltage", True, self.supply * (1.0 - 1e-3)))
        points = task.operating_points()
        count = len(next(iter(points.values()))) if points else 1
        corners = list(itertools.product((0.0, 1.0), repeat=len(task.tolerances))) if task.tolerances else []
        self.corners = [None, *corners]
        self.cases = [({n: v[k] for n, v in points.items()}, c) for k in range(count) for c in self.corners]
        self._metrics = list(dict.fromkeys([*task.weights, *(limit.metric for limit in self.limits)]))

    def start(self) -> np.ndarray:
        """The shares of the machine as it stands."""
        return np.array([a.fraction_of(float(get_parameter(self.task.machine, a.name))) for a in self.task.free])

    def values(self, shares: np.ndarray) -> dict[str, np.ndarray]:
        """The free dimensions (SI) at shares (n, d)."""
        return designs_at(self.task.free, shares)

    def judge(self, shares: np.ndarray, weights: np.ndarray | None = None) -> Judged:
        """Designs at shares (n, d); `weights` (n, k) of the goals, by default those of the task for every design."""
        n, cases = len(shares), len(self.cases)
        free = self.values(shares)
        scale = np.stack([axis.derivative_at(free[axis.name]) for axis in self.task.free], axis=1)
        columns, factor = self._columns(free, n)
        settings = GradientSettings(self.steps_per_cycle, 2e-3, 12)
        found = forward(self._machine, columns, self.names, self._metrics, settings)
        frequency = columns.get("frequency", get_parameter(self._machine, "frequency"))
        marched = found.cycles + found.terms * len(self.names)
        self.machine_seconds += float(np.sum(marched / np.broadcast_to(frequency, n * cases)))
        failed = np.isin(found.status, FAILED).reshape(n, cases).any(axis=1)
        metrics = {m: found.values[m].reshape(n, cases) for m in self._metrics}
        slopes = {
            m: found.slopes[m].reshape(n, cases, -1) * factor[None] * scale[:, None, :] for m in self._metrics
        }
        goals, goal_slopes = self._goals(metrics, slopes)
        if weights is None:
            weights = np.tile(list(self.task.weights.values()), (n, 1))
        objective = (weights * goals).sum(axis=1)
        slope = (weights[:, :, None] * goal_slopes).sum(axis=1)
        excess, excess_slope = [], []
        for limit in self.limits:
            sign, size = (1.0 if limit.upper else -1.0), abs(limit.value) or 1.0
            excess.append(sign * (metrics[limit.metric] - limit.value) / size)
            excess_slope.append(sign * slopes[limit.metric] / size)
        excess, excess_slope = np.concatenate(excess, axis=1), np.concatenate(excess_slope, axis=1)
        bad = failed | ~np.isfinite(objective) | ~np.isfinite(slope).all(axis=1)
        bad |= ~np.isfinite(excess).all(axis=1) | ~np.isfinite(excess_slope).all(axis=(1, 2))
        for array in (objective, slope, excess, excess_slope, goals, goal_slopes):
            array[bad] = np.nan
        return Judged(objective, slope, excess, excess_slope, goals, goal_slopes, metrics)

    def _columns(self, free: dict[str, np.ndarray], n: int) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """The columns (SI) of designs × cases, and d(column)/d(design's value), (cases, d)."""
        names = dict.fromkeys([*self.names, *self.cases[0][0], *(t.name for t in self.task.tolerances)])
        columns = {name: np.empty((n, len(self.cases))) for name in names}
        factor = np.ones((len(self.cases), len(self.names)))
        for k, (point, corner) in enumerate(self.cases):
            for name in names:
                value = free.get(name, point.get(name))
                columns[name][:, k] = get_parameter(self._machine, name) if value is None else value
            for tolerance, share in zip(self.task.tolerances, corner or (), strict=False):
                columns[tolerance.name][:, k] = tolerance.applied(columns[tolerance.name][:, k], share)
                if tolerance.name in self.names:
                    factor[k, self.names.index(tolerance.name)] = tolerance.slope(share)
        return {name: column.ravel() for name, column in columns.items()}, factor

    def _goals(self, metrics, slopes):
        """The goals as mean logarithms over the points, and over corners their mean or smooth worst case."""
        goals, goal_slopes = [], []
        for metric, weight in self.task.weights.items():
            value = metrics[metric]
            with np.errstate(divide="ignore", invalid="ignore"):
                logs = np.log(value)
                log_slopes = slopes[metric] / value[:, :, None]
            shape = (len(value), -1, len(self.corners))
            logs, log_slopes = logs.reshape(shape), log_slopes.reshape(*shape, log_slopes.shape[-1])
            if self.task.robust is Robust.WORST_CASE:
                # the metric's bad end is low where it is to be large, and high where it is to be small
                sign = -np.sign(weight)
                level = (sign * logs).max(axis=2, keepdims=True)
                part = np.exp(SHARPNESS * (sign * logs - level))
                share = part / part.sum(axis=2, keepdims=True)
            else:
                share = np.full(logs.shape, 1.0 / logs.shape[2])
            goals.append((share * logs).sum(axis=2).mean(axis=1))
            if self.task.robust is Robust.WORST_CASE:
                # derivative of the smooth extremum Σ wᵢ xᵢ, w its own soft weights
                around = logs - (share * logs).sum(axis=2, keepdims=True)
                share = share * (1.0 + SHARPNESS * sign * around)
            goal_slopes.append((share[..., None] * log_slopes).sum(axis=2).mean(axis=1))
        return np.stack(goals, axis=1), np.stack(goal_slopes, axis=1)


__all__ = ["Judged", "Problem", "Tolerance"]
