"""A run that begins elsewhere than the model is said, unless its start is uncertain."""

from pathlib import Path

import numpy as np
import pytest

from edhas_jax import Rig, drive, par, state
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.measurements.campaign import BenchRun, Campaign, Channel, Use
from edhas_jax.measurements.checks.campaign_checks import checked_campaign

TIME = 0.01 * np.arange(1500)
COMMAND = 2.0 + np.sin(0.9 * TIME) + 0.5 * np.sin(2.3 * TIME)
NOISE = 2e3


class Vessel(Rig):
    """A pressure that follows a command."""

    time_step, duration = 0.01, 15.0

    command = drive("V", "command", 0.0)
    gain: float = par(1e6, "Pa/V", (1e4, 1e8), "pressure over command")
    first: float = par(2e6, "Pa", (0.0, 1e8), "pressure at the start")

    pressure = state("Pa", "pressure", "first")

    def equations(self, y, s):
        """A lag of half a second."""
        return {"pressure": (self.gain * s.command - y.pressure) / 0.5}


def remarks(start, gain=1e6, offset=0.0, uncertain=None):
    """What the check says of the start of a run that begins at a pressure [Pa]."""
    pressure = [start]
    for command in COMMAND[:-1]:
        pressure.append(pressure[-1] + 0.02 * (gain * command - pressure[-1]))
    pressure = np.array(pressure) + offset + NOISE * np.random.default_rng(0).standard_normal(len(TIME))
    drives = {"command": Recorded(values=COMMAND, interval=0.01)}
    lines = np.arange(len(TIME)) + 2
    run = BenchRun("run", Path("run.csv"), Use.FIT, {}, TIME, {"pressure": pressure}, lines, drives=drives)
    machine = Vessel(**drives)
    campaign = Campaign("vessel", Path("."), machine, uncertain or {}, {"pressure": Channel("MPa", NOISE)}, (run,), ())
    return [r.sentence for r in checked_campaign(campaign).remarks if "begins at" in r.sentence]


def test_a_run_that_begins_elsewhere_is_said():
    (sentence,) = remarks(5e6)
    assert "pressure begins at 5 MPa, the model, by first, at 2 MPa" in sentence


@pytest.mark.parametrize(
    ("start", "gain", "offset"), [(2e6, 1e6, 0.0), (2e6, 1.3e6, 0.0), (2e6, 1e6, 8e5), (2.2e6, 1e6, 0.0)]
)
def test_an_error_of_model_or_sensor_is_no_other_start(start, gain, offset):
    assert not remarks(start, gain, offset)


def test_an_uncertain_start_is_left_to_the_fit():
    assert not remarks(5e6, uncertain={"first": 0.5})
