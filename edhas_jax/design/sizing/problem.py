"""Sizing as a nonlinear programme: objective, constraints and their gradients for many designs at once."""

import dataclasses
import itertools
import math
from collections.abc import Mapping

import numpy as np

from edhas_jax.design.batch.experiment_design import designs_at
from edhas_jax.design.gradient.fixed_point import Derivatives, GradientSettings
from edhas_jax.design.gradient.forward import forward
from edhas_jax.design.sizing.config import Constraint, RobustObjective, SizingTask
from edhas_jax.machine.parameters import get_parameter, set_parameters
from edhas_jax.simulation.validity import Status

# the simulated supply voltage is raised by this factor so that it never saturates, up to the maximum; the real one
# becomes a constraint, which is differentiable
SUPPLY_FACTOR, MAX_SUPPLY_VOLTAGE = 20.0, 1e4
SUPPLY_MARGIN = 1e-3  # share of the supply voltage that the peak voltage must stay below it
CYCLE_TOLERANCE, MAX_CYCLES = 2e-3, 12  # of the periodic state of a design
SOFT_EXTREMUM_SHARPNESS = 60.0  # of the smooth minimum that approximates the worst case
FAILED_STATUSES = (Status.STALLED, *(status for status in Status if not status.is_valid))


@dataclasses.dataclass(frozen=True)
class DesignEvaluation:
    """Objective and constraints of n designs in d variables; everything is NaN for a design that fails.

    Gradients are by the fractions 0 … 1 of the ranges of the design variables.

    Attributes:
        objective: J, to be maximised, shape (n,).
        gradient: of J, shape (n, d).
        constraints: g, relative to the limits and feasible where ≤ 0, shape (n, m) for m constraints × cases.
        constraint_gradients: of g, shape (n, m, d).
        goals: logarithms of the k metrics of the objective, averaged over the cases, shape (n, k).
        goal_gradients: of the goals, shape (n, k, d).
        values: by metric its value (SI), shape (n, cases).
        status: how the run of each case ended, an integer of `Status`, shape (n, cases).
    """

    objective: np.ndarray
    gradient: np.ndarray
    constraints: np.ndarray
    constraint_gradients: np.ndarray
    goals: np.ndarray
    goal_gradients: np.ndarray
    values: Mapping[str, np.ndarray]
    status: np.ndarray

    @property
    def violation(self) -> np.ndarray:
        """The largest constraint violation relative to its limit, shape (n,); infinite for a design that fails."""
        largest = self.constraints.max(axis=1) if self.constraints.shape[1] else np.zeros(len(self.objective))
        return np.where(np.isfinite(self.objective), np.maximum(largest, 0.0), np.inf)


