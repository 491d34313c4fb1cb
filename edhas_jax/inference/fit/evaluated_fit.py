"""A fit with its normal equations, its log-evidence, and its residuals without the deviations of the bench."""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from edhas_jax.inference.fit.ensemble_search import minimise_by_ensemble
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.inference.fit.fit_problem import FitError, FitProblem, SolverError, quadratic_model
from edhas_jax.inference.fit.least_squares import Minima, levenberg_marquardt
from edhas_jax.inference.fit.secant_model import SecantModel
from edhas_jax.inference.likelihood.bench_estimate import BenchEstimate, estimate_bench
from edhas_jax.inference.likelihood.run_equations import RunEquations
from edhas_jax.inference.likelihood.symmetric_matrices import log_determinant, regularised_inverse
from edhas_jax.measurements.campaign import BenchRun, Use
from edhas_jax.measurements.measurement_model import MeasurementModel, PredictedSignals
from edhas_jax.measurements.residuals import rms_over_noise
from edhas_jax.measurements.time_resolution import TimeResolution

# change of ½χ² below which a fit has converged, or two starts are merged: absolute, and as a share of it
COST_TOLERANCE, RELATIVE_COST_TOLERANCE = 0.5, 3e-5
# how often the solver's error is computed, and the change of ½χ² by the first one from which the second fit is searched
SOLVER_CORRECTIONS, MIN_SOLVER_CHANGE = 2, 10.0
UPDATED_STEPS = 1.5  # factor on the maximum number of steps with updated derivatives, which cost less than others
ENSEMBLE_STEPS = 2  # the same where they come from an ensemble, whose steps are shorter
MAX_RISE = 3.0  # factor by which correcting the solver's error may raise χ² of a run; see `_without_branches`
REFINEMENT = 2  # steps with which the solver's error is computed, over the fine ones
MODEL_FAILS = "the model fails (it is not finite, or leaves its physical range) wherever the fit has looked"
MUCH_LEFT = 2.0  # residual over noise: from here on a model does not describe the measurements, and the answer says so
EXCESS_SIGMAS = 2.0  # an excess of ½χ² counts beyond this many of its standard deviations under noise alone


def remaining(excess: float, samples: int) -> float:
    """What is left of an excess of ½χ² beyond its scatter under noise alone [nats], at least 0."""
    return max(excess - EXCESS_SIGMAS * math.sqrt(0.5 * samples), 0.0)


def noise_level(samples: int) -> float:
    """The most that noise alone leaves of ½χ² [nats]: more than that counts, see `remaining`."""
    return 0.5 * samples + EXCESS_SIGMAS * math.sqrt(0.5 * samples)


@dataclasses.dataclass(frozen=True)
class EvaluatedFit:
    """A fit with its residuals on all runs.

    Args:
        fit: the fit, to the runs that its problem names.
        residuals: (measured − model − deviations of the bench)/noise by run and signal, for all runs of the campaign.
        bench: the estimated deviations of the bench.
    """

    fit: Fit
    residuals: dict[str, dict[str, np.ndarray]]
    bench: BenchEstimate

    @functools.cached_property
    def equations(self) -> list[RunEquations]:
        """The normal equations of the fitted runs at the fit."""
        return self.fit.problem.equations(self.fit.outcomes)

    @property
    def samples(self) -> int:
        """Number of whitened samples of the fitted runs."""
        return sum(e.samples for e in self.equations)

    @property
    def cost(self) -> float:
        """½χ² of residuals, bench deviations and prior of the fitted runs (half the chi-square scale)."""
        return self.fit.cost

    @property
    def excess(self) -> float:
        """What ½χ² exceeds its expectation under noise alone by [nats]: the misfit that the model leaves."""
        return self.cost - 0.5 * self.samples

    @property
    def residual_over_noise(self) -> float:
        """The root mean square of residuals over noise that ½χ² corresponds to; 1 under noise alone."""
        return math.sqrt(max(2.0 * self.cost / max(self.samples, 1), 0.0))

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
        """Root mean square of the residuals over noise over the runs of one use; NaN where there are none."""
        rows = self.run_residuals(self.fit.problem.campaign.runs_for(use))
        return rms_over_noise(rows) if rows else math.nan

    def holdout_half_chi_square(self) -> np.ndarray:
        """½Σ(residual/noise)² for each held-out run and signal; for all runs where none is held out."""
        campaign = self.fit.problem.campaign
        runs = campaign.runs_for(Use.HOLDOUT) or campaign.runs
        return np.array([0.5 * np.nansum(np.square(v)) for v in self.run_residuals(runs)])


