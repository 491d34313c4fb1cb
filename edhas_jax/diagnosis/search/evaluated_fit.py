"""A fit with its residuals on all runs of the campaign, including the held-out runs, and its log-evidence."""

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
from edhas_jax.diagnosis.calibration.least_squares import Minima, levenberg_marquardt
from edhas_jax.diagnosis.calibration.result import campaign_residuals
from edhas_jax.diagnosis.calibration.symmetric_matrices import log_determinant, regularised_inverse
from edhas_jax.measurements.campaign import BenchRun, Use
from edhas_jax.measurements.measurement_model import EvaluationPoint
from edhas_jax.measurements.residuals import rms_over_noise
from edhas_jax.measurements.time_resolution import TimeResolution

NEAR_NOISE_RMS = 1.3  # rms residual over noise below which the error of the coarse time step affects a comparison
COST_TOLERANCE = 0.5  # change of ½χ² below which a coarse fit has converged, or two starts are merged


@dataclasses.dataclass(frozen=True)
class EvaluatedFit:
    """A fit with its residuals on all runs.

    Args:
        fit: the fit, to the runs that its problem names.
        residuals: (measured − model)/noise by run and signal, for all runs of the campaign.
    """

    fit: Fit
    residuals: dict[str, dict[str, np.ndarray]]

    @property
    def cost(self) -> float:
        """½χ² of residuals and prior of the fitted runs (half the chi-square scale)."""
        prior = sum(x * x for u, x in zip(self.fit.problem.unknowns, self.fit.x, strict=True) if u.has_prior)
        squares = sum(np.nansum(v * v) for signals in self.fit.residuals.values() for v in signals.values())
        return 0.5 * float(prior + squares)

    @property
    def log_evidence(self) -> float:
        """Log marginal likelihood ln ∫ likelihood · prior dx by Laplace's method, in nats.

        −½χ² + ½ ln det C, with C the posterior covariance in coordinates whose prior is standard normal. The constant
        that all models of a campaign share is omitted, so that only differences (gains) have a meaning. The
        determinant is the penalty of each parameter, comparable with that of the BIC.
        """
        return -self.cost + 0.5 * log_determinant(self.fit.covariance)

    def run_residuals(self, runs: Iterable[BenchRun]) -> list[np.ndarray]:
        """The residuals of the given runs, one array for each run and signal."""
        return [v for run in runs for v in self.residuals[run.name].values()]

    def rms_over_noise(self, use: Use) -> float:
        """Root mean square of (measured − model)/noise over the runs of one use; NaN where there are none."""
        rows = self.run_residuals(self.fit.problem.campaign.runs_for(use))
        return rms_over_noise(rows) if rows else math.nan

    @property
    def near_noise(self) -> bool:
        """Whether the fitted runs leave less than `NEAR_NOISE_RMS`, so that the solver's error would matter."""
        return self.rms_over_noise(Use.FIT) < NEAR_NOISE_RMS

    def holdout_half_chi_square(self) -> np.ndarray:
        """½Σ(residual/noise)² for each held-out run and signal; for all runs where none is held out."""
        campaign = self.fit.problem.campaign
        runs = campaign.runs_for(Use.HOLDOUT) or campaign.runs
        return np.array([0.5 * np.nansum(np.square(v)) for v in self.run_residuals(runs)])


def fit_coarse(problem: FitProblem, starts: np.ndarray, steps_per_sample: int, max_steps: int) -> EvaluatedFit:
    """Fit at the coarse time step, without the refinements of a final fit, and evaluate the fit on all runs.

    Args:
        problem: what is fitted.
        starts: coordinates of one start (n,) or of several (k, n); the best end point is taken.
        steps_per_sample: time steps per sample.
        max_steps: maximum number of Levenberg-Marquardt steps.

    Raises:
        FitError: the model fails at every point that was evaluated.
    """
    found = find_minima(problem, starts, steps_per_sample, max_steps)
    best = int(np.argmin(found.model.cost))
    x, cost = found.x[best], float(found.model.cost[best])
    if not np.isfinite(cost):
        raise FitError("the model fails (it is not finite, or leaves its physical range) wherever the fit has looked")
    model = problem.model()
    outcomes = model.predict_all_runs(x, steps_per_sample, with_sensitivities=True)
    fitted = Fit(
        problem, x, x, regularised_inverse(found.model.curvature[best]), cost,
        tuple(outcomes[r] for r in range(len(model.runs))),
        TimeResolution(steps_per_sample, steps_per_sample, math.nan), bool(found.converged[best]), found.model.cost,
    )  # fmt: skip
    return evaluate_fit(fitted, steps_per_sample)


def find_minima(problem: FitProblem, starts: np.ndarray, steps_per_sample: int, max_steps: int) -> Minima:
    """The end points of least-squares fits from one start (n,) or several (k, n); arguments as in `fit_coarse`."""
    model = problem.model()
    run_indices = tuple(range(len(model.runs)))
    low, high = np.array([u.bounds() for u in problem.unknowns]).T
    return levenberg_marquardt(
        lambda x, which: gauss_newton_model(model, [EvaluationPoint(row, run_indices) for row in x], steps_per_sample),
        np.atleast_2d(starts), low, high, tolerance=COST_TOLERANCE, max_steps=max_steps, merge=COST_TOLERANCE,
        constraints=problem.constraints(),
    )  # fmt: skip


def evaluate_fit(fitted: Fit, steps_per_sample: int) -> EvaluatedFit:
    """Simulate all runs of the campaign with a fitted model, `steps_per_sample` time steps per sample."""
    residuals = campaign_residuals(fitted.problem.campaign, fitted.machine, fitted.instruments, steps_per_sample)
    return EvaluatedFit(fitted, residuals)


def start_coordinates(problem: FitProblem, values: dict[str, float]) -> np.ndarray:
    """Coordinates (n,) of a problem at known values (SI) by name; the centre of the prior for the other unknowns."""
    return np.array([u.coordinate(values[u.name]) if u.name in values else 0.0 for u in problem.unknowns])


def refine_fit(evaluated: EvaluatedFit, resolution: TimeResolution, max_steps: int) -> EvaluatedFit:
    """Continue a fit at the fine time step and correct its estimate for the solver's error.

    Returns the fit unchanged where the model fails at the fine step.
    """
    fitted = evaluated.fit
    try:
        refined = fit(fitted.problem, fitted.x[None], resolution=resolution, max_steps=max_steps, search=False)
    except FitError:
        return evaluated
    return evaluate_fit(refined, CORRECTION_REFINEMENT * resolution.fine)
