"""Completion of a fit: solver error and time stamps corrected, the bench limited, wrong samples left out."""

import dataclasses
from collections.abc import Callable

import numpy as np

from edhas_jax.inference.fit.evaluated_fit import EvaluatedFit, fit_coarse, noise_level, with_solver_error
from edhas_jax.inference.fit.fit_problem import FitError, TimeError
from edhas_jax.inference.fit.time_correction import (
    MIN_GAIN,
    added,
    best_common_shift,
    cost_with_time_errors,
    estimated_time_errors,
    largest_time_error,
    with_corrected_time,
)
from edhas_jax.inference.likelihood.bench_deviations import bench_deviations
from edhas_jax.inference.likelihood.residual_outliers import without_outliers
from edhas_jax.measurements.time_resolution import TimeResolution

CORRECTION_STEPS = 8  # maximum number of steps of a fit after the data were corrected
MIN_TIME_ERROR, MAX_TIME_CORRECTIONS = 2e-5, 2  # time error [s] from which time stamps are corrected, and how often
MIN_REMOVED_SHARE = 0.5  # of the misfit, which a correction of the time stamps must remove,
PREDICTED_SHARE = 0.5  # of that share, which the interpolated signals must promise before anything is simulated
# of the accuracy of the trigger
TRIGGER_GRID = np.array([-2.0, -1.5, -1.0, -0.7, -0.4, -0.2, 0.2, 0.4, 0.7, 1.0, 1.5, 2.0])
# residual over the noise that a bench with many small causes may leave; ratio of two limits of its deviations below
# which they count as the same; how often they are tightened, as a fit with tighter ones leaves a larger residual
MIN_TIGHT_RESIDUAL, SAME_TIGHTENING, MAX_TIGHTENINGS = 1.5, 1.25, 3


def settle(evaluated: EvaluatedFit, resolution: TimeResolution, report: Callable[[str], None]) -> EvaluatedFit:
    """Refit with the solver's error removed and, where that explains much of the misfit, with the time corrected.

    Args:
        evaluated: a fit at the coarse time step.
        resolution: coarse and fine time steps per sample.
        report: called with a sentence on the progress.
    """
    found = with_solver_error(evaluated, resolution, CORRECTION_STEPS)
    for correction in range(MAX_TIME_CORRECTIONS):
        if not found.cost > noise_level(found.samples):
            break
        fitted, campaign = found.fit, found.fit.problem.campaign
        errors = estimated_time_errors(found.bench, fitted.problem.bench)
        if correction == 0 and campaign.accuracy.trigger > 0.0:
            grid = campaign.accuracy.trigger * TRIGGER_GRID
            gain = MIN_REMOVED_SHARE * found.excess
            common = best_common_shift(fitted.problem, fitted.x, fitted.outcomes, grid, gain)
            errors = {run.name: (common,) for run in campaign.runs} if common else errors
        if largest_time_error(campaign, errors) < MIN_TIME_ERROR:
            break
        predicted = cost_with_time_errors(fitted.problem, fitted.x, fitted.outcomes, errors)
        if not found.cost - predicted > PREDICTED_SHARE * MIN_REMOVED_SHARE * found.excess:
            break
        report("correcting the time of the records")
        corrected = _corrected(found, errors, resolution)
        if corrected is None or not corrected.excess <= (1.0 - MIN_REMOVED_SHARE) * found.excess:
            break
        found = corrected
    return found


def settled_with_effects(
    evaluated: EvaluatedFit, resolution: TimeResolution, report: Callable[[str], None]
) -> EvaluatedFit:
    """The fit of a model with effects that began at the calibrated one: bench, solver and time as it needs them.

    Args:
        evaluated: a fit at the coarse time step.
        resolution: coarse and fine time steps per sample.
        report: called with a sentence on the progress.
    """
    settled = settle(with_tightened_bench(evaluated, resolution.coarse), resolution, report)
    return with_recorded_time(settled, resolution, report)


def with_recorded_time(
    evaluated: EvaluatedFit, resolution: TimeResolution, report: Callable[[str], None]
) -> EvaluatedFit:
    """The fit with the time stamps as recorded, where a model with one more effect needs no correction of them.

    A model that lacks the lag of a sensor, for example, may fit better with all records shifted, but not with the lag.

    Args:
        evaluated: a fit, the solver's error removed.
        resolution: coarse and fine time steps per sample.
        report: called with a sentence on the progress.
    """
    errors = evaluated.fit.problem.time_errors
    if not any(map(any, errors.values())):
        return evaluated
    report("the same with the time stamps as recorded")
    recorded = _corrected(evaluated, {run: tuple(-c for c in of) for run, of in errors.items()}, resolution)
    return recorded if recorded is not None and recorded.cost < evaluated.cost + MIN_GAIN else evaluated


def _corrected(
    evaluated: EvaluatedFit, errors: dict[str, TimeError], resolution: TimeResolution
) -> EvaluatedFit | None:
    """The fit with the time stamps of the records corrected; None where the model then fails."""
    problem = evaluated.fit.problem
    campaign = with_corrected_time(problem.campaign, errors)
    corrected = dataclasses.replace(
        problem, campaign=campaign, bench=bench_deviations(campaign, problem.unknowns), solver_error=None,
        time_errors=added(problem.time_errors, errors),
    )  # fmt: skip
    try:
        found = fit_coarse(corrected, evaluated.fit.x, resolution.coarse, CORRECTION_STEPS)
    except FitError:
        return None
    return with_solver_error(found, resolution, CORRECTION_STEPS)


def with_tightened_bench(evaluated: EvaluatedFit, steps_per_sample: int) -> EvaluatedFit:
    """The fit with deviations of the bench as tight as its residual demands; the given one where they are.

    Deviations of settings and sensors have priors, not limits. Where a model leaves a residual of many times the noise,
    χ² pays for a setting that is a hundred times its accuracy off, which hides the missing effect and distorts all
    parameters. As long as the residual is r times the noise, r clearly above 1, deviations are therefore allowed 1/r of
    their accuracy: their priors then weigh as if the noise were as large as the residual.

    Args:
        evaluated: a fit.
        steps_per_sample: time steps per sample.
    """
    found = evaluated
    for _ in range(MAX_TIGHTENINGS):
        problem = found.fit.problem
        residual = found.residual_over_noise
        wanted, present = residual if residual > MIN_TIGHT_RESIDUAL else 1.0, problem.campaign.tightening
        if max(wanted / present, present / wanted) < SAME_TIGHTENING:
            break
        campaign = dataclasses.replace(problem.campaign, tightening=wanted)
        problem = dataclasses.replace(problem, campaign=campaign, bench=bench_deviations(campaign, problem.unknowns))
        try:
            found = fit_coarse(problem, found.fit.x, steps_per_sample, CORRECTION_STEPS)
        except FitError:
            break
    return found


def without_wrong_samples(settled: EvaluatedFit, resolution: TimeResolution) -> EvaluatedFit:
    """Refit without the wrong samples that the residuals show; the given fit where there are none.

    Args:
        settled: a fit that leaves as little as the model can.
        resolution: coarse and fine time steps per sample.
    """
    problem = settled.fit.problem
    campaign = without_outliers(problem.campaign, settled.residuals)
    if campaign is problem.campaign:
        return settled
    try:
        problem = dataclasses.replace(problem, campaign=campaign)
        return fit_coarse(problem, settled.fit.x, resolution.coarse, CORRECTION_STEPS)
    except FitError:
        return settled
