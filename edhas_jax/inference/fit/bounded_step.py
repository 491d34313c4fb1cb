"""Damped Gauss-Newton steps within bounds and linear constraints."""

import dataclasses

import numpy as np

from edhas_jax.inference.fit.parameter_order import LinearConstraints
from edhas_jax.inference.likelihood.symmetric_matrices import least_norm_solution

MAX_COORDINATE_STEP = 1.5  # largest change of a coordinate per step; coordinates are scaled to be of order one
UNDETERMINED_SHARE = 1e-13  # of the largest curvature: along flatter directions there is no step
CONSTRAINT_TOLERANCE = 1e-12  # largest violation of a linear constraint by rounding, in coordinates


@dataclasses.dataclass(frozen=True)
class Limits:
    """The feasible set of a search: lower and upper bounds (n,) and linear inequality constraints."""

    low: np.ndarray
    high: np.ndarray
    constraints: LinearConstraints


def proposed_step(
    x: np.ndarray, gradient: np.ndarray, curvature: np.ndarray, damping: float, limits: Limits,
    free: np.ndarray | None = None,
) -> tuple[np.ndarray, float, float]:  # fmt: skip
    """A damped Gauss-Newton step within all limits.

    Args:
        x: where it starts (n,).
        gradient: gradient of the cost there (n,).
        curvature: Gauss-Newton curvature there (n, n).
        damping: share of the diagonal of the curvature that is added to it.
        limits: bounds and constraints of the points.
        free: marks the coordinates that may vary (n,); all by default.

    Returns:
        The end (n,), the predicted decrease of the cost, and that of the best, undamped step.
    """
    free = np.ones(len(x), bool) if free is None else free
    low, high, constraints = limits.low, limits.high, limits.constraints
    active = free & ~((x <= low) & (gradient > 0.0)) & ~((x >= high) & (gradient < 0.0))

    def decrease(step):
        return -(gradient @ step + 0.5 * step @ curvature @ step)

    nearest = np.maximum(low - x, -MAX_COORDINATE_STEP), np.minimum(high - x, MAX_COORDINATE_STEP)
    room = LinearConstraints(constraints.rows, constraints.limits - constraints.rows @ x)
    step = _constrained_step(gradient, curvature, damping, active, *nearest, room)
    gauss_newton_step = _constrained_step(gradient, curvature, 1e-12, active, *nearest, room)
    predicted = decrease(step)
    return x + step, max(predicted, 1e-300), max(predicted, decrease(gauss_newton_step))


def _constrained_step(gradient, curvature, damping, active, low, high, room):
    """The bounded step; where it would violate constraints, the best one along their boundary."""
    step = _bounded_step(gradient, curvature, damping, active, low, high)
    if not gradient @ step + 0.5 * step @ curvature @ step < 0.0:  # several bounds at once may lead uphill
        step = _bounded_step(gradient, curvature, damping, active, low, high, one_at_a_time=True)
    violated = room.rows @ step < room.limits - CONSTRAINT_TOLERANCE
    if not violated.any():
        return step
    boundary = LinearConstraints(room.rows[violated], room.limits[violated])
    step = _bounded_step(gradient, curvature, damping, active, low, high, boundary)
    # the cost model is convex, so that its constrained minimum lies on violated constraints; a bound may come first
    change = room.rows @ step
    outside = change < room.limits - CONSTRAINT_TOLERANCE
    return step * min([1.0, *np.maximum(room.limits[outside] / change[outside], 0.0)])


def _bounded_step(gradient, curvature, damping, active, low, high, boundary=None, one_at_a_time=False):
    """Minimise the damped quadratic over the active coordinates; those that reach a bound are fixed there.

    With a boundary the step ends on it: rows · step = limits. One at a time: of several coordinates that would pass
    their bounds only the first one is fixed before the others are computed again.
    """
    step, active = np.zeros(len(gradient)), active.copy()
    damped = curvature + damping * np.diag(np.maximum(np.diag(curvature), 1e-12))
    while active.any():
        reduced = gradient[active] + damped[np.ix_(active, ~active)] @ step[~active]
        matrix = damped[np.ix_(active, active)]
        if boundary is not None:
            rows, rest = boundary.rows[:, active], boundary.rows[:, ~active] @ step[~active] - boundary.limits
            scale = np.max(np.diag(matrix))  # of the order of the curvature, for the sake of conditioning
            matrix = np.block([[matrix, scale * rows.T], [scale * rows, np.zeros((len(rows), len(rows)))]])
            reduced = np.concatenate([reduced, scale * rest])
        step[active] = -least_norm_solution(matrix, reduced, UNDETERMINED_SHARE)[: active.sum()]
        outside = active & ((step < low) | (step > high))
        if not outside.any():
            break
        if boundary is not None or one_at_a_time:  # the others can still move along the boundary
            first = np.argmin(np.where(outside, np.clip(step, low, high) / np.where(outside, step, 1.0), np.inf))
            outside = np.arange(len(step)) == first
        step = np.where(outside, np.clip(step, low, high), step)
        active &= ~outside
    return step
