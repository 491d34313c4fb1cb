"""The calibrated model: its uncertain parameters fitted before any effect is added, and the time step for that."""

import dataclasses
from collections.abc import Callable

import numpy as np

from edhas_jax.diagnosis.calibration.fit_problem import FitError
from edhas_jax.diagnosis.calibration.unpredictable_part import unpredictable_part, with_unpredictable_part
from edhas_jax.diagnosis.likelihood.slow_residuals import slow_excess
from edhas_jax.diagnosis.search.candidates import build_problem
from edhas_jax.diagnosis.search.decision_rules import remaining
from edhas_jax.diagnosis.search.evaluated_fit import (
    REFINEMENT,
    EvaluatedFit,
    fit_coarse,
    solver_error,
    start_coordinates,
)
from edhas_jax.diagnosis.search.progressive_fit import fit_progressively
from edhas_jax.diagnosis.search.settled_fit import settle, without_wrong_samples
from edhas_jax.diagnosis.search.tightened_bench import with_tightened_bench
from edhas_jax.diagnosis.search.trial import TRIAL_STEPS
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.time_resolution import TimeResolution, choose_time_resolution

CALIBRATION_STEPS = 25  # maximum number of Levenberg-Marquardt steps
PROGRESSIVE_EXCESS = 0.5  # of χ² over the number of samples, from which growing parts of the runs are fitted
IRREGULAR_STEPS = 25  # maximum number of steps where the signals depend irregularly on the parameters
CHECK_STEPS = 6  # the same for the check of the time step
STEP_SHARE = 0.1  # of the misfit: if half the coarse step removes more, it was too coarse

Report = Callable[[str], None]


def calibrate(campaign: Campaign, on_progress: Report | None = None) -> tuple[EvaluatedFit, TimeResolution]:
    """Fit the uncertain parameters before any effect is added: the fit from which the search begins.

    Args:
        campaign: measurements, model, prior of the uncertain parameters, and noise of the sensors.
        on_progress: called with a sentence on the progress.

    Returns:
        The fit, the solver's error removed, and the time steps per sample.

    Raises:
        FitError: there is nothing to fit, or the model cannot be fitted.
    """
    report = on_progress or (lambda sentence: None)
    problem = build_problem(campaign, campaign.machine, Instruments(), ())
    centre = start_coordinates(problem, {})
    report("choosing the time step")
    resolution = choose_time_resolution(problem.model(), centre)
    report("fitting the uncertain parameters")
    try:
        calibrated = fit_coarse(problem, centre, resolution.coarse, CALIBRATION_STEPS)
    except FitError:  # derivatives need a finer step than signals where valves bounce
        resolution = TimeResolution(resolution.fine, resolution.fine, resolution.error)
        calibrated = fit_coarse(problem, centre, resolution.coarse, CALIBRATION_STEPS)
    if calibrated.excess > PROGRESSIVE_EXCESS * 0.5 * calibrated.samples:
        report("fitting growing parts of the runs")
        starts = np.array([centre, calibrated.fit.x])
        better = fit_progressively(problem, starts, 1, resolution.coarse, TRIAL_STEPS, calibrated)
        calibrated = better or calibrated
    if (irregular := _irregular(calibrated, resolution, report)) is not None:
        return irregular
    calibrated = with_tightened_bench(calibrated, resolution.coarse)
    settled, resolution = _with_sufficient_step(settle(calibrated, resolution, report), resolution, report)
    settled = with_tightened_bench(settled, resolution.coarse)
    return without_wrong_samples(settled, resolution), resolution


def _irregular(
    calibrated: EvaluatedFit, resolution: TimeResolution, report: Report
) -> tuple[EvaluatedFit, TimeResolution] | None:
    """The fit, and the time steps, where signals depend irregularly on the parameters; None where they do smoothly.

    One time step serves all fits, because the difference between two steps is random there, and for the same reason it
    need not be quite as fine as elsewhere.
    """
    fit, steps = calibrated.fit, max(resolution.coarse, resolution.fine // 2)
    deviations = unpredictable_part(fit.problem, fit.x, steps)
    if not deviations:
        return None
    report("the signals depend irregularly on the parameters: fitting with an ensemble")
    problem = dataclasses.replace(
        fit.problem, campaign=with_unpredictable_part(fit.problem.campaign, deviations), solver_error=None
    )
    found = with_tightened_bench(fit_coarse(problem, fit.x, steps, IRREGULAR_STEPS), steps)
    resolution = TimeResolution(steps, steps, resolution.error)
    return without_wrong_samples(settle(found, resolution, report), resolution), resolution


def _with_sufficient_step(
    settled: EvaluatedFit, resolution: TimeResolution, report: Report
) -> tuple[EvaluatedFit, TimeResolution]:
    """The fit and the time steps, the coarse one halved as long as that removes a share of the misfit.

    At too coarse a step, a valve that bounces has minima of the cost that the fine one has not, even with the solver's
    error removed.
    """
    while resolution.coarse < resolution.fine and misfit(settled) > 0.0:
        finer = resolution._replace(coarse=min(2 * resolution.coarse, resolution.fine))
        report("checking the time step")
        error = solver_error(settled.fit.problem, settled.fit.x, finer.coarse, REFINEMENT * finer.fine)
        problem = dataclasses.replace(settled.fit.problem, solver_error=error)
        try:
            again = fit_coarse(problem, settled.fit.x, finer.coarse, CHECK_STEPS)
        except FitError:
            break
        if again.excess > (1.0 - STEP_SHARE) * settled.excess:
            break
        settled, resolution = settle(again, finer, report), finer
    return settled, resolution


def misfit(calibrated: EvaluatedFit) -> float:
    """The excess of ½χ² of the calibrated model beyond the scatter of noise, over all or at low frequencies [nats]."""
    problem = calibrated.fit.problem
    slow = slow_excess(problem.campaign, problem.model().runs, calibrated.residuals)
    return max(remaining(calibrated.excess, calibrated.samples), slow)
