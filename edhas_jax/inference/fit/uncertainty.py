"""Checks of a fit beyond its covariance: drift of the estimates between runs, and profile likelihoods."""

import dataclasses
from collections.abc import Callable

import numpy as np

from edhas_jax.inference.fit.fit import Fit
from edhas_jax.inference.fit.fit_problem import gauss_newton_model
from edhas_jax.inference.fit.least_squares import levenberg_marquardt
from edhas_jax.inference.likelihood.symmetric_matrices import regularised_inverse
from edhas_jax.measurements.measurement_model import EvaluationPoint

CHECK_TOLERANCE = 0.02  # in ½χ², of the fits of single runs and of the profiles
MIN_DIFFERENCE_VARIANCE = 0.05  # share of a run's own variance; below it the search's tolerance would dominate
PROFILE_SIGMAS = (-3.0, -2.0, -1.5, -1.0, -0.5, 0.5, 1.0, 1.5, 2.0, 3.0)  # offsets from the estimate
CHI2_95 = 3.84  # 95 % quantile of χ² with one degree of freedom


@dataclasses.dataclass(frozen=True)
class Drift:
    """Estimates of n unknowns from each run alone, compared with the common estimate.

    Attributes:
        runs: names of the runs that could be fitted.
        x: estimates in coordinates, shape (runs, n).
        std: their standard errors in coordinates, shape (runs, n).
        score: distance from the common estimate in standard deviations of that distance, shape (runs, n). Of the order
            of 1 for a correct model; large where a parameter compensates for physics that the model lacks.

    All are NaN for an unknown that does not act in a run.
    """

    runs: tuple[str, ...]
    x: np.ndarray
    std: np.ndarray
    score: np.ndarray


@dataclasses.dataclass(frozen=True)
class ProfileLikelihood:
    """Minimum of χ² over all other unknowns, as a function of one of them.

    Attributes:
        name: the unknown.
        x: its coordinates, ascending, shape (points,).
        values: the same in SI, shape (points,).
        chi2_increase: χ² above its minimum, shape (points,).
    """

    name: str
    x: np.ndarray
    values: np.ndarray
    chi2_increase: np.ndarray

    def interval(self, level: float = CHI2_95) -> tuple[float, float]:
        """Interval (SI) where the increase stays below `level`, by linear interpolation of its signed square root."""
        side = np.where(np.arange(len(self.x)) < np.argmin(self.chi2_increase), -1.0, 1.0)
        root = np.sqrt(np.maximum(self.chi2_increase, 0.0)) * side
        order = np.argsort(root)
        low, high = np.interp([-np.sqrt(level), np.sqrt(level)], root[order], self.values[order])
        return float(low), float(high)


def fit_each_run(fit: Fit, on_progress: Callable[[str], None] | None = None) -> Drift:
    """Fit each run alone, all its parts together, starting from the common estimate; all runs in one batch.

    A run's estimate and the common one share data and prior, and the common one is the efficient one of the two, so
    that var(x_run − x) = var(x_run) − var(x).

    Args:
        fit: the common estimate.
        on_progress: called with a text such as "step 3".

    Returns:
        The estimates of the runs and their distances from the common one.

    Source: Hausman, Econometrica 46 (1978) 1251, for the variance of the difference.
    """
    model = fit.problem.model()
    parts: dict[str, list[int]] = {}
    for r, run in enumerate(model.runs):
        parts.setdefault(run.whole, []).append(r)
    wholes, count, n = list(parts), len(parts), len(model.unknowns)

    def evaluate(x, runs):
        cases = [EvaluationPoint(row, tuple(parts[wholes[int(r)]])) for row, r in zip(x, runs, strict=True)]
        return gauss_newton_model(fit.problem, cases, fit.resolution.fine)

    low, high = np.array([u.bounds() for u in model.unknowns]).T
    starts = np.tile(fit.uncorrected, (count, 1))
    found = levenberg_marquardt(
        evaluate, starts, low, high, tolerance=CHECK_TOLERANCE, on_step=_step_reporter(on_progress),
        constraints=fit.problem.constraints(),
    )  # fmt: skip
    fitted = np.isfinite(found.model.cost)  # a run in which the model fails at the common estimate is left out
    covariance = np.array([regularised_inverse(c) for c in found.model.curvature[fitted]]).reshape(-1, n, n)
    variance = np.einsum("rkk->rk", covariance)
    difference_variance = np.maximum(variance - np.diag(fit.covariance), MIN_DIFFERENCE_VARIANCE * variance)
    score = (found.x[fitted] - fit.uncorrected) / np.sqrt(difference_variance)
    names = tuple(name for name, is_fitted in zip(wholes, fitted, strict=True) if is_fitted)
    acting = np.array([model.acting(parts[name][0]) for name in names]).reshape(-1, n)
    rows = (np.where(acting, values, np.nan) for values in (found.x[fitted], np.sqrt(variance), score))
    return Drift(names, *rows)


def profile_likelihood(fit: Fit, name: str, on_progress: Callable[[str], None] | None = None) -> ProfileLikelihood:
    """Fix an unknown at values around its estimate and fit all others again; all values in one batch.

    Args:
        fit: the common estimate.
        name: the unknown to vary.
        on_progress: called with a text such as "step 3".

    Returns:
        The profile at the estimate and at `PROFILE_SIGMAS` standard errors from it.

    Raises:
        ValueError: no such unknown.
    """
    names = [u.name for u in fit.problem.unknowns]
    if name not in names:
        raise ValueError(f"{name} is not an unknown of this fit; one of {', '.join(names)}")
    k = names.index(name)
    model = fit.problem.model()
    all_runs = tuple(range(len(model.runs)))
    low, high = np.array([u.bounds() for u in model.unknowns]).T
    # the other unknowns start on the ridge that the covariance predicts
    offsets = np.array(PROFILE_SIGMAS) * fit.std[k]
    starts = fit.uncorrected + np.outer(offsets, fit.covariance[:, k] / fit.covariance[k, k])
    starts[:, k] = np.clip(starts[:, k], low[k], high[k])
    free = np.arange(len(names)) != k
    found = levenberg_marquardt(
        lambda x, starts: gauss_newton_model(
            fit.problem, [EvaluationPoint(row, all_runs) for row in x], fit.resolution.fine
        ),
        starts, low, high, free=free, tolerance=CHECK_TOLERANCE, on_step=_step_reporter(on_progress),
        constraints=fit.problem.constraints(),
    )  # fmt: skip
    # the correction of the discretisation error shifts the whole curve
    x = np.append(found.x[:, k], fit.uncorrected[k]) + (fit.x[k] - fit.uncorrected[k])
    increase = 2.0 * (np.append(found.model.cost, fit.cost) - fit.cost)
    order = np.argsort(x)
    return ProfileLikelihood(name, x[order], np.asarray(fit.problem.unknowns[k].value(x[order])), increase[order])


def _step_reporter(on_progress):
    return None if on_progress is None else lambda step, cost: on_progress(f"step {step}")
