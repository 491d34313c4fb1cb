"""Choose the time step of the simulation so that its error stays below the noise of the sensors."""

from typing import NamedTuple

import numpy as np

from edhas_jax.measurements.measurement_model import MeasurementModel, PredictedSignals

MAX_ERROR_OVER_NOISE = 0.1  # rms error of the integrator in units of the noise, small enough not to bias a fit
MAX_COARSE_ERROR_OVER_NOISE = 1.0  # the same, small enough to locate a minimum
# change of a signal over its range by one prior standard deviation of an unknown: derivatives beyond it grow from step
# to step, as they do at a coarse step where friction sticks and valves bounce
MAX_DERIVATIVE = 2.0
SMALLEST_STEP = 2.5e-6  # s; the step is not halved any further


class TimeResolution(NamedTuple):
    """Time steps per sample: `coarse` to locate a minimum, `fine` for results; `error` of the latter in noise units."""

    coarse: int
    fine: int
    error: float


def choose_time_resolution(
    model: MeasurementModel, x: np.ndarray, share: float = MAX_ERROR_OVER_NOISE
) -> TimeResolution:
    """Halve the time step until the error of every signal in every run is below a share of its noise.

    The coarse step, with which derivatives are taken, is halved until these are bounded as well.

    The integrator is of second order: halving the step changes the result by three quarters of the coarser error, so
    the error of the coarser step is 4/3 of the change and that of the finer step 1/3.

    Args:
        model: the runs to simulate.
        x: coordinates of the unknowns (unknowns,) at which the error is estimated.
        share: largest rms error over a run, in standard deviations of the noise.

    Returns:
        The resolution; if even `SMALLEST_STEP` does not suffice, the finest one tried, with its error.
    """
    found = _accurate_resolution(model, x, share)
    coarse = found.coarse
    while model.longest_interval() / coarse > SMALLEST_STEP and not _derivatives_are_bounded(model, x, coarse):
        coarse *= 2
    return TimeResolution(coarse, max(coarse, found.fine), found.error)


def _derivatives_are_bounded(model: MeasurementModel, x: np.ndarray, steps: int) -> bool:
    """Whether no signal changes by more than `MAX_DERIVATIVE` of its range per prior standard deviation."""
    for predicted in model.predict_all_runs(x, steps, with_sensitivities=True).values():
        for name, values in predicted.values.items():
            largest = np.abs(predicted.sensitivities[name]).max(initial=0.0)
            if not largest <= MAX_DERIVATIVE * max(float(np.ptp(values)), model.campaign.channels[name].noise):
                return False
    return True


def _accurate_resolution(model: MeasurementModel, x: np.ndarray, share: float) -> TimeResolution:
    """The resolution by the error of the signals alone."""
    n, coarse_steps, error = model.min_steps_per_sample(), None, np.inf
    coarse = model.predict_all_runs(x, n)
    while model.longest_interval() / n > SMALLEST_STEP:
        fine = model.predict_all_runs(x, 2 * n)
        change = _largest_change(model, coarse, fine)
        for steps, error in ((n, 4.0 / 3.0 * change), (2 * n, change / 3.0)):
            coarse_steps = steps if coarse_steps is None and error < MAX_COARSE_ERROR_OVER_NOISE else coarse_steps
            if error < share:
                return TimeResolution(coarse_steps, steps, error)
        n, coarse = 2 * n, fine
    return TimeResolution(coarse_steps or n, n, error)


def _largest_change(
    model: MeasurementModel, coarse: dict[int, PredictedSignals], fine: dict[int, PredictedSignals]
) -> float:
    """The largest rms difference of a signal in a run, in units of its noise; inf where a simulation failed."""
    largest = 0.0
    for r, predicted in fine.items():
        for name, channel in model.campaign.channels.items():
            rms = np.sqrt(np.mean(np.square(predicted.values[name] - coarse[r].values[name])))
            largest = max(largest, float(rms) / channel.noise if np.isfinite(rms) else np.inf)
    return largest
