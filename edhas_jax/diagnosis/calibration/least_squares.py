"""Levenberg-Marquardt from many starts at once: the starts that still move are evaluated together."""

import dataclasses
from collections.abc import Callable

import numpy as np

LONGEST = 1.5  # largest change of a coordinate in one step; coordinates are scaled to be of order one
HUGE = 1e150  # numbers that cannot be calculated with any more: products of two would overflow
GIVE_UP = 1e8  # damping above which a start is stuck
ROUGH = 1.0  # decrease below which a cost that comes from a simulation with contacts is not smooth any more
FINE, COARSE = 1e-7, 1e-6  # the same two as shares of the cost, where a model that is wrong leaves a large one
PATIENCE = 3  # steps in a row that fail to bring such a decrease


@dataclasses.dataclass(frozen=True)
class Quadratic:
    """A sum of squares ½|r|² near some points: `cost` (k,), `gradient` (k, n), `curvature` JᵀJ (k, n, n)."""

    cost: np.ndarray
    gradient: np.ndarray
    curvature: np.ndarray


def _finite(at: Quadratic) -> np.ndarray:
    """Whether cost and derivatives are finite, and far from overflowing, point by point."""
    with np.errstate(invalid="ignore"):
        sound = (np.abs(at.cost) < HUGE) & (np.abs(at.gradient) < HUGE).all(axis=1)
        return sound & (np.abs(at.curvature) < HUGE).all(axis=(1, 2))


def inverse(curvature: np.ndarray) -> np.ndarray:
    """The inverse of a curvature (n, n), positive definite whatever rounding has made of it.

    Coordinates are scaled to unit curvature first, so that what is known sharply does not hide the rest.
    """
    scale = 1.0 / np.sqrt(np.diag(curvature))
    values, vectors = np.linalg.eigh(scale[:, None] * curvature * scale)
    kept = np.maximum(values, len(values) * np.finfo(float).eps * values[-1])
    return scale[:, None] * ((vectors / kept) @ vectors.T) * scale


@dataclasses.dataclass(frozen=True)
class Minima:
    """Where the starts ended: `x` (k, n), the sum of squares there, the steps taken, and which have converged."""

    x: np.ndarray
    at: Quadratic
    steps: np.ndarray
    converged: np.ndarray


def minimise(
    evaluate: Callable[[np.ndarray, np.ndarray], Quadratic],
    starts: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    free: np.ndarray | None = None,
    tolerance: float = 1e-3,
    most_steps: int = 30,
    merge: float = 0.0,
    on_step: Callable[[int, np.ndarray], None] | None = None,
) -> Minima:
    """Minimise ½|r(x)|² within low ≤ x ≤ high from each row of `starts` (k, n).

    `evaluate(x, which)` gives the sums of squares at the rows `x` of the starts `which`; where cost or derivatives are
    not finite, or near to overflow, the step is rejected. `free` (k, n) marks the coordinates that may move. A start is
    at its end when a step would lower the cost by less than `tolerance`, which for residuals in units of their noise is
    a change far below the errors of estimation, or when steps that promise little fail to keep the promise; it is
    dropped when it comes so close to a better one that their costs would differ by less than `merge`.
    `on_step(number, cost)` reports.

    Source: Nielsen, Damping parameter in Marquardt's method, IMM-REP-1999-05, for the rule of the damping.
    """
    x = np.clip(np.array(starts, float), low, high)
    free = np.ones(x.shape, bool) if free is None else np.broadcast_to(free, x.shape)
    at = evaluate(x, np.arange(len(x)))
    cost, gradient, curvature = (np.array(part) for part in (at.cost, at.gradient, at.curvature))
    cost[~_finite(at)] = np.inf
    damping, growth = np.full(len(x), 1e-2), np.full(len(x), 2.0)
    steps, failed, converged = np.zeros(len(x), int), np.zeros(len(x), int), np.zeros(len(x), bool)
    going = np.isfinite(cost)
    for number in range(most_steps):
        moving = np.flatnonzero(going)
        if not len(moving):
            break
        trial, gain, rest = np.empty((len(moving), x.shape[1])), np.empty(len(moving)), np.empty(len(moving))
        for row, k in enumerate(moving):
            trial[row], gain[row], rest[row] = _trial(
                x[k], gradient[k], curvature[k], damping[k], free[k], low, high
            )
        least, rough = (np.maximum(size, share * cost[moving]) for size, share in ((tolerance, FINE), (ROUGH, COARSE)))
        still = (rest > least) & ~((rest < rough) & (failed[moving] >= PATIENCE))
        converged[moving[~still]], going[moving[~still]] = True, False
        moving, trial, gain = moving[still], trial[still], gain[still]
        if not len(moving):
            break
        new = evaluate(trial, moving)
        sound = _finite(new)
        for row, k in enumerate(moving):
            steps[k] += 1
            ratio = (cost[k] - new.cost[row]) / gain[row] if sound[row] else -1.0
            if ratio > 0.0:
                x[k], cost[k], gradient[k], curvature[k] = (
                    trial[row], new.cost[row], new.gradient[row], new.curvature[row],
                )  # fmt: skip
                damping[k] *= max(1.0 / 10.0, 1.0 - (2.0 * min(ratio, 2.0) - 1.0) ** 3)
                growth[k], failed[k] = 2.0, 0
            else:
                failed[k] += 1
                damping[k] *= growth[k]
                growth[k] *= 2.0
                going[k] = damping[k] < GIVE_UP
        if merge > 0.0:
            _merge(x, cost, curvature, going, merge)
        if on_step is not None:
            on_step(number + 1, cost)
    return Minima(x, Quadratic(cost, gradient, curvature), steps, converged)


def _trial(x, gradient, curvature, damping, free, low, high):
    """A damped step inside the bounds, the decrease it promises, and the best that a step could."""
    active = free & ~((x <= low) & (gradient > 0.0)) & ~((x >= high) & (gradient < 0.0))

    def decrease(step):
        return -(gradient @ step + 0.5 * step @ curvature @ step)

    room = np.maximum(low - x, -LONGEST), np.minimum(high - x, LONGEST)
    step = _step_inside(gradient, curvature, damping, active, *room)
    whole = _step_inside(gradient, curvature, 1e-12, active, *room)
    gain = decrease(step)
    return x + step, max(gain, 1e-300), max(gain, decrease(whole))


def _step_inside(gradient, curvature, damping, active, low, high):
    """The minimum of the damped quadratic over the active coordinates; those that reach a bound stay there."""
    step, active = np.zeros(len(gradient)), active.copy()
    damped = curvature + damping * np.diag(np.maximum(np.diag(curvature), 1e-12))
    while active.any():
        rest = gradient[active] + damped[np.ix_(active, ~active)] @ step[~active]
        step[active] = -np.linalg.lstsq(damped[np.ix_(active, active)], rest, rcond=1e-13)[0]
        beyond = active & ((step < low) | (step > high))
        step = np.clip(step, low, high)
        if not beyond.any():
            break
        active &= ~beyond
    return step


def _merge(x, cost, curvature, going, nearness) -> None:
    """Stop the starts that have come close to a better one, measured by its curvature."""
    order = np.argsort(cost)
    for place, k in enumerate(order):
        apart = [x[k] - x[better] for better in order[:place]]
        near = (0.5 * d @ curvature[better] @ d < nearness for d, better in zip(apart, order, strict=False))
        if going[k] and any(near):
            going[k] = False
