"""Completion of a fit at the coarse time step: the solver's error and the start of the records corrected."""

import dataclasses
from collections.abc import Callable

import numpy as np

from edhas_jax.diagnosis.calibration.fit_problem import FitError
from edhas_jax.diagnosis.likelihood.residual_outliers import without_outliers
from edhas_jax.diagnosis.likelihood.trigger_correction import (
    best_common_shift,
    cost_with_shifts,
    trigger_shifts,
    with_shifted_time,
)
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit, fit_coarse, with_solver_error
from edhas_jax.measurements.time_resolution import TimeResolution

CORRECTION_STEPS = 8  # maximum number of Levenberg-Marquardt steps
# time by which records start early or late: from which on it is corrected exactly [s], how often, and the share of the
# misfit that the correction must remove
MIN_TRIGGER_SHIFT, MAX_CORRECTIONS, MIN_REMOVED_SHARE = 2e-5, 2, 0.5
PREDICTED_SHARE = 0.5  # of that share, which the interpolated signals must promise before anything is simulated
# of the accuracy of the trigger
TRIGGER_GRID = np.array([-2.0, -1.5, -1.0, -0.7, -0.4, -0.2, 0.2, 0.4, 0.7, 1.0, 1.5, 2.0])


def settle(evaluated: EvaluatedFit, resolution: TimeResolution, report: Callable[[str], None]) -> EvaluatedFit:
    """Refit with the solver's error removed and, where that explains much of the misfit, with the records shifted.

    Args:
        evaluated: a fit at the coarse time step.
        resolution: coarse and fine time steps per sample.
        report: called with a sentence on the progress.
    """
    found = with_solver_error(evaluated, resolution, CORRECTION_STEPS)
    for correction in range(MAX_CORRECTIONS):
        fitted, campaign = found.fit, found.fit.problem.campaign
        shifts = trigger_shifts(found.bench, fitted.problem.bench)
        if correction == 0 and campaign.accuracy.trigger > 0.0:
            grid = campaign.accuracy.trigger * TRIGGER_GRID
            gain = MIN_REMOVED_SHARE * max(found.excess, 0.0)
            common = best_common_shift(fitted.problem, fitted.x, fitted.outcomes, grid, gain)
            shifts = {run.name: common for run in campaign.runs} if common else shifts
        if max(map(abs, shifts.values()), default=0.0) < MIN_TRIGGER_SHIFT:
            break
        predicted = cost_with_shifts(fitted.problem, fitted.x, fitted.outcomes, shifts)
        if not found.cost - predicted > PREDICTED_SHARE * MIN_REMOVED_SHARE * found.excess:
            break
        report("correcting the start of the records")
        shifted = _shifted(found, shifts, resolution)
        if shifted is None or shifted.excess > (1.0 - MIN_REMOVED_SHARE) * found.excess:
            break
        found = shifted
    return found


def _shifted(evaluated: EvaluatedFit, shifts: dict[str, float], resolution: TimeResolution) -> EvaluatedFit | None:
    """The fit with the records shifted in time; None where the model then fails."""
    problem = evaluated.fit.problem
    total = {name: problem.time_shifts.get(name, 0.0) + shift for name, shift in shifts.items()}
    shifted = dataclasses.replace(
        problem, campaign=with_shifted_time(problem.campaign, shifts), solver_error=None, time_shifts=total
    )
    try:
        found = fit_coarse(shifted, evaluated.fit.x, resolution.coarse, CORRECTION_STEPS)
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