def fit_coarse(
    problem: FitProblem, starts: np.ndarray, steps_per_sample: int, max_steps: int,
    keep_on: Callable[[float, float], bool] | None = None, known: Sequence[PredictedSignals] | None = None,
) -> EvaluatedFit:  # fmt: skip
    """Fit at one time step, without the refinements of a final fit, and evaluate the fit on all runs.

    Args:
        problem: what is fitted.
        starts: coordinates of one start (n,) or of several (k, n); the best end point is taken.
        steps_per_sample: time steps per sample.
        max_steps: maximum number of Levenberg-Marquardt steps.
        keep_on: asked after a few steps with the number of steps so far and ½χ²; False ends the search early.
        known: signals and sensitivities of the fitted runs at the start, where they have been predicted already.

    Raises:
        FitError: the model fails at every point that was evaluated.
    """
    if problem.is_irregular:
        return _fit_by_ensemble(problem, starts, steps_per_sample, max_steps, keep_on)
    found, model = _search(problem, starts, steps_per_sample, max_steps, keep_on, known)
    best = int(np.argmin(found.model.cost))
    x, cost = found.x[best], float(found.model.cost[best])
    if not (np.isfinite(cost) and np.isfinite(found.model.curvature[best]).all()):
        raise FitError(MODEL_FAILS)
    outcomes = model.outcomes_at(best, x)
    if outcomes is None:
        (outcomes,) = problem.predict(x[None], steps_per_sample, with_sensitivities=True)
    fitted = Fit(
        problem, x, x, regularised_inverse(found.model.curvature[best]), cost, outcomes,
        TimeResolution(steps_per_sample, steps_per_sample, math.nan), bool(found.converged[best]), found.model.cost,
    )  # fmt: skip
    return evaluate_fit(fitted)


def _fit_by_ensemble(
    problem: FitProblem,
    starts: np.ndarray,
    steps_per_sample: int,
    max_steps: int,
    keep_on: Callable[[float, float], bool] | None,
) -> EvaluatedFit:
    """As `fit_coarse`, for a model whose signals depend irregularly on its unknowns."""
    end = minimise_by_ensemble(problem, starts, steps_per_sample, ENSEMBLE_STEPS * max_steps, keep_on)
    if end is None or not all(np.isfinite(part).all() for part in (end.model.cost, end.model.curvature)):
        raise FitError(MODEL_FAILS)
    fitted = Fit(
        problem, end.x, end.x, regularised_inverse(end.model.curvature[0]), float(end.model.cost[0]), end.outcomes,
        TimeResolution(steps_per_sample, steps_per_sample, math.nan), end.converged, end.model.cost,
    )  # fmt: skip
    return evaluate_fit(fitted)


def find_minima(problem: FitProblem, starts: np.ndarray, steps_per_sample: int, max_steps: int) -> Minima:
    """The end points of least-squares fits from one start (n,) or several (k, n); arguments as in `fit_coarse`."""
    return _search(problem, starts, steps_per_sample, max_steps, None)[0]


def _search(
    problem: FitProblem, starts: np.ndarray, steps_per_sample: int, max_steps: int,
    keep_on: Callable[[float, float], bool] | None, known: Sequence[PredictedSignals] | None = None,
) -> tuple[Minima, SecantModel]:  # fmt: skip
    starts, model = np.atleast_2d(starts), SecantModel(problem, steps_per_sample, known)
    low, high = np.array([u.bounds() for u in problem.unknowns]).T
    updates = model.fits_in_memory(len(starts))
    steps = math.ceil(UPDATED_STEPS * max_steps) if updates else max_steps
    found = levenberg_marquardt(
        model.evaluate, starts, low, high, tolerance=COST_TOLERANCE, max_steps=steps, merge=COST_TOLERANCE,
        constraints=problem.constraints(), relative_tolerance=RELATIVE_COST_TOLERANCE,
        keep_on=None if keep_on is None else lambda step, costs: keep_on(step, float(np.min(costs))),
        update=model.update if updates else None,
    )  # fmt: skip
    return found, model


def evaluate_fit(fitted: Fit) -> EvaluatedFit:
    """Predict the other runs of the campaign with a fitted model, and estimate the deviations of the bench."""
    problem, campaign = fitted.problem, fitted.problem.campaign
    fitted_runs = problem.model().runs
    predicted = dict(zip((run.name for run in fitted_runs), fitted.outcomes, strict=True))
    others = tuple(run for run in campaign.runs if run.name not in predicted)
    if others:
        own = {run.name: run for run in fitted.campaign.runs}
        others = tuple(own[run.name] for run in others)
        found = dataclasses.replace(problem, runs=others).model().predict_all_runs(
            fitted.x, fitted.resolution.coarse, with_sensitivities=True
        )  # fmt: skip
        predicted |= {run.name: problem.corrected(run, found[r]) for r, run in enumerate(others)}
    bench, residuals = estimate_bench(
        campaign, fitted_runs, others, predicted, problem.unknowns, problem.bench, problem.equations(fitted.outcomes)
    )
    return EvaluatedFit(fitted, residuals, bench)


def start_coordinates(problem: FitProblem, values: dict[str, float]) -> np.ndarray:
    """Coordinates (n,) of a problem at known values (SI) by name; the centre of the prior for the other unknowns."""
    return np.array([u.coordinate(values[u.name]) if u.name in values else 0.0 for u in problem.unknowns])


