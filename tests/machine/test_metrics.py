"""Metrics of the rigs where a closed form tells their value."""

import types

import numpy as np
import pytest

from edhas_jax.machine.interface.metrics import instant
from edhas_jax.machine.metrics import METRICS, SETTLING_BAND
from edhas_jax.simulation.metrics import Window

TIME = np.linspace(0.0, 2.0, 8001)  # s


def of_cycles(name: str, **signals) -> float:
    """A metric of samples at `TIME`, two cycles."""
    window, at = Window(TIME, TIME[0], TIME[-1]), instant(signals, TIME)
    return METRICS[name].value(None, *(taken.over(window, taken.of(None, at)) for taken in METRICS[name].taken))


def of_step(name: str, response: np.ndarray, start: float = -4e-3, step: float = 15e-3) -> float:
    """A metric of a cylinder that answers a step with a `response` of the final value 1 at `TIME`."""
    target = np.full(len(TIME), start + step)
    target[0] = start
    signals = types.SimpleNamespace(time=TIME, target=target, cylinder_position=start + step * response)
    (taken,) = METRICS[name].taken
    return METRICS[name].value(None, taken.of(None, signals))


def second_order(damping: float, frequency: float = 40.0) -> np.ndarray:
    """The response at `TIME` of a second-order lag with a damping ratio below 1 and a natural frequency [rad/s]."""
    root = np.sqrt(1.0 - damping**2)
    angle = root * frequency * TIME
    return 1.0 - np.exp(-damping * frequency * TIME) * (np.cos(angle) + damping / root * np.sin(angle))


@pytest.mark.parametrize("lag", [0.3, -0.2])
def test_amplitude_and_phase_are_those_of_the_first_harmonic(lag):
    """An offset and other harmonics count nothing; a piston that comes later lags."""
    angle = 2.0 * np.pi * TIME
    reference = 3e-3 * np.sin(angle + 0.4)
    piston = 2.4e-3 * np.sin(angle + 0.4 - lag) + 1e-3 + 5e-4 * np.sin(3.0 * angle)
    assert of_cycles("amplitude_ratio", piston_position=piston, reference=reference) == pytest.approx(0.8, rel=1e-9)
    assert of_cycles("phase_lag", piston_position=piston, reference=reference) == pytest.approx(lag, rel=1e-9)


def test_the_response_time_of_a_first_order_lag():
    response = 1.0 - np.exp(-TIME / 0.1)
    assert of_step("response_time", response) == pytest.approx(-0.1 * np.log(SETTLING_BAND), rel=1e-4)
    assert of_step("response_time", response, step=-15e-3) == pytest.approx(-0.1 * np.log(SETTLING_BAND), rel=1e-4)
    assert of_step("overshoot", response) == 0.0


@pytest.mark.parametrize("damping", [0.1, 0.3, 0.6, 0.75])
def test_the_figures_of_a_response_that_overshoots(damping):
    """It is outside of the band at some time just before the response time, above or below, and never after it."""
    response = second_order(damping)
    assert of_step("overshoot", response) == pytest.approx(
        np.exp(-np.pi * damping / np.sqrt(1.0 - damping**2)), rel=1e-4
    )
    found, outside = of_step("response_time", response), np.abs(response - 1.0) > SETTLING_BAND
    assert TIME[outside][-1] <= found <= TIME[outside][-1] + TIME[1]


def test_a_response_that_ends_outside_of_the_band_has_no_response_time():
    for end in (0.95, 1.05):
        response = np.minimum(2.0 * TIME, end)
        assert np.isnan(of_step("response_time", response))
        assert of_step("steady_error", response) == pytest.approx((1.0 - end) * 15e-3)
