"""The accuracy of a bench: defaults for every sensor and setting."""

import dataclasses

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.measurements.accuracy import BenchAccuracy, SensorAccuracy
from edhas_jax.measurements.campaign import Channel
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
    assert accuracy.trigger == 2e-4
    assert accuracy.signals["current"].offset == pytest.approx(2e-3, rel=0.01)
    assert accuracy.signals["voltage"].offset == 0.05  # in no run: its noise
    assert accuracy.settings == {"frequency": 0.0, "load_orifice_area": 0.005, "coil_resistance": 0.005}


def test_stated_accuracy_takes_precedence():
    sensor = SensorAccuracy(gain=0.01, offset=0.1, shift=1e-3)
    accuracy = measured_campaign(trigger=0.0, settings={"coil_resistance": 0.0}, signals={"current": sensor}).accuracy
    assert accuracy.trigger == 0.0
    assert accuracy.signals["current"] == sensor
    assert accuracy.settings["coil_resistance"] == 0.0 and accuracy.settings["load_orifice_area"] == 0.005
