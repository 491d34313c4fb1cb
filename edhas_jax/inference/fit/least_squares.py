"""Bounded Levenberg-Marquardt minimisation from several starting points, evaluated as one batch."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from edhas_jax.inference.fit.bounded_step import Limits, proposed_step
from edhas_jax.inference.fit.parameter_order import LinearConstraints, no_constraints

OVERFLOW_LIMIT = 1e150  # products of two larger numbers would overflow
INITIAL_DAMPING = 1e-2
MAX_DAMPING = 1e8  # a start whose damping grows beyond this is abandoned
RELATIVE_TOLERANCE = 1e-7
# a cost simulated with contacts is not smooth below this decrease, absolute or as a share of the cost
NOISE_FLOOR, RELATIVE_NOISE_FLOOR = 1.0, 1e-6
GOOD_RATIOS = 0.25, 4.0  # of achieved to predicted decrease, within which updated derivatives are good enough to go on
MAX_FAILED_STEPS = 3  # consecutive rejected steps below the noise floor that end a search
STALLED_STEPS = 6  # the same with nothing gained: as many rejected ones raise the damping by 2²¹


@dataclasses.dataclass(frozen=True)
class QuadraticModel:
    """Gauss-Newton model of a sum of squares ½|r|² at k points in n coordinates.

    Attributes:
        cost: ½|r|², shape (k,).
        gradient: Jᵀr, shape (k, n).
        curvature: JᵀJ, the Gauss-Newton approximation of the Hessian, shape (k, n, n).
    """

    cost: np.ndarray
    gradient: np.ndarray
    curvature: np.ndarray


def stacked_models(models: Sequence[QuadraticModel]) -> QuadraticModel:
    """The models of several points as one."""
    fields = QuadraticModel.__dataclass_fields__
    return QuadraticModel(*(np.concatenate([getattr(model, field) for model in models]) for field in fields))


@dataclasses.dataclass(frozen=True)
class Minima:
    """Final points of a minimisation from k starts in n coordinates.

    Attributes:
        x: final points, shape (k, n).
        model: the sum of squares at `x`.
        steps: number of evaluated steps, shape (k,).
        converged: whether the tolerance was reached, shape (k,); False for merged and abandoned starts.
    """

    x: np.ndarray
    model: QuadraticModel
    steps: np.ndarray
    converged: np.ndarray


def levenberg_marquardt(
    evaluate: Callable[[np.ndarray, np.ndarray], QuadraticModel],
    starts: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    free: np.ndarray | None = None,
    tolerance: float = 1e-3,
    max_steps: int = 30,
    merge: float = 0.0,
    on_step: Callable[[int, np.ndarray], None] | None = None,
    constraints: LinearConstraints | None = None,
    keep_on: Callable[[int, np.ndarray], bool] | None = None,
    relative_tolerance: float = RELATIVE_TOLERANCE,
    update: Callable[[np.ndarray, np.ndarray, np.ndarray], QuadraticModel] | None = None,
) -> Minima:
    """Minimise ½|r(x)|² within low ≤ x ≤ high, and within linear constraints, from each starting point.

    A start has converged when the largest possible decrease predicted by its model falls below `tolerance` (for
    residuals in units of their noise, a change far below the standard errors), or when `MAX_FAILED_STEPS` steps in a
    row are rejected while that prediction is below the noise floor of the cost.

    It is also ended where `STALLED_STEPS` steps in a row, together, lower the cost by less than the tolerance.

    With `update`, steps are evaluated by it, which costs less than `evaluate`. A start is evaluated again where a step
    brings much less or more than predicted, before it counts as converged, and at its end; after every successful step
    once that has shown updated derivatives to be wrong.

    Args:
        evaluate: called with points (m, n) and the indices (m,) of their starts; returns the sums of squares there.
            A step to a point where the cost or a derivative is not finite, or near to overflow, is rejected.
        starts: starting points, shape (k, n); those outside the bounds or constraints are moved inside.
        low: lower bounds, shape (n,).
        high: upper bounds, shape (n,).
        free: marks the coordinates that may vary, shape (k, n) or (n,); all by default.
        tolerance: predicted decrease of the cost that counts as converged.
        max_steps: largest number of steps per start.
        merge: a start is dropped when, by the curvature of a better one, their costs differ by less than this.
        on_step: called with the number of the step and the costs (k,) after it.
        constraints: linear constraints on the coordinates.
        relative_tolerance: share of the cost; adds to `tolerance` where model error leaves a large cost.
        keep_on: asked after every step with its number and the costs (k,); False ends the search.
        update: called with points (m, n), the indices (m,) of their starts, and the points (m, n) at which these are;
            returns the sums of squares with derivatives that follow from earlier points.

    Returns:
        The final points of all starts.

    Source: Nielsen, Damping parameter in Marquardt's method, IMM-REP-1999-05, for the update of the damping.
    """
    constraints = no_constraints(np.shape(starts)[1]) if constraints is None else constraints
    x = np.array([constraints.project(row, low, high) for row in np.array(starts, float)])
    free = np.ones(x.shape, bool) if free is None else np.broadcast_to(free, x.shape)
    search = _Search(x, Limits(low, high, constraints), free, evaluate, update)
    number = 0
    while number < max_steps and len(rows := np.flatnonzero(search.active)):
        trial, predicted, attainable = search.proposals(rows)
        unfinished = search.is_unfinished(rows, attainable, tolerance, relative_tolerance)
        unsure = rows[~unfinished & search.is_updated[rows]]
        if len(unsure):
            search.evaluate_again(unsure)
            continue
        search.finish(rows[~unfinished])
        if not unfinished.any():
            break
        search.step(rows[unfinished], trial[unfinished], predicted[unfinished])
        search.end_stalled(tolerance, relative_tolerance)
        number += 1
        if merge > 0.0:
            _merge_starts(search.x, search.cost, search.curvature, search.active, merge)
        if on_step is not None:
            on_step(number, search.cost)
        if keep_on is not None and not keep_on(number, search.cost):
            break
    search.evaluate_again(np.flatnonzero(search.is_updated & np.isfinite(search.cost)))
    model = QuadraticModel(search.cost, search.gradient, search.curvature)
    return Minima(search.x, model, search.steps, search.converged)


class _Search:
    """The points (k, n) of a search with their sums of squares, and how far each of them has come."""

    def __init__(self, x: np.ndarray, limits: Limits, free: np.ndarray, evaluate: Callable, update: Callable | None):
        self.x, self._limits, self._free = x, limits, free
        self._evaluate, self._update = evaluate, update
        initial, count = evaluate(x, np.arange(len(x))), len(x)
        self.cost, self.gradient, self.curvature = (
            np.array(part) for part in (initial.cost, initial.gradient, initial.curvature)
        )
        self.cost[~_is_finite(initial)] = np.inf
        self.active, self.converged = np.isfinite(self.cost), np.zeros(count, bool)
        self.steps, self._rejected = np.zeros(count, int), np.zeros(count, int)
        self._damping, self._growth = np.full(count, INITIAL_DAMPING), np.full(count, 2.0)
        self.is_updated, self._may_update = np.zeros(count, bool), np.full(count, update is not None)
        self._last_gain, self._idle = self.cost.copy(), np.zeros(count, int)  # cost at the last gain, steps since
        self._evaluated = [self._at(k) for k in range(count)]  # where derivatives were computed last

    def proposals(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The ends (m, n) of the next steps of some points, their predicted decreases (m,), and the largest ones."""
        found = [
            proposed_step(self.x[k], self.gradient[k], self.curvature[k], self._damping[k], self._limits, self._free[k])
            for k in rows
        ]
        trial, predicted, attainable = (np.array(column) for column in zip(*found, strict=True))
        return trial, predicted, attainable

    def is_unfinished(self, rows: np.ndarray, attainable: np.ndarray, tolerance: float, share: float) -> np.ndarray:
        """Whether so much can be gained from some points (m,) that their search goes on."""
        cost = self.cost[rows]
        floor = np.maximum(NOISE_FLOOR, RELATIVE_NOISE_FLOOR * cost)
        unfinished = ~(attainable <= np.maximum(tolerance, share * cost))  # NaN has not converged
        return unfinished & ~((attainable < floor) & (self._rejected[rows] >= MAX_FAILED_STEPS))

    def finish(self, rows: np.ndarray) -> None:
        """The search of some points has converged."""
        self.converged[rows], self.active[rows] = True, False

    def end_stalled(self, tolerance: float, share: float) -> None:
        """End the search from points that have gained next to nothing for some steps."""
        for k in np.flatnonzero(self.active):
            has_gained = self.cost[k] < self._last_gain[k] - max(tolerance, share * self.cost[k])
            if has_gained or self.cost[k] > self._last_gain[k]:  # above: an update has promised too much
                self._last_gain[k], self._idle[k] = self.cost[k], 0
            else:
                self._idle[k] += 1
                self.active[k] = self._idle[k] < STALLED_STEPS

    def step(self, rows: np.ndarray, trial: np.ndarray, predicted: np.ndarray) -> None:
        """Take the proposed steps of some points where they lower the cost; change their damping."""
        new = self._models_at(trial, rows)
        valid, doubtful = _is_finite(new), []
        for row, k in enumerate(rows):
            self.steps[k] += 1
            ratio = (self.cost[k] - new.cost[row]) / predicted[row] if valid[row] else -1.0
            if ratio > 0.0:
                self._move(k, (trial[row], new.cost[row], new.gradient[row], new.curvature[row]))
                self._damping[k] *= max(1.0 / 10.0, 1.0 - (2.0 * min(ratio, 2.0) - 1.0) ** 3)
                self._growth[k], self._rejected[k], self.is_updated[k] = 2.0, 0, self._may_update[k]
                if not self._may_update[k]:
                    self._evaluated[k] = self._at(k)
            else:
                self._rejected[k] += 1
                self._damping[k] *= self._growth[k]
                self._growth[k] *= 2.0
                self.active[k] = self._damping[k] < MAX_DAMPING
            if self.is_updated[k] and self.active[k] and not GOOD_RATIOS[0] < ratio < GOOD_RATIOS[1]:
                doubtful.append(k)
        self.evaluate_again(np.array(doubtful, int))

    def evaluate_again(self, rows: np.ndarray) -> None:
        """Compute the derivatives at some points; a point goes back to the last such one where that was better."""
        if not len(rows):
            return
        found = self._evaluate(self.x[rows], rows)
        valid = _is_finite(found)
        for row, k in enumerate(rows):
            if valid[row] and found.cost[row] <= self._evaluated[k][1]:
                self._evaluated[k] = self.x[k].copy(), found.cost[row], found.gradient[row], found.curvature[row]
            else:  # what is kept between evaluations has changed too much
                self._may_update[k] = False
            self._move(k, self._evaluated[k])
        self.is_updated[rows] = False

    def _models_at(self, trial: np.ndarray, rows: np.ndarray) -> QuadraticModel:
        """The models at the ends of steps; those that go on from there with derivatives that are good enough."""
        if self._update is None:
            return self._evaluate(trial, rows)
        new = self._update(trial, rows, self.x[rows])
        unsure = np.flatnonzero(~self._may_update[rows] & _is_finite(new) & (new.cost < self.cost[rows]))
        if len(unsure):
            found = self._evaluate(trial[unsure], rows[unsure])
            parts = (np.array(part) for part in (new.cost, new.gradient, new.curvature))
            new = QuadraticModel(*parts)
            new.cost[unsure], new.gradient[unsure], new.curvature[unsure] = found.cost, found.gradient, found.curvature
        return new

    def _at(self, k: int) -> tuple[np.ndarray, float, np.ndarray, np.ndarray]:
        """A point, its cost, gradient and curvature."""
        return self.x[k].copy(), self.cost[k], self.gradient[k].copy(), self.curvature[k].copy()

    def _move(self, k: int, to: tuple[np.ndarray, float, np.ndarray, np.ndarray]) -> None:
        self.x[k], self.cost[k], self.gradient[k], self.curvature[k] = to


def _is_finite(model: QuadraticModel) -> np.ndarray:
    """Whether cost and derivatives are finite and far from overflowing, by point."""
    with np.errstate(invalid="ignore"):
        finite = (np.abs(model.cost) < OVERFLOW_LIMIT) & (np.abs(model.gradient) < OVERFLOW_LIMIT).all(axis=1)
        return finite & (np.abs(model.curvature) < OVERFLOW_LIMIT).all(axis=(1, 2))


def _merge_starts(x, cost, curvature, active, tolerance) -> None:
    """Stop the starts that have come close to a better one, as measured by the curvature there."""
    order = np.argsort(cost)
    for place, k in enumerate(order):
        differences = [x[k] - x[better] for better in order[:place]]
        close = (0.5 * d @ curvature[better] @ d < tolerance for d, better in zip(differences, order, strict=False))
        if active[k] and any(close):
            active[k] = False
