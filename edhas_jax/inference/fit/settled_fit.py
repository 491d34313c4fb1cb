"""Completion of a fit: solver error and time stamps corrected, the bench limited, wrong samples left out."""

import dataclasses
from collections.abc import Callable

import numpy as np

from edhas_jax.inference.fit.evaluated_fit import EvaluatedFit, fit_coarse, with_solver_error
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.inference.fit.fit_problem import FitError, FitProblem, TimeError
from edhas_jax.inference.fit.time_correction import (
    MIN_GAIN,
    added,
    best_common_shift,
    cost_after_step,
    cost_with_time_errors,
    estimated_time_errors,
    largest_time_error,
    with_clock_error,
    with_corrected_time,
)
from edhas_jax.inference.likelihood.bench_deviations import DeviationKind, bench_deviations
from edhas_jax.inference.likelihood.residual_outliers import without_outliers
from edhas_jax.measurements.time_resolution import TimeResolution

CORRECTION_STEPS = 8  # maximum number of steps of a fit after the data were corrected
MIN_TIME_ERROR, MAX_TIME_CORRECTIONS = 2e-5, 2  # time error [s] from which time stamps are corrected, and how often
MIN_REMOVED_SHARE = 0.5  # of the misfit, which a correction of the time stamps must remove,
MIN_REMOVED_BY_CLOCK = 0.1  # and the same where the clock has an error
PREDICTED_SHARE = 0.5  # of that share, which the interpolated signals must promise before anything is simulated
# of the accuracy of the trigger
TRIGGER_GRID = np.array([-2.0, -1.5, -1.0, -0.7, -0.4, -0.2, 0.2, 0.4, 0.7, 1.0, 1.5, 2.0])
# Where no error of the clock is stated, one of this standard deviation [s] is tried. It is kept if ½χ² falls by
# `MIN_REMOVED_SHARE` of the misfit and by so much [nats] per coefficient of the polynomials.
UNSTATED_CLOCK_ERROR, MIN_GAIN_OF_COEFFICIENT = 5e-5, 2.0
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
        found = _with_inexact_clock(found, resolution, report)
        fitted, campaign = found.fit, found.fit.problem.campaign
        share = MIN_REMOVED_BY_CLOCK if campaign.accuracy.clock_error else MIN_REMOVED_SHARE
        errors = estimated_time_errors(found.bench, fitted.problem.bench)
        if correction == 0 and campaign.accuracy.trigger > 0.0:
            grid = campaign.accuracy.trigger * TRIGGER_GRID
            gain = MIN_REMOVED_SHARE * max(found.excess, 0.0)
            common = best_common_shift(fitted.problem, fitted.x, fitted.outcomes, grid, gain)
            errors = {run.name: (common,) for run in campaign.runs} if common else errors
        if largest_time_error(campaign, errors) < MIN_TIME_ERROR:
            break
        predicted = cost_with_time_errors(fitted.problem, fitted.x, fitted.outcomes, errors)
        if not found.cost - predicted > max(PREDICTED_SHARE * share * found.excess, 0.0):
            break
        report("correcting the time of the records")
        corrected = _corrected(found, errors, resolution)
        if corrected is None or not corrected.excess <= (1.0 - share) * found.excess:
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


def _with_inexact_clock(found: EvaluatedFit, resolution: TimeResolution, report: Callable[[str], None]) -> EvaluatedFit:
    """Refit with an error of the clock, where none is stated and it explains much of the misfit."""
    fitted, problem = found.fit, found.fit.problem
    if problem.campaign.accuracy.clock_error is not None or problem.is_irregular:
        return found
    campaign = with_clock_error(problem.campaign, UNSTATED_CLOCK_ERROR)
    inexact = dataclasses.replace(problem, campaign=campaign, bench=bench_deviations(campaign, problem.unknowns))
    coefficients = sum(d.kind is DeviationKind.CLOCK for d in inexact.bench.of_runs) * len(problem.model().runs)
    by_chance = MIN_GAIN_OF_COEFFICIENT * coefficients
    least = max(MIN_REMOVED_SHARE * found.excess, by_chance)
    if not found.cost - cost_after_step(inexact, fitted.x, fitted.outcomes) > least:
        return found
    if not _is_common_to_signals(fitted, inexact, by_chance):
        return found
    report("fitting with an error of the recorder's clock")
    try:
        refitted = fit_coarse(inexact, fitted.x, resolution.coarse, CORRECTION_STEPS)
    except FitError:
        return found
    return refitted if found.cost - refitted.cost > least else found


def _is_common_to_signals(fitted: Fit, inexact: FitProblem, by_chance: float) -> bool:
    """Whether an error of the clock explains much of the misfit whichever signal is left out.

    A clock shifts all signals of its recorder, the lag of a sensor only one.

    Args:
        fitted: the fit with an exact clock.
        inexact: its problem with an error of the clock.
        by_chance: what that may explain by chance [nats].
    """
    problem = fitted.problem
    for name in problem.campaign.channels:
        runs = tuple(run.without_signals({name}) for run in problem.model().runs)
        if not all(run.signals for run in runs):
            continue
        before, after = (
            cost_after_step(dataclasses.replace(p, runs=runs), fitted.x, fitted.outcomes) for p in (problem, inexact)
        )
        excess = before - 0.5 * sum(run.valid_samples for run in runs)
        if not before - after > max(MIN_REMOVED_SHARE * excess, by_chance):
            return False
    return True


def _corrected(
    evaluated: EvaluatedFit, errors: dict[str, TimeError], resolution: TimeResolution
) -> EvaluatedFit | None:
    """The fit with the time stamps of the records corrected; None where the model then fails."""
    problem = evaluated.fit.problem
    corrected = dataclasses.replace(
        problem, campaign=with_corrected_time(problem.campaign, errors), solver_error=None,
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
