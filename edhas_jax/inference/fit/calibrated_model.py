"""The calibrated model: its uncertain parameters fitted before any effect is added, and the time step for that."""

import dataclasses
from collections.abc import Callable

import numpy as np

from edhas_jax.inference.fit.evaluated_fit import (
    EvaluatedFit,
    fit_coarse,
    remaining,
    start_coordinates,
    with_solver_error,
)
from edhas_jax.inference.fit.fit_problem import FitError, calibration_problem
from edhas_jax.inference.fit.local_minima import fit_across_minima, fit_progressively
from edhas_jax.inference.fit.settled_fit import settle, with_tightened_bench, without_wrong_samples
from edhas_jax.inference.fit.unpredictable_part import unpredictable_part, with_unpredictable_part
from edhas_jax.inference.likelihood.slow_residuals import slow_excess
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.time_resolution import (
    MAX_COARSE_ERROR_OVER_NOISE,
    TimeResolution,
    choose_time_resolution,
    step_error,
)

CALIBRATION_STEPS, NEXT_STEPS = 25, 12  # maximum number of Levenberg-Marquardt steps: of the first fit, of later ones
PROGRESSIVE_EXCESS = 0.5  # of χ² over the number of samples, from which growing parts of the runs are fitted
IRREGULAR_STEPS = 25  # maximum number of steps where the signals depend irregularly on the parameters
MAX_HALVINGS = 3  # most halvings of the time step where its error at the fitted parameters is too large
NEAR_THE_NOISE = 1.5  # rms of the residual over the noise, up to which a finer step is tried against irregular signals
SMALLEST_REGULAR_STEP = 0.25  # of the step with which a run of the machine begins; the finest one that is tried there

Report = Callable[[str], None]


