"""Comparison with measurements: the true model leaves noise, the patterns locate the error of a wrong one."""

import dataclasses

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.core import structs
from edhas_jax.machine.effects import InverterDeadTime
from edhas_jax.measurements.campaign import CampaignError
from edhas_jax.measurements.comparison import compare
from edhas_jax.measurements.comparison_report import comparison_report, sentences
from edhas_jax.measurements.figures_of_merit import COLUMNS, figures_of_merit, ljung_box
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.replay import Replay
from edhas_jax.measurements.residual_patterns import find_patterns
from edhas_jax.measurements.sensor_models import SensorGain, SensorLag, SensorOffset
from tests.support.faulty_campaign import VALID_CAMPAIGN
from tests.support.synthetic_campaign import bench, empty_campaign, measured

NOISE_TOLERANCE = 0.15  # of residual over noise about 1


@pytest.fixture(scope="module")
def campaign():
    return measured(empty_campaign(), bench())


def patterns_with_sensor(sensor):
    """The patterns when the current was recorded by a sensor that the model does not include."""
    campaign = measured(empty_campaign(), bench(), Instruments({"current": (sensor,)}))
    return find_patterns(compare(campaign))


def test_the_true_model_leaves_noise(campaign):
    found = compare(campaign)
    assert all(
        value == pytest.approx(1.0, abs=NOISE_TOLERANCE)
        for row in found.rms_over_noise().values()
        for value in row.values()
    )
    assert find_patterns(found) == []
    table = figures_of_merit(found)
    assert list(table.columns) == list(COLUMNS) and table["white"].sum() >= len(table) - 1
    assert table["amplitude"].sub(1.0).abs().max() < 0.02 and table["delay"].abs().max() < 1e-4


@pytest.mark.parametrize("replay", [Replay.VOLTAGE, Replay.CURRENT])
def test_a_replayed_signal_drives_the_parts_downstream(campaign, replay):
    """The replayed signal carries noise, and nothing controls the position: only the current must agree."""
    found = compare(campaign, replay=replay)
    compared = {"voltage": ("current", "piston_position"), "current": ("piston_position",)}[replay.value]
    assert found.signals == compared
    if replay is Replay.VOLTAGE:
        assert max(row["current"] for row in found.rms_over_noise().values()) < 1.5


def test_a_replay_is_sensitive_only_to_the_parts_downstream():
    """A wrong inductance shows when the voltage is replayed, and has no influence when the current is."""
    campaign = measured(empty_campaign(), edhas.change(bench(), coil_inductance=5e-3))
    true = compare(campaign, edhas.change(bench(), coil_inductance=5e-3), replay=Replay.CURRENT).rms_over_noise()
    by_current = compare(campaign, replay=Replay.CURRENT).rms_over_noise()
    assert by_current == true
    by_voltage = compare(campaign, replay=Replay.VOLTAGE).rms_over_noise()
    assert max(row["current"] for row in by_voltage.values()) > 1.5


def test_a_replay_needs_its_signal(campaign):
    without = [{n: v for n, v in run.signals.items() if n != "voltage"} for run in campaign.runs]
    runs = tuple(dataclasses.replace(run, signals=signals) for run, signals in zip(campaign.runs, without, strict=True))
    with pytest.raises(CampaignError, match="voltage was not measured"):
        compare(dataclasses.replace(campaign, runs=runs), replay=Replay.VOLTAGE)
    incomplete = dataclasses.replace(
        campaign.runs[0], signals=dict(campaign.runs[0].signals, voltage=np.full(401, np.nan))
    )
    found = compare(dataclasses.replace(campaign, runs=(incomplete, *campaign.runs[1:])), replay=Replay.VOLTAGE)
    assert len(found.runs) == 2 and "run is left out" in str(found.remarks[0])


def test_an_inverter_dead_time_is_located():
    truth = structs.replace(bench(), effects=(*bench().effects, InverterDeadTime(dead_time_voltage=0.8)))
    found = compare(measured(empty_campaign(), truth))
    (first, *_) = find_patterns(found)
    assert (first.signal, first.axis) == ("voltage", "current")
    assert "where current changes sign (high while it is positive)" in first.sentence
    assert sentences([first])[0].startswith("Voltage steps by 1.")
    text = comparison_report(found, find_patterns(found))
    assert "current changes sign" in text and text.count("data:image/png") >= 6


def test_an_offset_is_described_as_one():
    (first, *_) = patterns_with_sensor(SensorOffset(offset=0.15))
    assert first.sentence == "current reads 0.15 A high throughout"


def test_a_gain_error_is_described_as_one():
    (first, *_) = patterns_with_sensor(SensorGain(gain=1.2))
    assert first.signal == "current" and "too large in proportion" in first.sentence


def test_a_lag_is_described_as_a_delay():
    (first, *_) = patterns_with_sensor(SensorLag(lag_time=0.6e-3))
    assert first.signal == "current" and "late by" in first.sentence
    # less than the time constant, because where the current jumps a lag differs from a delay
    assert 200.0 < float(first.sentence.split("late by ")[1].split()[0]) <= 600.0


def test_ljung_box_separates_white_from_correlated_noise():
    rng = np.random.default_rng(0)
    noise = rng.standard_normal(4000)
    autocorrelation, statistic = ljung_box(noise)
    assert abs(autocorrelation) < 0.05 and statistic < 45.0
    autocorrelation, statistic = ljung_box(np.convolve(noise, np.ones(3) / 3.0))
    assert autocorrelation == pytest.approx(2.0 / 3.0, abs=0.05) and statistic > 1000.0


def test_on_the_command_line(tmp_path, capsys):
    out = tmp_path / "compared"
    assert main(["compare", str(VALID_CAMPAIGN), "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "residual over noise" in printed and "run8" in printed
    assert {p.name for p in out.iterdir()} == {"report.html", "figures.csv"}
    assert main(["compare", str(VALID_CAMPAIGN), "--out", str(out)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(["fit", str(VALID_CAMPAIGN), "--out", str(out), "--profile", "nonsense", "--overwrite"]) == 2
    assert "--profile nonsense" in capsys.readouterr().err
