"""The time step of a calibration: its error at the fitted parameters, and finer steps where signals are irregular."""

import dataclasses
import math

import numpy as np
import pytest

from edhas_jax.inference.fit import calibrated_model
from edhas_jax.inference.fit.calibrated_model import _regular_steps, _with_accurate_step
from edhas_jax.inference.fit.evaluated_fit import fit_coarse, start_coordinates
from edhas_jax.inference.fit.fit_problem import calibration_problem
from edhas_jax.measurements.time_resolution import TimeResolution, step_error
from tests.support.synthetic_campaign import bench, empty_campaign, measured

STEPS = np.array([4, 8, 16, 32])


@pytest.fixture(scope="module")
def problem():
    campaign = measured(empty_campaign(), bench())
    # the noise is stated ten times smaller than it is: the error of one step per sample is 36 times that
    channels = {n: dataclasses.replace(c, noise=0.1 * c.noise) for n, c in campaign.channels.items()}
    campaign = dataclasses.replace(campaign, channels=channels)
    return calibration_problem(campaign)


def fitted(problem, steps):
    return fit_coarse(problem, start_coordinates(problem, {}), steps, 4)


def test_the_error_falls_with_the_square_of_the_step(problem):
    errors = [step_error(problem.model(), np.zeros(4), int(steps)) for steps in STEPS]
    order = -np.polyfit(np.log(STEPS), np.log(errors), 1)[0]
    assert order == pytest.approx(2.0, abs=0.15)


def test_the_step_is_halved_until_its_error_is_below_noise_and_residual(problem):
    calibrated = fitted(problem, 1)
    x, model = calibrated.fit.x, problem.model()
    assert step_error(model, x, 1) > 1.0
    # the residual is ten times the stated noise, so that only a larger error matters
    residual = math.sqrt(2.0 * calibrated.cost / calibrated.samples)
    again, resolution = _with_accurate_step(calibrated, TimeResolution(1, 2, math.nan), lambda sentence: None)
    assert resolution.coarse == again.fit.resolution.coarse > 1 and resolution.fine >= resolution.coarse
    assert step_error(model, again.fit.x, resolution.coarse) <= max(1.0, residual)


def test_an_accurate_step_stays(problem):
    calibrated, resolution = fitted(problem, 8), TimeResolution(8, 16, math.nan)
    assert _with_accurate_step(calibrated, resolution, lambda sentence: None) == (calibrated, resolution)


def test_irregular_signals_near_the_noise_get_the_first_step_that_is_regular(problem, monkeypatch):
    """Signals that are irregular with up to sixteen steps per sample, and regular with thirty-two."""
    tried = []

    def scatter(problem, x, steps):
        tried.append(steps)
        return {} if steps >= 32 else {"voltage": 1.0}

    monkeypatch.setattr(calibrated_model, "unpredictable_part", scatter)
    near = calibration_problem(measured(empty_campaign(), bench()))
    assert _regular_steps(fitted(near, 4), 4, lambda sentence: None) == 32
    assert tried == [8, 16, 32]
    # where the residual is far above the noise, no finer step is tried
    tried.clear()
    assert _regular_steps(fitted(problem, 4), 4, lambda sentence: None) is None and not tried


def test_a_motion_that_is_chaotic_at_any_step_ends_the_search_for_one(monkeypatch):
    monkeypatch.setattr(calibrated_model, "unpredictable_part", lambda problem, x, steps: {"voltage": 1.0})
    near = calibration_problem(measured(empty_campaign(), bench()))
    assert _regular_steps(fitted(near, 4), 4, lambda sentence: None) is None
