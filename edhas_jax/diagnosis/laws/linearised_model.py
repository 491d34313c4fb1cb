"""½χ² of a fit problem around a point: linearised with derivatives, and at other points with the same derivatives."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.inference.fit.fit_problem import FitProblem
from edhas_jax.inference.fit.least_squares import QuadraticModel, levenberg_marquardt
from edhas_jax.measurements.measurement_model import EvaluationPoint, PredictedSignals
from edhas_jax.measurements.residuals import normalised_residuals


class Linearisation(NamedTuple):
    """½χ² of residuals and priors at a point.

    Attributes:
        x: the point in coordinates (k,).
        cost: ½χ²; infinite where the model fails.
        gradient: its gradient (k,).
        curvature: its Gauss-Newton curvature (k, k).
        outcomes: by run the signals, and their derivatives with respect to the coordinates.
    """

    x: np.ndarray
    cost: float
    gradient: np.ndarray
    curvature: np.ndarray
    outcomes: tuple[PredictedSignals, ...]

    @property
    def is_finite(self) -> bool:
        """Whether the model and its derivatives are finite here."""
        return bool(np.isfinite(self.cost) and np.isfinite(self.gradient).all() and np.isfinite(self.curvature).all())


class PointEvaluator:
    """Evaluates a fit problem at points, with few simulations that follow derivatives.

    Args:
        problem: the fit problem.
        slope_steps: time steps per sample with derivatives.
        value_steps: time steps per sample of the signals themselves.
    """

    def __init__(self, problem: FitProblem, slope_steps: int, value_steps: int):
        self._problem, self._slope_steps, self._value_steps = problem, slope_steps, value_steps
        self._model = problem.model()
        self._runs = tuple(range(len(self._model.runs)))
        self._prior = np.array([float(u.has_prior) for u in problem.unknowns])

    def linearise(self, x: np.ndarray) -> Linearisation:
        """½χ² around a point (k,)."""
        found = self._model.predict_all_runs(x, self._slope_steps, with_sensitivities=True)
        values = found
        if self._value_steps != self._slope_steps:
            values = self._model.predict_all_runs(x, self._value_steps)
        outcomes = tuple(PredictedSignals(values[r].values, found[r].sensitivities) for r in self._runs)
        return self._linearisation(x, outcomes)

    def costs(self, points: np.ndarray, near: Linearisation) -> np.ndarray:
        """½χ² (p,) at points (p, k), infinite where the model fails; the derivatives are those of `near`."""
        cases = [EvaluationPoint(x, self._runs) for x in points]
        found = self._model.predict(cases, self._value_steps, with_sensitivities=False)
        costs = []
        for x, by_run in zip(points, found, strict=True):
            moved = [PredictedSignals(by_run[r].values, near.outcomes[r].sensitivities) for r in self._runs]
            cost = self._linearisation(x, tuple(moved)).cost
            costs.append(cost if np.isfinite(cost) else np.inf)
        return np.array(costs)

    def _linearisation(self, x: np.ndarray, outcomes: Sequence[PredictedSignals]) -> Linearisation:
        cost, gradient, curvature = 0.5 * self._prior @ np.square(x), self._prior * x, np.diag(self._prior)
        for run, outcome in zip(self._model.runs, outcomes, strict=True):
            for name, residual in normalised_residuals(self._model.campaign, run, outcome).items():
                measured = np.isfinite(run.signals[name])
                jacobian = -outcome.sensitivities[name][measured] / self._model.campaign.channels[name].noise
                residual = residual[measured]
                with np.errstate(over="ignore", invalid="ignore"):  # the search rejects such a point
                    cost = cost + 0.5 * residual @ residual
                    gradient = gradient + jacobian.T @ residual
                    curvature = curvature + jacobian.T @ jacobian
        return Linearisation(x, float(cost), gradient, curvature, tuple(outcomes))


def bounded_minimum(problem: FitProblem, x: np.ndarray, gradient: np.ndarray, curvature: np.ndarray) -> np.ndarray:
    """The minimum (k,) of a quadratic around a point within the bounds and orders of a problem's unknowns.

    Args:
        problem: gives bounds and orders.
        x: the point (k,).
        gradient: gradient (k,) there.
        curvature: curvature (k, k), positive semidefinite.
    """
    low, high = np.array([u.bounds() for u in problem.unknowns]).T

    def evaluate(points: np.ndarray, _) -> QuadraticModel:
        step = points - x
        slope = gradient + step @ curvature
        cost = np.sum(step * (gradient + 0.5 * step @ curvature), axis=1)
        return QuadraticModel(cost, slope, np.broadcast_to(curvature, (len(points), *curvature.shape)))

    found = levenberg_marquardt(evaluate, x[None], low, high, constraints=problem.constraints())
    return found.x[0]
