"""Completion of a fit at the coarse time step: the solver's error and the time of the records corrected."""

import dataclasses
from collections.abc import Callable

import numpy as np

from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.calibration.fit_problem import FitError, FitProblem, TimeError
from edhas_jax.diagnosis.likelihood.bench_deviations import DeviationKind, bench_deviations
from edhas_jax.diagnosis.likelihood.residual_outliers import without_outliers
from edhas_jax.diagnosis.likelihood.time_correction import (
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
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit, fit_coarse, with_solver_error
from edhas_jax.measurements.time_resolution import TimeResolution

CORRECTION_STEPS = 8  # maximum number of Levenberg-Marquardt steps
# time by which records start early or late: from which on it is corrected exactly [s], how often, and the share of the
# misfit that the correction must remove; less where the clock is known to be wrong
MIN_TIME_ERROR, MAX_CORRECTIONS, MIN_REMOVED_SHARE, MIN_REMOVED_BY_CLOCK = 2e-5, 2, 0.5, 0.1
PREDICTED_SHARE = 0.5  # of that share, which the interpolated signals must promise before anything is simulated
# of the accuracy of the trigger
TRIGGER_GRID = np.array([-2.0, -1.5, -1.0, -0.7, -0.4, -0.2, 0.2, 0.4, 0.7, 1.0, 1.5, 2.0])
# standard deviation of the time [s] where the records show that the clock is wrong; what each coefficient of it must
# explain on average [nats], beside `MIN_REMOVED_SHARE` of the misfit together
DOUBTED_CLOCK, MIN_GAIN_OF_COEFFICIENT = 5e-5, 2.0


def settle(evaluated: EvaluatedFit, resolution: TimeResolution, report: Callable[[str], None]) -> EvaluatedFit:
    """Refit with the solver's error removed and, where that explains much of the misfit, with the time corrected.

    Args:
        evaluated: a fit at the coarse time step.
        resolution: coarse and fine time steps per sample.
        report: called with a sentence on the progress.
    """
    found = with_solver_error(evaluated, resolution, CORRECTION_STEPS)
    for correction in range(MAX_CORRECTIONS):
        found = _with_doubted_clock(found, resolution, report)
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
        if corrected is None or corrected.excess > (1.0 - share) * found.excess:
            break
        found = corrected
    return found


def with_recorded_time(
    evaluated: EvaluatedFit, resolution: TimeResolution, report: Callable[[str], None]
) -> EvaluatedFit:
    """The fit with the recorded time stamps, where a model with another effect needs no correction of them.

    A model that lacks the lag of a sensor, for example, is as good with all records shifted.

    Args:
        evaluated: a fit, the solver's error removed.
        resolution: coarse and fine time steps per sample.
        report: called with a sentence on the progress.
    """
    errors = evaluated.fit.problem.time_errors
    if not any(map(any, errors.values())):
        return evaluated
    report("the time of the records as it was recorded")
    back = _corrected(evaluated, {run: tuple(-c for c in of) for run, of in errors.items()}, resolution)
    return back if back is not None and back.cost < evaluated.cost + MIN_GAIN else evaluated


def _with_doubted_clock(
    found: EvaluatedFit, resolution: TimeResolution, report: Callable[[str], None]
) -> EvaluatedFit:
    """Refit with a clock that may be wrong, where nothing is stated about it and that explains much of the misfit."""
    fitted, problem = found.fit, found.fit.problem
    if problem.campaign.accuracy.clock_error is not None or problem.is_irregular:
        return found
    campaign = with_clock_error(problem.campaign, DOUBTED_CLOCK)
    doubted = dataclasses.replace(problem, campaign=campaign, bench=bench_deviations(campaign, problem.unknowns))
    coefficients = sum(d.kind is DeviationKind.CLOCK for d in doubted.bench.of_runs) * len(problem.model().runs)
    least = max(MIN_REMOVED_SHARE * found.excess, MIN_GAIN_OF_COEFFICIENT * coefficients)
    if not found.cost - cost_after_step(doubted, fitted.x, fitted.outcomes) > least:
        return found
    if not _is_common_to_signals(fitted, doubted, MIN_GAIN_OF_COEFFICIENT * coefficients):
        return found
    report("the clock of the recorder may be wrong")
    try:
        refitted = fit_coarse(doubted, fitted.x, resolution.coarse, CORRECTION_STEPS)
    except FitError:
        return found
    return refitted if found.cost - refitted.cost > least else found


def _is_common_to_signals(fitted: Fit, doubted: FitProblem, least: float) -> bool:
    """Whether a wrong clock explains much of the misfit of the other signals too, whichever one is left out.

    A clock moves all signals of its recorder, the lag of a sensor only one.
    """
    problem = fitted.problem
    for name in problem.campaign.channels:
        others = [{n: v for n, v in run.signals.items() if n != name} for run in problem.model().runs]
        if not all(others):
            continue
        runs = tuple(
            dataclasses.replace(run, signals=signals)
            for run, signals in zip(problem.model().runs, others, strict=True)
        )  # fmt: skip
        exact, wrong = (
            cost_after_step(dataclasses.replace(p, runs=runs), fitted.x, fitted.outcomes) for p in (problem, doubted)
        )
        excess = exact - 0.5 * sum(int(np.isfinite(v).sum()) for signals in others for v in signals.values())
        if not exact - wrong > max(MIN_REMOVED_SHARE * excess, least):
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