def solver_error(problem: FitProblem, x: np.ndarray, coarse: int, fine: int) -> SolverError:
    """What a fine time step adds to the signals of all runs of the campaign at one point.

    A wrong model has nearly the same solver error as the right one, so that this difference, taken once, makes fits
    at the coarse step as accurate as at the fine one.

    Args:
        problem: the model.
        x: coordinates of the unknowns (n,).
        coarse: coarse time steps per sample.
        fine: fine time steps per sample.

    Returns:
        By run and signal, the difference (samples,) in SI; 0 where either simulation fails.

    Source: Stetter, The defect correction principle, Numer. Math. 29 (1978) 425.
    """
    model = MeasurementModel(
        problem.campaign, problem.machine, problem.unknowns, problem.campaign.runs, problem.instruments
    )
    rough, exact = model.predict_all_runs(x, coarse), model.predict_all_runs(x, fine)
    return {
        run.name: {
            n: np.nan_to_num(exact[r].values[n] - v, nan=0.0, posinf=0.0, neginf=0.0)
            for n, v in rough[r].values.items()
        }
        for r, run in enumerate(model.runs)
    }


def _without_branches(evaluated: EvaluatedFit, error: SolverError) -> SolverError:
    """The solver's error without that of runs which take another branch at the fine step.

    Where a friction just sticks or a valve just opens, the smallest change decides. If the coarse step has followed the
    measurements and the fine one does not, the difference is no error of the solver.
    """
    channels, previous = evaluated.fit.problem.campaign.channels, evaluated.fit.problem.solver_error or {}
    kept = {}
    for run, rows in error.items():
        before = after = 0.0
        for n, residual in evaluated.residuals[run].items():
            change = rows[n] - (previous[run][n] if run in previous else 0.0)
            before += float(np.nansum(np.square(residual)))
            after += float(np.nansum(np.square(residual - change[: len(residual)] / channels[n].noise)))
        if after < MAX_RISE * before:
            kept[run] = rows
    return kept


def with_solver_error(evaluated: EvaluatedFit, resolution: TimeResolution, max_steps: int) -> EvaluatedFit:
    """Refit with the solver's error at the present estimate removed; unchanged where the model then fails.

    The error is computed again at the new estimate, and where it has changed the fit much, that is repeated too.
    """
    found, steps = evaluated, max_steps
    for _ in range(SOLVER_CORRECTIONS):
        before, problem = found, _with_error_at(found, resolution)
        if problem is before.fit.problem:
            return found
        known = _outcomes_in(problem, before.fit)
        try:
            found = fit_coarse(problem, before.fit.x, resolution.coarse, steps, known=known)
        except FitError:
            return before
        steps = max_steps if abs(found.cost - before.cost) > MIN_SOLVER_CHANGE else 0
    return found


def with_own_solver_error(
    evaluated: EvaluatedFit, resolution: TimeResolution, max_steps: int,
    keep_on: Callable[[float, float], bool] | None = None,
) -> EvaluatedFit:  # fmt: skip
    """Refit with the solver's error at the estimate of a fit, where it changes ½χ² clearly against the one that it has.

    Args:
        evaluated: a fit with the solver's error at another estimate, or of a smaller model.
        resolution: coarse and fine time steps per sample.
        max_steps: maximum number of steps of the second fit.
        keep_on: see `fit_coarse`.
    """
    fit, problem = evaluated.fit, _with_error_at(evaluated, resolution)
    if problem is fit.problem:
        return evaluated
    known = _outcomes_in(problem, fit)
    cost = float(quadratic_model(problem, fit.x, problem.equations(known)).cost[0])
    if not abs(cost - fit.cost) > MIN_SOLVER_CHANGE:
        return evaluated
    try:
        return fit_coarse(problem, fit.x, resolution.coarse, max_steps, keep_on, known)
    except FitError:
        return evaluated


def _outcomes_in(problem: FitProblem, fit: Fit) -> tuple[PredictedSignals, ...]:
    """Signals and sensitivities of a fit as another problem corrects them, which has another solver's error only."""
    former, found = fit.problem.solver_error or {}, []
    for run, outcome in zip(problem.fitted_runs, fit.outcomes, strict=True):
        rows = former.get(run.name, {})
        plain = {n: v - rows[n][: len(v)] if n in rows else v for n, v in outcome.values.items()}
        found.append(problem.corrected(run, PredictedSignals(plain, outcome.sensitivities)))
    return tuple(found)


def _with_error_at(evaluated: EvaluatedFit, resolution: TimeResolution) -> FitProblem:
    """The problem of a fit with the solver's error at its estimate; unchanged where a finer step differs at random."""
    fit = evaluated.fit
    if fit.problem.is_irregular:
        return fit.problem
    error = solver_error(fit.problem, fit.x, resolution.coarse, REFINEMENT * resolution.fine)
    return dataclasses.replace(fit.problem, solver_error=_without_branches(evaluated, error))
