"""The accuracy of a bench: defaults for every sensor and setting."""

import dataclasses

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.measurements.accuracy import BenchAccuracy, SensorAccuracy
from edhas_jax.measurements.campaign import CampaignError, Channel
from edhas_jax.measurements.campaign_reader import read_campaign
from studies.campaign_writer import write_campaign
from tests.support.synthetic_campaign import empty_campaign


def measured_campaign(**accuracy):
    """Two runs whose current spans −1 … 1 A."""
    campaign = empty_campaign(edhas.PumpBench())
    runs = []
    for run in campaign.runs:
        current = np.sin(np.linspace(0.0, 20.0, len(run.time)))
        conditions = {"frequency": 10.0, "load_orifice_area": 4e-6}
        runs.append(dataclasses.replace(run, conditions=conditions, signals={"current": current}))
    channels = {"current": Channel("A", 0.02), "voltage": Channel("V", 0.05)}
    stated = BenchAccuracy(**accuracy)
    return dataclasses.replace(campaign, runs=tuple(runs), channels=channels, stated_accuracy=stated)


def test_every_signal_and_setting_has_a_default():
    accuracy = measured_campaign().accuracy
    assert accuracy.trigger == 2e-4 and accuracy.clock_error == 5e-5
    assert accuracy.signals["current"].offset == pytest.approx(2e-3, rel=0.01)
    assert accuracy.signals["voltage"].offset == 0.05  # in no run: its noise
    assert accuracy.settings == {"frequency": 0.0, "load_orifice_area": 0.005} | dict.fromkeys(
        ("coil_resistance", "force_constant"), 0.005
    )


def test_stated_accuracy_takes_precedence():
    sensor = SensorAccuracy(gain=0.01, offset=0.1, shift=1e-3)
    accuracy = measured_campaign(trigger=0.0, settings={"coil_resistance": 0.0}, signals={"current": sensor}).accuracy
    assert accuracy.trigger == 0.0
    assert accuracy.signals["current"] == sensor
    assert accuracy.settings["coil_resistance"] == 0.0 and accuracy.settings["load_orifice_area"] == 0.005


@pytest.mark.parametrize("error", [0.0, 2e-5])
def test_the_error_of_the_clock_is_written_and_read(tmp_path, error):
    """0 states an exact clock."""
    campaign = measured_campaign(clock_error=error)
    write_campaign(dataclasses.replace(campaign, channels={"current": campaign.channels["current"]}), tmp_path)
    assert read_campaign(tmp_path).stated_accuracy.clock_error == error


def test_a_negative_error_of_the_clock_is_refused(tmp_path):
    campaign = measured_campaign(clock_error=2e-5)
    write_campaign(dataclasses.replace(campaign, channels={"current": campaign.channels["current"]}), tmp_path)
    file = tmp_path / "campaign.yaml"
    lines = file.read_text().splitlines()
    file.write_text("\n".join("  clock_error: -20 us" if "clock_error" in line else line for line in lines))
    with pytest.raises(CampaignError, match="clock_error"):
        read_campaign(tmp_path)
