"""A wrong unit is suspected where nothing else explains a factor, not where a model is merely poor."""

from pathlib import Path

import numpy as np
import pytest

from edhas_jax import Rig, drive, par, state
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.measurements.campaign import BenchRun, Campaign, Channel, Use
from edhas_jax.measurements.checks.campaign_checks import checked_campaign

TIME = 0.01 * np.arange(1500)
COMMAND = 2.0 + np.sin(0.9 * TIME) + 0.5 * np.sin(2.3 * TIME)


class Vessel(Rig):
    """A pressure that follows a command."""

    time_step, duration = 0.01, 15.0

    command = drive("V", "command", 0.0)
    gain: float = par(1e6, "Pa/V", (1e4, 1e8), "pressure over command")

    pressure = state("Pa", "pressure", 2e6)

    def equations(self, y, s):
        """A lag of a tenth of a second."""
        return {"pressure": (self.gain * s.command - y.pressure) / 0.1}


def remarks(pressure, uncertain=None):
    """What the check says of units; the model gives exactly `true_pressure`."""
    drives = {"command": Recorded(values=COMMAND, interval=0.01)}
    noise = 2e3 * np.random.default_rng(0).standard_normal(len(TIME))
    lines = np.arange(len(TIME)) + 2
    run = BenchRun("run", Path("run.csv"), Use.FIT, {}, TIME, {"pressure": pressure + noise}, lines, drives=drives)
    channels = {"pressure": Channel("MPa", 2e3)}
    campaign = Campaign("vessel", Path("."), Vessel(**drives), uncertain or {"gain": 0.05}, channels, (run,), ())
    words = "right?", "read as", "gauge"
    return [r.sentence for r in checked_campaign(campaign).remarks if any(word in r.sentence for word in words)]


def true_pressure():
    values = [2e6]
    for command in COMMAND[:-1]:
        values.append(values[-1] + 0.1 * (1e6 * command - values[-1]))
    return np.array(values)


@pytest.mark.parametrize(
    ("factor", "unit"), [(10.0, "in bar, read as MPa"), (1e3 / 6.894757, "in psi, read as MPa"), (1e3, "in kPa, read")]
)
def test_a_wrong_unit_is_suspected(factor, unit):
    (sentence,) = remarks(factor * true_pressure())
    assert unit in sentence


def test_the_unit_of_the_drive_may_be_wrong_as_well():
    (sentence,) = remarks(0.1 * true_pressure())
    assert sentence.endswith("Or is what drove the model, command, in another unit?")


def test_a_gauge_pressure_that_soon_leaves_the_model_is_suspected():
    """Its gain is 10 % lower, so that only the first samples are one atmosphere below the model."""
    values = true_pressure()
    (sentence,) = remarks(values[0] + 0.9 * (values - values[0]) - 101325.0)
    assert "is it a gauge pressure?" in sentence


def test_a_gauge_pressure_is_suspected():
    (sentence,) = remarks(true_pressure() - 101325.0)
    assert "is it a gauge pressure?" in sentence


@pytest.mark.parametrize("factor", [6.0, 10.0, 145.0, 1e3])
def test_another_shape_is_no_wrong_unit(factor):
    assert not remarks(2e6 + factor * 1e6 * np.sin(0.4 * TIME))


def test_a_factor_that_an_uncertain_parameter_explains_is_no_wrong_unit():
    assert not remarks(10.0 * true_pressure(), {"gain": 1.0})


def test_a_factor_of_no_unit_is_none():
    assert not remarks(7.8 * true_pressure())


def test_an_offset_of_a_poor_model_is_no_gauge_pressure():
    assert not remarks(2e6 - 101325.0 + 4e5 * np.sin(0.4 * TIME))


def test_a_pressure_without_its_mean_is_suspected():
    (sentence,) = remarks(true_pressure() - 2e6)
    assert "below zero where the model never is; is it a gauge pressure, or is its mean removed?" in sentence


def test_noise_and_a_zero_that_is_slightly_off_are_no_vacuum():
    assert not any("below zero" in sentence for sentence in remarks(true_pressure() - true_pressure().min() - 5e3))
