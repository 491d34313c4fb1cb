"""The accuracy of a bench: defaults for every sensor and setting, and its section in campaign.yaml."""

import dataclasses

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.measurements.accuracy import BenchAccuracy, SensorAccuracy
from edhas_jax.measurements.campaign import CampaignError, Channel
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.campaign_writer import write_campaign
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from tests.support.faulty_campaign import copy_campaign, replace_in_yaml
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


SECTION = """accuracy:
  trigger: 0.5 ms
  settings: {load_orifice_area: 1 %, coil_resistance: 0}
  signals: {outlet_pressure: {gain: 0.2 %, offset: 2 kPa, shift: 50 us}, current: {}}
runs:"""


def with_section(folder, text):
    """A valid campaign with a section `accuracy:`."""
    folder = copy_campaign(folder)
    replace_in_yaml(folder, "runs:", text)
    return folder


def test_section_is_read_in_units_and_written_back(tmp_path):
    campaign = read_campaign(with_section(tmp_path / "bench", SECTION))
    stated = campaign.stated_accuracy
    assert stated.trigger == 5e-4
    assert stated.settings == {"load_orifice_area": 0.01, "coil_resistance": 0.0}
    assert stated.signals["outlet_pressure"] == SensorAccuracy(gain=0.002, offset=2000.0, shift=50e-6)
    assert stated.signals["current"] == SensorAccuracy()
    write_campaign(campaign, tmp_path / "written")
    assert read_campaign(tmp_path / "written").stated_accuracy == stated


def test_a_campaign_without_the_section_has_the_defaults_and_writes_none(tmp_path):
    campaign = read_campaign(copy_campaign(tmp_path / "bench"))
    assert campaign.stated_accuracy == BenchAccuracy()
    yaml, *_ = write_campaign(campaign, tmp_path / "written")
    assert "accuracy" not in yaml.read_text()


@pytest.mark.parametrize(
    ("wrong", "right", "sentence"),
    [
        ("trigger: 0.5 ms", "trigger: 0.5", "accuracy.trigger: a unit is missing"),
        ("trigger: 0.5 ms", "trigger: -1 ms", "accuracy.trigger: a standard deviation is 0 or above"),
        ("trigger: 0.5 ms", "triger: 0.5 ms", "triger"),
        ("load_orifice_area: 1 %", "load_orifice: 1 %", "load_orifice_area"),
        ("load_orifice_area: 1 %", "load_orifice_area: 1 mm^2", "not a plain number"),
        ("load_orifice_area: 1 %", "load_orifice_area: 150 %", "at most 100 %"),
        ("outlet_pressure: {", "outlet_presure: {", "outlet_pressure"),
        ("outlet_pressure: {", "head_pressure: {", "not measured in this campaign"),
        ("offset: 2 kPa", "offset: 2 mm", "not a pressure"),
        ("shift: 50 us", "delay: 50 us", "delay"),
        ("current: {}", "current: 3", "a mapping belongs here"),
    ],
)
def test_what_is_wrong_in_the_section_is_said_with_its_line(wrong, right, sentence, tmp_path):
    assert wrong in SECTION
    folder = with_section(tmp_path / "bench", SECTION.replace(wrong, right))
    with pytest.raises(CampaignError) as caught:
        read_campaign(folder)
    assert sentence in str(caught.value) and "campaign.yaml:1" in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_noise_need_not_be_stated(tmp_path):
    folder = copy_campaign(tmp_path / "bench")
    replace_in_yaml(folder, "{unit: A, noise: 0.02}", "A")
    replace_in_yaml(folder, "{unit: MPa, noise: 0.0015}", "{unit: MPa}")
    campaign = read_campaign(folder)
    assert not campaign.remarks and np.isnan(campaign.channels["current"].noise)
    write_campaign(campaign, tmp_path / "written")
    channels = checked_campaign(read_campaign(tmp_path / "written")).channels
    assert channels["current"].noise == pytest.approx(0.02, rel=0.1) and channels["current"].stated_noise is None
    assert channels["outlet_pressure"].noise == pytest.approx(1500.0, rel=0.1)
