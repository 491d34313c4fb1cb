"""Choose the time step of the simulation so that its error stays below the noise of the sensors."""

from typing import NamedTuple

import numpy as np

from edhas_jax.measurements.measurement_model import MeasurementModel, PredictedSignals

MAX_ERROR_OVER_NOISE = 0.1  # rms error of the integrator in units of the noise, small enough not to bias a fit
MAX_COARSE_ERROR_OVER_NOISE = 1.0  # the same, small enough to locate a minimum
# change of a signal over its range by one prior standard deviation of an unknown: derivatives beyond it grow from step
# to step, as they do at a coarse step where friction sticks and valves bounce
MAX_DERIVATIVE = 2.0
MAX_HALVINGS = 3  # of the coarse step for the sake of derivatives: a motion may be chaotic at any step
SMALLEST_STEP = 0.125  # of the step with which a run of the machine begins; it is not halved any further


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
    if not len(x):  # nothing is differentiated
        return found
    coarse, largest = found.coarse, {}
    while not any(value <= MAX_DERIVATIVE for value in largest.values()) and len(largest) <= MAX_HALVINGS:
        largest[coarse] = _largest_derivative(model, x, coarse)
        coarse *= 2
    coarse = min(largest, key=largest.get)
    return TimeResolution(coarse, max(coarse, found.fine), found.error)


def step_error(model: MeasurementModel, x: np.ndarray, steps: int) -> float:
    """The largest rms error of a signal in a run over its noise, by comparison with half the step (Richardson).

    Args:
        model: the runs to simulate.
        x: coordinates of the unknowns (unknowns,).
        steps: time steps per sample.

    Returns:
        The error; inf where a simulation failed.
    """
    change = _largest_change(model, model.predict_all_runs(x, steps), model.predict_all_runs(x, 2 * steps))
    return 4.0 / 3.0 * change


def _largest_derivative(model: MeasurementModel, x: np.ndarray, steps: int) -> float:
    """The largest change of a signal over its range per prior standard deviation of an unknown; inf where it failed."""
    largest = 0.0
    for predicted in model.predict_all_runs(x, steps, with_sensitivities=True).values():
        for name, values in predicted.values.items():
            size = max(float(np.ptp(values)), model.campaign.channels[name].noise)
            change = float(np.abs(predicted.sensitivities[name]).max(initial=0.0)) / size
            largest = max(largest, change if np.isfinite(change) else np.inf)
    return largest


def _accurate_resolution(model: MeasurementModel, x: np.ndarray, share: float) -> TimeResolution:
    """The resolution by the error of the signals alone."""
    n, coarse_steps, error = model.min_steps_per_sample(), None, np.inf
    coarse = model.predict_all_runs(x, n)
    while model.longest_interval() / n > SMALLEST_STEP * model.machine.time_step:
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
