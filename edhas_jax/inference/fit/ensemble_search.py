"""Least squares for a model whose signals depend irregularly on its parameters, with derivatives from an ensemble.

Where valves bounce on their seats or a friction just sticks, runs with nearly the same parameters part after a while,
as in deterministic chaos. The sum of squares then has many local minima next to each other, and a derivative along one
run says little about its neighbours. Derivatives are therefore the slopes of a linear regression over an ensemble: over
points scattered around the present one (statistical linearisation), which averages over what is irregular. Of several
damped steps the best one is taken; if none lowers the cost, the ensemble becomes narrower. Once it is narrow it begins
wide again, as long as that has brought much.

Source: Iglesias, Law, Stuart, Ensemble Kalman methods for inverse problems, Inverse Problems 29 (2013) 045001; Chada,
Chen, Sanz-Alonso, Iterative ensemble Kalman methods, Foundations of Data Science 3 (2021) 331.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from edhas_jax.inference.fit.bounded_step import Limits, proposed_step
from edhas_jax.inference.fit.fit_problem import FitProblem, quadratic_model
from edhas_jax.inference.fit.least_squares import QuadraticModel
from edhas_jax.inference.likelihood.run_equations import run_columns, run_equations
from edhas_jax.inference.likelihood.symmetric_matrices import regularised_inverse
from edhas_jax.inference.likelihood.whitening import whiten
from edhas_jax.measurements.campaign import BenchRun
from edhas_jax.measurements.measurement_model import PredictedSignals

SEED = 0
FIRST_SPREAD, LAST_SPREAD = 0.3, 0.02  # standard deviation of the ensemble in coordinates: at the start, at the end
WIDER, NARROWER, HALF = 1.2, 0.7, 0.5  # factors on it after a step that gains much, that gains little, and without one
MUCH = 0.05  # of the excess of ½χ²
MORE_MEMBERS, USUAL_MEMBERS = 8, 36  # least number of members beyond that of unknowns; usual maximum number
DAMPINGS = (1e-6, 1e-2, 1e-1, 1.0, 10.0)  # of the steps that are compared
MAX_COST_RATIO = 20.0  # to the best member of the ensemble: the regression leaves out members with a larger ½χ²
RIDGE = 1e-3  # of the regression, over the spread of the ensemble: a coordinate at its bound has no slope

Outcomes = tuple[PredictedSignals, ...]  # of all runs at one point


@dataclasses.dataclass(frozen=True)
class EnsembleMinimum:
    """The end of a search.

    Args:
        x: the best point (n,).
        model: the sum of squares there, with gradient and curvature from the regression.
        outcomes: by run, the signals there and their slopes in the regression.
        converged: whether the ensemble has become so narrow that nothing more can be gained.
    """

    x: np.ndarray
    model: QuadraticModel
    outcomes: Outcomes
    converged: bool


def minimise_by_ensemble(
    problem: FitProblem, starts: np.ndarray, steps_per_sample: int, max_steps: int,
    keep_on: Callable[[int, float], bool] | None = None,
) -> EnsembleMinimum | None:  # fmt: skip
    """Minimise ½χ² with derivatives from an ensemble, from the best of some starts.

    Args:
        problem: what is fitted.
        starts: coordinates of one start (n,) or of several (k, n).
        steps_per_sample: time steps per sample.
        max_steps: largest number of steps.
        keep_on: asked after every step with its number and ½χ²; False ends the search.

    Returns:
        The end; None where the model fails at all starts.
    """
    ensemble, rng = Ensemble(problem, steps_per_sample), np.random.default_rng(SEED)
    starts = [ensemble.inside(row) for row in np.atleast_2d(starts)]
    spread, step = FIRST_SPREAD, 0
    found = [ensemble.around(x, spread if len(starts) == 1 else LAST_SPREAD, rng) for x in starts]
    present = min((f for f in found if f is not None), key=lambda f: f.cost, default=None)
    if present is None:
        return None
    begun_at, lowest = present.cost, present
    while step < max_steps:
        if spread <= LAST_SPREAD:
            if not begun_at - present.cost > MUCH * max(begun_at - 0.5 * ensemble.samples, 0.0):
                break
            begun_at, spread = present.cost, FIRST_SPREAD
            present = ensemble.around(present.x, spread, rng) or present
        step += 1
        points = np.array(ensemble.proposals(present))
        costs = ensemble.costs(points, ensemble.predict(points), present)
        x, cost = points[np.argmin(costs)], costs.min()
        if is_member := not cost < present.cost:
            x, cost = present.members[np.argmin(present.member_costs)], present.member_costs.min()
        new = ensemble.around(x, spread, rng) if cost < present.cost else None
        # far away the deviations of the bench change as well, so that only its own ensemble says what a point costs
        if new is None or not new.cost < present.cost:
            spread *= HALF
            present = ensemble.around(present.x, spread, rng) or present
        else:
            gains_much = present.cost - new.cost > MUCH * max(present.cost - 0.5 * ensemble.samples, 0.0)
            spread = min((WIDER if gains_much and not is_member else NARROWER) * spread, FIRST_SPREAD)
            present = new
        lowest = min(lowest, present, key=lambda regression: regression.cost)
        if keep_on is not None and not keep_on(step, present.cost):
            break
    return EnsembleMinimum(lowest.x, lowest.model, lowest.outcomes, spread <= LAST_SPREAD)


@dataclasses.dataclass(frozen=True)
class Regression:
    """A point and the regression over the members of an ensemble around it.

    Args:
        x: the point (n,).
        members: the members (k, n), and
        member_costs: ½χ² at them (k,).
        outcomes: by run, the signals at the point and their slopes in the regression.
        columns: by run, the whitened columns as `run_columns` orders them, and
        grams: their products.
        model: the sum of squares at the point.
        smooth: the sum of squares of the regression's value at the point, from which a step is taken.
    """

    x: np.ndarray
    members: np.ndarray
    member_costs: np.ndarray
    outcomes: Outcomes
    columns: list[np.ndarray]
    grams: list[np.ndarray]
    model: QuadraticModel
    smooth: QuadraticModel

    @property
    def cost(self) -> float:
        """½χ² at the point."""
        return float(self.model.cost[0])


class Ensemble:
    """Simulates the runs of a fit problem at many points and computes the sums of squares there.

    Args:
        problem: the unknowns and the runs.
        steps_per_sample: time steps per sample.
    """

    def __init__(self, problem: FitProblem, steps_per_sample: int):
        self._problem, self._steps_per_sample = problem, steps_per_sample
        self.runs: Sequence[BenchRun] = problem.model().runs
        self.samples = sum(run.valid_samples for run in self.runs)
        self._own = len(problem.bench.of_runs)
        self._low, self._high = np.array([u.bounds() for u in problem.unknowns]).T
        self._constraints = problem.constraints()

    def inside(self, x: np.ndarray, margin: float = 0.0) -> np.ndarray:
        """The nearest point to x (n,) that satisfies the constraints and lies at least `margin` inside the bounds."""
        return self._constraints.project(np.array(x, float), self._low + margin, self._high - margin)

    def predict(self, points: np.ndarray) -> list[Outcomes]:
        """The signals at points (k, n), by point and run."""
        return self._problem.predict(points, self._steps_per_sample, with_sensitivities=False)

    def around(self, x: np.ndarray, spread: float, rng: np.random.Generator) -> Regression | None:
        """The regression over points scattered around one; None where the model fails at it.

        Args:
            x: the point (n,).
            spread: standard deviation of the members, in coordinates.
            rng: draws the members.
        """
        count = max(len(x) + MORE_MEMBERS, min(2 * len(x) + 4, USUAL_MEMBERS))
        scattered = x + spread * rng.standard_normal((count, len(x)))
        members = np.array([self.inside(row) for row in scattered])
        at_x, *others = self.predict(np.concatenate([x[None], members]))
        rough = np.array([self._half_chi_square(of) for of in (at_x, *others)])
        if not np.isfinite(rough[0]):
            return None
        counts = rough[1:] < MAX_COST_RATIO * max(float(rough.min()), 1.0)
        used = [of for of, ok in zip(others, counts, strict=True) if ok]
        outcomes, smooth = self._regressed(at_x, used, members[counts] - x)
        problem = self._problem
        columns = [
            run_columns(problem.campaign, run, outcome, problem.unknowns, problem.bench)[0]
            for run, outcome in zip(self.runs, outcomes, strict=True)
        ]
        grams = [c.T @ c for c in columns]
        return Regression(
            x, members, self._costs(members, others, columns, grams), outcomes, columns, grams,
            self._model(x, columns, grams), self._model(x, columns, self._grams(smooth, columns, grams)),
        )  # fmt: skip

    def proposals(self, present: Regression) -> list[np.ndarray]:
        """The ends of steps with different dampings."""
        limits, model = Limits(self._low, self._high, self._constraints), present.smooth
        return [
            proposed_step(present.x, model.gradient[0], model.curvature[0], damping, limits)[0] for damping in DAMPINGS
        ]

    def costs(self, points: np.ndarray, outcomes: Sequence[Outcomes], present: Regression) -> np.ndarray:
        """½χ² of residuals, deviations of the bench and prior (k,) at points (k, n) near the present one."""
        return self._costs(points, outcomes, present.columns, present.grams)

    def is_finite(self, outcomes: Outcomes) -> bool:
        """Whether the model has succeeded in all runs."""
        return bool(np.isfinite(self._half_chi_square(outcomes)))

    def _regressed(
        self, at_x: Outcomes, others: Sequence[Outcomes], distances: np.ndarray
    ) -> tuple[Outcomes, Outcomes]:
        """The signals at a point with slopes from others at distances (k, n), and the regression's signals there."""
        n = distances.shape[1]
        weights = _regression_weights(distances) if len(others) else None
        outcomes, smooth = [], []
        for r, outcome in enumerate(at_x):
            values, slopes = {}, {}
            for name, signal in outcome.values.items():
                found = np.concatenate([signal[None], np.zeros((n, len(signal)))])
                if weights is not None:
                    found = weights @ np.array([of[r].values[name] for of in others])
                values[name], slopes[name] = found[0], found[1:].T
            outcomes.append(PredictedSignals(outcome.values, slopes))
            smooth.append(PredictedSignals(values, None))
        return tuple(outcomes), tuple(smooth)

    def _costs(self, points, outcomes, columns, grams) -> np.ndarray:
        with np.errstate(over="ignore", invalid="ignore"):  # the search leaves out such a point
            models = [
                self._model(x, columns, self._grams(of, columns, grams)) for x, of in zip(points, outcomes, strict=True)
            ]
        costs = np.array([float(model.cost[0]) for model in models])
        return np.where(np.isfinite(costs), costs, np.inf)

    def _grams(self, outcomes: Outcomes, columns, grams) -> list[np.ndarray]:
        """The products of the columns of each run with the residual of other signals as the last column."""
        found = []
        for run, outcome, known, gram in zip(self.runs, outcomes, columns, grams, strict=True):
            residual, gram = self._residual(run, outcome), gram.copy()
            gram[-1, :-1] = gram[:-1, -1] = known[:, :-1].T @ residual
            gram[-1, -1] = residual @ residual
            found.append(gram)
        return found

    def _model(self, x: np.ndarray, columns: Sequence[np.ndarray], grams: Sequence[np.ndarray]) -> QuadraticModel:
        equations = [run_equations(known, self._own, gram) for known, gram in zip(columns, grams, strict=True)]
        return quadratic_model(self._problem, x, equations)

    def _half_chi_square(self, outcomes: Outcomes) -> float:
        with np.errstate(over="ignore", invalid="ignore"):
            total = 0.5 * sum(float(r @ r) for r in map(self._residual, self.runs, outcomes))
        return total if np.isfinite(total) else np.inf

    def _residual(self, run: BenchRun, outcome: PredictedSignals) -> np.ndarray:
        """The whitened residuals (m,) of a run, ordered as the rows of `run_columns`."""
        channels, rows = self._problem.campaign.channels, []
        for name, measured in run.signals.items():
            valid = np.isfinite(whiten(measured, channels[name]))
            rows.append(whiten(measured - outcome.values[name], channels[name])[valid])
        return np.concatenate(rows)


def _regression_weights(distances: np.ndarray) -> np.ndarray:
    """The matrix (1 + n, k) that takes the values at k points to the value and the slopes at the origin.

    Args:
        distances: the points' distances from the origin (k, n), with k at least 1.
    """
    n, tiny = distances.shape[1], np.finfo(float).tiny
    matrix = np.concatenate([np.ones((len(distances), 1)), distances], axis=1)
    ridge = RIDGE * max(float(np.sum(np.square(distances))) / n, tiny)
    return regularised_inverse(matrix.T @ matrix + np.diag([tiny, *[ridge] * n])) @ matrix.T
