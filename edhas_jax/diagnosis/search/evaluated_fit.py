"""A fit judged on all runs of its campaign, those included that no fit has seen."""

import dataclasses
import math
from collections.abc import Iterable

import numpy as np

from edhas_jax.diagnosis.calibration.fit import (
    CORRECTION_REFINEMENT,
    Fit,
    FitError,
    FitProblem,
    fit,
    gauss_newton_model,
)
from edhas_jax.diagnosis.calibration.least_squares import Minima, levenberg_marquardt, regularised_inverse
from edhas_jax.diagnosis.calibration.result import campaign_residuals
from edhas_jax.measurements.campaign import BenchRun, Use
from edhas_jax.measurements.measurement_model import EvaluationPoint
from edhas_jax.measurements.residuals import rms_over_noise
from edhas_jax.measurements.time_resolution import TimeResolution

NEAR_NOISE = 1.3  # residual over noise below which fits are finished at the fine step before they are compared


@dataclasses.dataclass(frozen=True)
class Judged:
    """A fit with the residuals (measured − model)/noise of all runs, by run and signal."""

    fit: Fit
    residuals: dict[str, dict[str, np.ndarray]]

    @property
    def cost(self) -> float:
        """½χ² of residuals and prior of the runs that were fitted."""
        prior = sum(x * x for u, x in zip(self.fit.problem.unknowns, self.fit.x, strict=True) if u.has_prior)
        squares = sum(np.nansum(v * v) for signals in self.fit.residuals.values() for v in signals.values())
        return 0.5 * float(prior + squares)

    @property
    def evidence(self) -> float:
        """ln ∫ likelihood · prior by Laplace's rule, up to what all models of a campaign share."""
        return -self.cost + 0.5 * float(np.linalg.slogdet(self.fit.covariance)[1])

    def rows(self, runs: Iterable[BenchRun]) -> list[np.ndarray]:
        """The residuals of some runs, signal by signal."""
        return [v for run in runs for v in self.residuals[run.name].values()]

    def level(self, use: Use) -> float:
        """Residual over noise of the runs of one use; NaN where there are none."""
        rows = self.rows(self.fit.problem.campaign.runs_for(use))
        return rms_over_noise(rows) if rows else math.nan

    @property
    def near_noise(self) -> bool:
        """Whether so little is left over that the solver's error at a rough step would matter."""
        return self.level(Use.FIT) < NEAR_NOISE

    def half_chi_square(self) -> np.ndarray:
        """½Σ(residual/noise)² by run and signal, of the runs that no fit has seen; of all where none is held out."""
        campaign = self.fit.problem.campaign
        runs = campaign.runs_for(Use.HOLDOUT) or campaign.runs
        return np.array([0.5 * np.nansum(np.square(v)) for v in self.rows(runs)])


def search(problem: FitProblem, starts: np.ndarray, per_sample: int, most_steps: int) -> Judged:
    """The best fit of a problem from one start (n,) or several (k, n), without the refinements of a final one; judged.

    Raises:
        FitError: the model fails wherever the fit has looked.
    """
    found = minima(problem, starts, per_sample, most_steps)
    best = int(np.argmin(found.model.cost))
    x, cost = found.x[best], float(found.model.cost[best])
    if not np.isfinite(cost):
        raise FitError("the model fails (it is not finite, or leaves its physical range) wherever the fit has looked")
    model = problem.model()
    every = tuple(range(len(model.runs)))
    outcomes = model.predict_all_runs(x, per_sample, with_sensitivities=True)
    done = Fit(
        problem, x, x, regularised_inverse(found.model.curvature[best]), cost, tuple(outcomes[r] for r in every),
        TimeResolution(per_sample, per_sample, math.nan), bool(found.converged[best]), found.model.cost,
    )  # fmt: skip
    return judge(done, per_sample)


def minima(problem: FitProblem, starts: np.ndarray, per_sample: int, most_steps: int) -> Minima:
    """Where a fit ends from one start (n,) or several (k, n)."""
    model = problem.model()
    every = tuple(range(len(model.runs)))
    low, high = np.array([u.bounds() for u in problem.unknowns]).T
    return levenberg_marquardt(
        lambda x, which: gauss_newton_model(model, [EvaluationPoint(row, every) for row in x], per_sample),
        np.atleast_2d(starts), low, high, tolerance=0.5, max_steps=most_steps, merge=0.5,
    )  # fmt: skip


def judge(fitted: Fit, per_sample: int) -> Judged:
    """A fit, judged on all runs of its campaign at `per_sample` steps from sample to sample."""
    return Judged(fitted, campaign_residuals(fitted.problem.campaign, fitted.machine, fitted.instruments, per_sample))


def start_from(problem: FitProblem, values: dict[str, float]) -> np.ndarray:
    """Coordinates of a problem at the values (SI) that are known; the centre of the prior for the rest."""
    return np.array([u.coordinate(values[u.name]) if u.name in values else 0.0 for u in problem.unknowns])


def refined(judged: Judged, resolution: TimeResolution, most_steps: int) -> Judged:
    """A fit finished at the fine step and freed of the solver's error."""
    fitted = judged.fit
    try:
        done = fit(fitted.problem, fitted.x[None], resolution=resolution, max_steps=most_steps, search=False)
    except FitError:
        return judged
    return judge(done, CORRECTION_REFINEMENT * resolution.fine)
