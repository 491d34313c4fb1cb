"""Comparison with measurements: the true model leaves noise, the patterns locate the error of a wrong one."""

import dataclasses
import re

import numpy as np
import pandas as pd
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
from edhas_jax.measurements.measurement_model import PredictedSignals
from edhas_jax.measurements.replay import Replay
from edhas_jax.measurements.residual_patterns import find_patterns
from edhas_jax.measurements.residuals import normalised_residuals, rms_over_noise
from edhas_jax.measurements.sensor_models import SensorDelay, SensorGain, SensorOffset
from tests.support.faulty_campaign import VALID_CAMPAIGN, copy_campaign, modify_table
from tests.support.synthetic_campaign import bench, empty_campaign, measured

PRESSURE, REST = "outlet_pressure [MPa]", 0.2  # MPa, pressure at the start
NOISE_TOLERANCE = 0.15  # of residual over noise about 1


@pytest.fixture(scope="module")
def campaign():
    return measured(empty_campaign(), bench())


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


def test_a_model_that_fails_in_a_run_has_no_finite_error_there(campaign):
    """A measured sample that the model cannot predict makes the error infinite; it does not count as missing."""
    compared = compare(campaign).runs[0]
    measured, model = compared.run.signals["current"].copy(), compared.model["current"].copy()
    measured[:5] = np.nan
    run = dataclasses.replace(compared.run, signals=compared.run.signals | {"current": measured})
    whole = normalised_residuals(campaign, run, PredictedSignals(compared.model, None))
    assert rms_over_noise(whole.values()) == pytest.approx(1.0, abs=NOISE_TOLERANCE)
    model[len(model) // 2 :] = np.nan
    fails = normalised_residuals(campaign, run, PredictedSignals({"current": model}, None))
    assert np.isnan(fails["current"][:5]).all() and rms_over_noise(fails.values()) == np.inf
    assert np.isfinite(ljung_box(fails["current"])).all()


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
    match = re.fullmatch(
        r"voltage: the model is (\S+) V too low while current is positive, and \1 V too high while it is negative.*",
        first.sentence,
    )
    assert 0.5 < float(match[1]) <= 0.85
    text = comparison_report(found, find_patterns(found), {"residual over noise": found.rms_over_noise()})
    assert sentences([first])[0].startswith("Voltage: the model is")
    assert "too low while current is positive" in text and text.count("data:image/png") >= 6


@pytest.mark.parametrize(
    ("of_model", "of_bench", "sentence"),
    [
        (SensorOffset(offset=0.15), None, "current: the model is 0.15 A too high throughout"),
        (None, SensorOffset(offset=0.15), "current: the model is 0.15 A too low throughout"),
        (SensorGain(gain=1.2), None, "current: the model is 20 % too large "),
        (None, SensorGain(gain=1.25), "current: the model is 20 % too small "),
        (SensorDelay(delay_time=0.4e-3), None, r"current: the model is 4\d\d µs late"),
        (None, SensorDelay(delay_time=0.4e-3), r"current: the model is 4\d\d µs early"),
        (SensorGain(gain=-1.0), None, "current: where the model moves by "),
    ],
)
def test_sentences_say_how_the_model_is_wrong(of_model, of_bench, sentence):
    """Where a sensor of the bench reads too high, the model is too low."""
    campaign = measured(empty_campaign(), bench(), _on_current(of_bench))
    found = compare(campaign, instruments=_on_current(of_model))
    (first, *_) = find_patterns(found)
    assert re.match(sentence, first.sentence)
    row = figures_of_merit(found).loc[("run1", "current")]
    if "early" in sentence or "late" in sentence:
        assert row["delay"] == pytest.approx(0.4e-3 if "late" in sentence else -0.4e-3, rel=0.2)
    if "throughout" in sentence:
        assert row["mean"] == pytest.approx(-0.15 if "high" in sentence else 0.15, rel=0.05)
    if "%" in sentence:
        assert row["amplitude"] == pytest.approx(1.2 if "large" in sentence else 0.8, rel=0.01)


def _on_current(sensor):
    return Instruments({"current": (sensor,)} if sensor else {})


def _with_signals(found, signals, model):
    """The comparison of the first run only, with other measured and simulated signals."""
    compared, channels = found.runs[0], found.campaign.channels
    residuals = {n: (v - model[n]) / channels[n].noise for n, v in signals.items()}
    run = dataclasses.replace(compared.run, signals=signals)
    return dataclasses.replace(
        found, runs=(dataclasses.replace(compared, run=run, model=model, residuals=residuals),)
    )  # fmt: skip


def test_errors_are_measured_less_model_and_relative_to_what_was_measured(campaign):
    """A model of three quarters of the amplitude, 0.1 A too high throughout; a tenth of the samples is missing."""
    found = compare(campaign)
    compared = found.runs[0]
    sine = np.sin(2.0 * np.pi * compared.frequency * compared.run.time)
    signals, model = {"current": 2.0 * sine}, dict(compared.model, current=1.5 * sine + 0.1)
    signals["current"][::10] = np.nan
    row = figures_of_merit(_with_signals(found, signals, model)).loc[("run1", "current")]
    assert row["mean"] == pytest.approx(-0.1, abs=2e-3)
    assert row["peak"] == pytest.approx(2.0 - 1.6, abs=2e-3)
    assert row["nrmse"] == pytest.approx(np.sqrt(0.5 * 0.5**2 + 0.1**2) / 4.0, rel=1e-2)
    assert row["amplitude"] == pytest.approx(0.75, rel=1e-2) and row["phase"] == pytest.approx(0.0, abs=1e-3)


def test_amplitude_and_phase_are_those_of_the_harmonic_that_carries_the_signal(campaign):
    """A signal rectified by the pump has no first harmonic; others have none, or none in common with the model."""
    found = compare(campaign)
    compared = found.runs[0]
    time = compared.run.time
    cycle = 2.0 * np.pi * compared.frequency * time
    noise = 5e-6 * np.random.default_rng(1).standard_normal(len(time))
    model = dict(compared.model, current=np.abs(np.sin(cycle)), voltage=np.sin(cycle), piston_position=0.0 * time)
    signals = {"current": np.abs(np.sin(cycle - 0.1)) / 1.25, "voltage": np.sin(3.0 * cycle), "piston_position": noise}
    table = figures_of_merit(_with_signals(found, signals, model)).loc["run1"]
    assert list(table["harmonic"]) == pytest.approx([2.0, np.nan, np.nan], nan_ok=True)
    assert table["amplitude"]["current"] == pytest.approx(1.25, rel=1e-2)
    assert table["phase"]["current"] == pytest.approx(-0.2, rel=1e-2)  # the model is 0.1 rad of its cycle early
    assert table[["amplitude", "phase"]].iloc[1:].isna().all(axis=None)


def test_ljung_box_separates_white_from_correlated_noise():
    rng = np.random.default_rng(0)
    noise = rng.standard_normal(4000)
    autocorrelation, statistic = ljung_box(noise)
    assert abs(autocorrelation) < 0.05 and statistic < 45.0
    autocorrelation, statistic = ljung_box(np.convolve(noise, np.ones(3) / 3.0))
    assert autocorrelation == pytest.approx(2.0 / 3.0, abs=0.05) and statistic > 1000.0


def test_on_the_command_line(tmp_path, capsys):
    """The measured pressures are lowered, so that the model is too high."""
    folder, out = copy_campaign(tmp_path / "bench"), tmp_path / "compared"
    for run in ("run3.csv", "run4.csv", "run8.csv"):
        modify_table(folder, run, lambda f: f.assign(**{PRESSURE: REST + (f[PRESSURE] - REST) / 1.5}))
    assert main(["compare", str(folder), "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "residual over noise" in printed and "run8" in printed
    assert 45.0 < float(re.search(r"1\. Outlet pressure: the model is (\S+) % too high ", printed)[1]) < 60.0
    assert {p.name for p in out.iterdir()} == {"report.html", "figures.csv", "files.json", "summary.json"}
    assert "% too high" in (out / "report.html").read_text()
    figures = pd.read_csv(out / "figures.csv", index_col=["run", "signal"])
    pressure, position = (figures.xs(name, level="signal") for name in ("outlet_pressure", "piston_position"))
    assert (pressure["mean"] < 0.0).all() and (pressure["harmonic"] == 2.0).all()
    assert pressure["amplitude"].to_numpy() == pytest.approx(1.5, rel=0.05)
    assert (position["harmonic"] == 1.0).all()
    assert main(["compare", str(VALID_CAMPAIGN), "--out", str(out)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(["fit", str(VALID_CAMPAIGN), "--out", str(out), "--profile", "nonsense", "--overwrite"]) == 2
    assert "--profile nonsense" in capsys.readouterr().err
