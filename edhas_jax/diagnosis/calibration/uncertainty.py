"""What a fit is worth: parameters that drift from run to run, and the profile of the likelihood along one of them."""

import dataclasses
from collections.abc import Callable

import numpy as np

from edhas_jax.diagnosis.calibration.fit import Fit, sums_of_squares
from edhas_jax.diagnosis.calibration.least_squares import minimise
from edhas_jax.measurements.predicted_signals import Case

LEAST_APART = 0.05  # of a run's own variance
PROFILE_SIGMAS = (-3.0, -2.0, -1.5, -1.0, -0.5, 0.5, 1.0, 1.5, 2.0, 3.0)


@dataclasses.dataclass(frozen=True)
class Drift:
    """Each run fitted alone: estimates `x` (runs, n) and standard errors `std` in coordinates.

    `score` (runs, n) is the distance from the common estimate in standard deviations of that distance: of the order of
    1 when the model is right, large where a parameter stands in for physics that is missing.
    """

    runs: tuple[str, ...]
    x: np.ndarray
    std: np.ndarray
    score: np.ndarray


@dataclasses.dataclass(frozen=True)
class Profile:
    """The likelihood along one unknown, all others fitted anew: coordinates, values (SI) and 2(cost − least cost)."""

    name: str
    x: np.ndarray
    values: np.ndarray
    rise: np.ndarray

    def interval(self, level: float = 3.84) -> tuple[float, float]:
        """Where the rise stays below `level` (3.84: 95 %), by linear interpolation of its signed root; SI."""
        root = np.sqrt(np.maximum(self.rise, 0.0)) * np.where(np.arange(len(self.x)) < np.argmin(self.rise), -1.0, 1.0)
        order = np.argsort(root)
        low, high = np.interp([-np.sqrt(level), np.sqrt(level)], root[order], self.values[order])
        return float(low), float(high)


def fit_each_run(fit: Fit, on_progress: Callable[[str], None] | None = None) -> Drift:
    """Fit every run alone from the common estimate, all side by side.

    A run's estimate and the common one share data and prior, and the common one is the efficient one of the two, so
    that var(x_run − x) = var(x_run) − var(x) (Hausman, Econometrica 46 (1978) 1251).
    """
    model = fit.problem.model()
    count, n = len(model.runs), len(model.unknowns)

    def evaluate(x, which):
        cases = [Case(row, (int(r),)) for row, r in zip(x, which, strict=True)]
        return sums_of_squares(model, cases, fit.resolution.fine)

    low, high = np.array([u.bounds() for u in model.unknowns]).T
    starts = np.tile(fit.uncorrected, (count, 1))
    done = minimise(evaluate, starts, low, high, tolerance=0.02, on_step=_teller(on_progress))
    covariance = np.array([np.linalg.pinv(c, hermitian=True) for c in done.at.curvature])
    variance = np.einsum("rkk->rk", covariance)
    # where a run knows as much as all of them, what is left of the difference is where the search stopped
    apart = np.maximum(variance - np.diag(fit.covariance), LEAST_APART * variance)
    score = (done.x - fit.uncorrected) / np.sqrt(apart)
    return Drift(tuple(run.name for run in model.runs), done.x.reshape(count, n), np.sqrt(variance), score)


def profile(fit: Fit, name: str, on_progress: Callable[[str], None] | None = None) -> Profile:
    """Hold an unknown at values around its estimate and fit the others anew, all side by side.

    Raises:
        ValueError: no such unknown.
    """
    names = [u.name for u in fit.problem.unknowns]
    if name not in names:
        raise ValueError(f"{name} is not sought in this fit; one of {', '.join(names)}")
    k = names.index(name)
    model = fit.problem.model()
    every = tuple(range(len(model.runs)))
    low, high = np.array([u.bounds() for u in model.unknowns]).T
    # the others follow along the ridge of the likelihood
    offsets = np.array(PROFILE_SIGMAS) * fit.std[k]
    starts = fit.uncorrected + np.outer(offsets, fit.covariance[:, k] / fit.covariance[k, k])
    starts[:, k] = np.clip(starts[:, k], low[k], high[k])
    free = np.arange(len(names)) != k
    done = minimise(
        lambda x, which: sums_of_squares(model, [Case(row, every) for row in x], fit.resolution.fine),
        starts, low, high, free=free, tolerance=0.02, on_step=_teller(on_progress),
    )  # fmt: skip
    # what frees the estimate of the solver's error moves the whole curve
    x = np.append(done.x[:, k], fit.uncorrected[k]) + (fit.x[k] - fit.uncorrected[k])
    rise = 2.0 * (np.append(done.at.cost, fit.cost) - fit.cost)
    order = np.argsort(x)
    return Profile(name, x[order], np.asarray(fit.problem.unknowns[k].value(x[order])), rise[order])


def _teller(on_progress):
    return None if on_progress is None else lambda step, cost: on_progress(f"step {step}")