class SizingProblem:
    """Evaluates the designs of a task at its operating points and at the corners of its tolerances.

    Attributes:
        task: the task.
        names: names of the d design variables.
        steps_per_cycle: integration steps per cycle.
        supply: supply voltage of the machine, V.
        constraints: those of the task, and that the voltage does not saturate.
        corners: ends of the tolerances (0 or 1 each); None stands for the nominal machine.
        cases: operating point and corner of each case.
        machine_seconds: simulated time of all evaluations, s; each derivative counts as a run.
    """

    def __init__(self, task: SizingTask, steps_per_cycle: int):
        self.task = task
        self.names = [axis.name for axis in task.variables]
        self.steps_per_cycle = steps_per_cycle
        self.machine_seconds = 0.0
        self.supply, self._machine, self.constraints = math.inf, task.machine, task.constraints
        if task.machine.cycle is not None:
            self._raise_supply()
        points = task.operating_points()
        count = len(next(iter(points.values()))) if points else 1
        corners = list(itertools.product((0.0, 1.0), repeat=len(task.tolerances))) if task.tolerances else []
        self.corners = [None, *corners]
        self.cases = [({n: v[k] for n, v in points.items()}, c) for k in range(count) for c in self.corners]
        metrics = [*task.weights, *(constraint.metric for constraint in self.constraints)]
        self._metrics = list(dict.fromkeys(metrics))

    def _raise_supply(self) -> None:
        """Simulate with a supply that never saturates, and make the real one a constraint."""
        self.supply = float(get_parameter(self.task.machine, "supply_voltage"))
        unsaturated = min(SUPPLY_FACTOR * self.supply, MAX_SUPPLY_VOLTAGE)
        self._machine = set_parameters(self.task.machine, {"supply_voltage": unsaturated})
        limit = Constraint("peak_voltage", True, self.supply * (1.0 - SUPPLY_MARGIN), "V", "V")
        self.constraints = (*self.constraints, limit)

    def initial_fractions(self) -> np.ndarray:
        """The design variables of the task's machine as fractions of their ranges, shape (d,)."""
        machine = self.task.machine
        return np.array([a.fraction_of(float(get_parameter(machine, a.name))) for a in self.task.variables])

    def designs(self, fractions: np.ndarray) -> dict[str, np.ndarray]:
        """The design variables (SI) by name, shape (n,), at fractions (n, d) of their ranges."""
        return designs_at(self.task.variables, fractions)

    def evaluate(self, fractions: np.ndarray, weights: np.ndarray | None = None) -> DesignEvaluation:
        """Simulate designs to their periodic states and differentiate them.

        Args:
            fractions: design variables as fractions of their ranges, shape (n, d).
            weights: weights of the goals of each design, shape (n, k); by default those of the task.

        Returns:
            Objective and constraints with their gradients.
        """
        n, cases = len(fractions), len(self.cases)
        variables = self.designs(fractions)
        scale = np.stack([axis.derivative_at(variables[axis.name]) for axis in self.task.variables], axis=1)
        columns, factor = self._columns(variables, n)
        settings = GradientSettings(self.steps_per_cycle, CYCLE_TOLERANCE, MAX_CYCLES, self.task.settings)
        found = forward(self._machine, columns, self.names, self._metrics, settings)
        self._count_time(found, columns, n * cases)
        status = np.asarray(found.status).reshape(n, cases)
        failed = np.isin(status, FAILED_STATUSES).any(axis=1)
        metrics = {m: found.values[m].reshape(n, cases) for m in self._metrics}
        slopes = {m: found.slopes[m].reshape(n, cases, -1) * factor[None] * scale[:, None, :] for m in self._metrics}
        goals, goal_gradients = self._goals(metrics, slopes)
        if weights is None:
            weights = np.tile(list(self.task.weights.values()), (n, 1))
        objective = (weights * goals).sum(axis=1)
        gradient = (weights[:, :, None] * goal_gradients).sum(axis=1)
        constraints, constraint_gradients = [np.zeros((n, 0))], [np.zeros((n, 0, len(self.names)))]
        for constraint in self.constraints:
            sign, size = (1.0 if constraint.upper else -1.0), abs(constraint.value) or 1.0
            constraints.append(sign * (metrics[constraint.metric] - constraint.value) / size)
            constraint_gradients.append(sign * slopes[constraint.metric] / size)
        constraints = np.concatenate(constraints, axis=1)
        constraint_gradients = np.concatenate(constraint_gradients, axis=1)
        failed |= ~np.isfinite(objective) | ~np.isfinite(gradient).all(axis=1)
        failed |= ~np.isfinite(constraints).all(axis=1) | ~np.isfinite(constraint_gradients).all(axis=(1, 2))
        for array in (objective, gradient, constraints, constraint_gradients, goals, goal_gradients):
            array[failed] = np.nan
        return DesignEvaluation(
            objective, gradient, constraints, constraint_gradients, goals, goal_gradients, metrics, status
        )

    def _count_time(self, found: Derivatives, columns: dict[str, np.ndarray], runs: int) -> None:
        """Add the simulated time of some runs; each derivative counts as a run."""
        if self._machine.cycle is None:
            grid = self.task.settings.run_grid(self._machine)
            self.machine_seconds += runs * (1 + len(self.names)) * float(grid.time[-1])
            return
        frequency = columns.get("frequency", get_parameter(self._machine, "frequency"))
        cycles = found.cycles + found.terms * len(self.names)
        self.machine_seconds += float(np.sum(cycles / np.broadcast_to(frequency, runs)))

    def _columns(self, variables: dict[str, np.ndarray], n: int) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """The columns (SI) of designs × cases, and their derivatives by the designs' own values, (cases, d)."""
        names = dict.fromkeys([*self.names, *self.cases[0][0], *(t.name for t in self.task.tolerances)])
        columns = {name: np.empty((n, len(self.cases))) for name in names}
        factor = np.ones((len(self.cases), len(self.names)))
        for k, (point, corner) in enumerate(self.cases):
            for name in names:
                value = variables.get(name, point.get(name))
                columns[name][:, k] = get_parameter(self._machine, name) if value is None else value
            for tolerance, end in zip(self.task.tolerances, corner or (), strict=False):
                columns[tolerance.name][:, k] = tolerance.apply(columns[tolerance.name][:, k], end)
                if tolerance.name in self.names:
                    factor[k, self.names.index(tolerance.name)] = tolerance.derivative(end)
        return {name: column.ravel() for name, column in columns.items()}, factor

    def _goals(self, metrics, slopes):
        """Goals and their gradients: mean logarithm over the operating points of the mean or worst case of corners."""
        goals, goal_gradients = [], []
        for metric, weight in self.task.weights.items():
            value = metrics[metric]
            with np.errstate(divide="ignore", invalid="ignore"):
                logs = np.log(value)
                log_slopes = slopes[metric] / value[:, :, None]
            shape = (len(value), -1, len(self.corners))
            logs, log_slopes = logs.reshape(shape), log_slopes.reshape(*shape, log_slopes.shape[-1])
            if self.task.robust is RobustObjective.WORST_CASE:
                # the worst case is the minimum of a metric to maximise, and the maximum of one to minimise
                sign = -np.sign(weight)
                largest = (sign * logs).max(axis=2, keepdims=True)
                exponential = np.exp(SOFT_EXTREMUM_SHARPNESS * (sign * logs - largest))
                share = exponential / exponential.sum(axis=2, keepdims=True)
            else:
                share = np.full(logs.shape, 1.0 / logs.shape[2])
            goals.append((share * logs).sum(axis=2).mean(axis=1))
            if self.task.robust is RobustObjective.WORST_CASE:
                # derivative of Σ wᵢ xᵢ whose weights wᵢ are the softmax of the xᵢ
                deviation = logs - (share * logs).sum(axis=2, keepdims=True)
                share = share * (1.0 + SOFT_EXTREMUM_SHARPNESS * sign * deviation)
            goal_gradients.append((share[..., None] * log_slopes).sum(axis=2).mean(axis=1))
        return np.stack(goals, axis=1), np.stack(goal_gradients, axis=1)