def calibrate(campaign: Campaign, on_progress: Report | None = None) -> tuple[EvaluatedFit, TimeResolution]:
    """Fit the uncertain parameters before any effect is added: the fit from which the search begins.

    Args:
        campaign: measurements, model, prior of the uncertain parameters, and noise of the sensors.
        on_progress: called with a sentence on the progress.

    Returns:
        The fit, the solver's error removed, and the time steps per sample. Coarse and fine ones are the same: where a
        valve bounces, the cost has false minima at a coarser step, whether its error is removed or not.

    Raises:
        FitError: there is nothing to fit, or the model cannot be fitted.
    """
    report = on_progress or (lambda sentence: None)
    problem = calibration_problem(campaign)
    centre = start_coordinates(problem, {})
    report("choosing the time step")
    chosen = choose_time_resolution(problem.model(), centre)
    resolution = _one_step(chosen, chosen.fine)
    report("fitting the uncertain parameters")
    calibrated = fit_coarse(problem, centre, resolution.coarse, CALIBRATION_STEPS)
    if _leaves_much(calibrated):
        better = settle(calibrated, resolution, report)  # a wrong clock, or too few steps, may leave that much
        if _leaves_much(better):
            report("fitting growing parts of the runs")
            starts = np.array([centre, calibrated.fit.x])
            better = fit_progressively(problem, starts, 1, resolution.coarse, NEXT_STEPS, calibrated) or calibrated
        calibrated = better
    calibrated, resolution = _with_accurate_step(calibrated, resolution, report)
    if deviations := unpredictable_part(calibrated.fit.problem, calibrated.fit.x, resolution.coarse):
        finer = _regular_steps(calibrated, resolution.coarse, report)
        if finer is None:
            # what scatters at random need not be computed quite as accurately
            resolution = _one_step(resolution, max(chosen.coarse, resolution.coarse // 2))
            return _fitted_by_ensemble(calibrated, deviations, resolution, report)
        resolution = _one_step(resolution, finer)
        calibrated = fit_coarse(calibrated.fit.problem, calibrated.fit.x, finer, CALIBRATION_STEPS)
    calibrated = with_tightened_bench(calibrated, resolution.coarse)
    settled = with_tightened_bench(settle(calibrated, resolution, report), resolution.coarse)
    report("looking for a better minimum")
    across = fit_across_minima(settled, resolution.coarse)
    if across is not settled:
        settled = min(settled, with_solver_error(across, resolution, NEXT_STEPS), key=lambda of: of.cost)
    return without_wrong_samples(settled, resolution), resolution


def _leaves_much(fit: EvaluatedFit) -> bool:
    """Whether a fit leaves so much that it may have ended in a wrong minimum."""
    return fit.excess > PROGRESSIVE_EXCESS * 0.5 * fit.samples


def _one_step(resolution: TimeResolution, steps: int) -> TimeResolution:
    """One number of time steps per sample for all fits."""
    return resolution._replace(coarse=steps, fine=steps)


def _with_accurate_step(
    calibrated: EvaluatedFit, resolution: TimeResolution, report: Report
) -> tuple[EvaluatedFit, TimeResolution]:
    """The fit and its time step, which is small enough for an error at the fit below the noise or the residual.

    It is halved at most `MAX_HALVINGS` times. It was chosen at the prior means; where a friction sticks at the fitted
    parameters only, its error is larger there.
    """
    for _ in range(MAX_HALVINGS):
        model, steps = calibrated.fit.problem.model(), resolution.coarse
        error = step_error(model, calibrated.fit.x, steps)
        if error <= MAX_COARSE_ERROR_OVER_NOISE * max(calibrated.residual_over_noise, 1.0):
            break
        report("checking the time step")
        finer = _one_step(resolution, 2 * steps)
        try:
            calibrated = fit_coarse(calibrated.fit.problem, calibrated.fit.x, finer.coarse, CALIBRATION_STEPS)
        except FitError:
            break
        resolution = finer
    return calibrated, resolution


def _regular_steps(calibrated: EvaluatedFit, steps: int, report: Report) -> int | None:
    """The first of 2, 4, … times `steps` per sample at which the signals depend smoothly on the parameters.

    None where no step down to `SMALLEST_REGULAR_STEP` does. None also where the residual is far above the noise: then
    the search for missing effects, with its many fits, would take too long at a finer step.
    """
    if calibrated.residual_over_noise > NEAR_THE_NOISE:
        return None
    problem = calibrated.fit.problem
    model = problem.model()
    while model.longest_interval() / (2 * steps) >= SMALLEST_REGULAR_STEP * model.machine.time_step:
        report("the signals depend irregularly on the parameters: trying a finer time step")
        steps *= 2
        if not unpredictable_part(problem, calibrated.fit.x, steps):
            return steps
    return None


def _fitted_by_ensemble(
    calibrated: EvaluatedFit, deviations: dict[str, float], resolution: TimeResolution, report: Report
) -> tuple[EvaluatedFit, TimeResolution]:
    """The fit, and the time steps, where signals depend irregularly on the parameters.

    Args:
        calibrated: a fit with derivatives along single runs.
        deviations: what the model cannot predict, as a standard deviation (SI) by signal.
        resolution: the time steps.
        report: called with a sentence on the progress.
    """
    report("the signals depend irregularly on the parameters: fitting with an ensemble")
    fit, steps = calibrated.fit, resolution.coarse
    problem = dataclasses.replace(
        fit.problem, campaign=with_unpredictable_part(fit.problem.campaign, deviations), solver_error=None
    )
    found = with_tightened_bench(fit_coarse(problem, fit.x, steps, IRREGULAR_STEPS), steps)
    return without_wrong_samples(settle(found, resolution, report), resolution), resolution


def misfit_beyond_noise(calibrated: EvaluatedFit) -> float:
    """The excess of ½χ² of the calibrated model beyond the scatter of noise, over all or at low frequencies [nats]."""
    problem = calibrated.fit.problem
    slow = slow_excess(problem.campaign, problem.model().runs, calibrated.residuals)
    return max(remaining(calibrated.excess, calibrated.samples), slow)
