"""Only what the records prove to be wrong is left out: peaks, overshoots and rests of a real machine stay."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from edhas_jax import Rig, drive, par, state
from edhas_jax.config.yaml_with_lines import YamlError
from edhas_jax.core.remark import Severity
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.measurements.campaign import BenchRun, Campaign, CampaignError, Channel, Use
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.checks.data_summary import data_as_json
from edhas_jax.measurements.checks.outlier_search import Record, find_outliers
from edhas_jax.measurements.checks.repeated_values import find_held_values
from tests.support.faulty_campaign import copy_campaign, modify_table

INTERVAL, SAMPLES = 0.01, 2000


class Valve(Rig):
    """A spool with a lag that follows its command, and the pressure behind it; its dead band is not modelled."""

    time_step, duration = INTERVAL, SAMPLES * INTERVAL

    command = drive("V", "command", 0.0)
    lag: float = par(0.05, "s", (0.01, 1.0), "lag of the spool")
    gain: float = par(1e6, "Pa/V", (1e5, 1e7), "pressure over spool")

    spool = state("V", "position of the spool")
    pressure = state("Pa", "pressure behind the valve")

    def equations(self, y, s):
        """The two lags."""
        return {"spool": (s.command - y.spool) / self.lag, "pressure": (self.gain * y.spool - y.pressure) / 0.1}


def found_in(values, noise=1e-4):
    """The samples of a record without cycles and model that are called wrong."""
    return np.flatnonzero(find_outliers([Record(values, None, INTERVAL, None, 0)], noise, ())[0])


def overshoot(per_period, damping=0.2):
    """The steps of a second-order system, with so many samples in a period."""
    time = np.arange(SAMPLES) / per_period
    values = np.zeros(SAMPLES)
    for begin, size in ((100, 1.0), (700, -1.5), (1400, 0.7)):
        since = np.maximum(time - begin / per_period, 0.0)
        turn = 2.0 * np.pi * since
        values += size * (1.0 - np.exp(-damping * turn) * (np.cos(turn) + damping * np.sin(turn)))
    return values


def peaks(width):
    """Smooth single peaks of so many samples on a signal that hardly moves elsewhere."""
    values = 0.01 * np.sin(0.02 * np.arange(SAMPLES))
    for begin in (150, 990, 1500):
        values[begin : begin + width] += 3.5 * np.sin(np.pi * (np.arange(width) + 1.0) / (width + 1.0))
    return values


def oscillator(seed=0):
    """A hardening spring under a multisine up to two fifths of its resolved band."""
    rng = np.random.default_rng(seed)
    phases, step = rng.uniform(0.0, 2.0 * np.pi, 300), 0.02
    time = step * np.arange(8 * SAMPLES)
    force = np.cos(np.outer(time, 0.05 * np.arange(1, 301)) + phases).sum(axis=1) / 10.0
    y, v, values = 0.0, 0.0, np.zeros(len(time))
    for k in range(len(time)):
        v += step * (force[k] - 0.2 * v - 4.0 * y - 6.0 * y**3)
        y += step * v
        values[k] = y
    return values[::8]


@pytest.mark.parametrize("per_period", [6, 9, 14, 25, 60])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_smooth_overshoot_is_no_spike(per_period, noise):
    values = overshoot(per_period) + noise * np.random.default_rng(0).standard_normal(SAMPLES)
    assert not len(found_in(values, max(noise, 1e-4)))


@pytest.mark.parametrize("width", [4, 5, 6, 9, 15, 20])
def test_a_peak_of_several_samples_is_no_spike(width):
    values = peaks(width) + 0.01 * np.random.default_rng(1).standard_normal(SAMPLES)
    assert not len(found_in(values, 0.01))


@pytest.mark.parametrize("seed", range(3))
def test_a_broadband_record_has_no_spikes(seed):
    assert not len(found_in(np.round(oscillator(seed), 4), 1e-3))


def test_steep_edges_and_a_chatter_are_no_bursts():
    """A pressure that collapses within three samples, and a ripple that comes up and dies away."""
    rng = np.random.default_rng(8)
    values = 5.0 - 0.002 * np.arange(SAMPLES)
    values[800:] = np.maximum(values[800:] - np.array([1.2, 4.3, 5.3, *[5.4] * (SAMPLES - 803)]), 0.04)
    values[1500:] += 3.0 * (1.0 - np.exp(-np.arange(500) / 1.5))
    values[400:412] += 0.3 * np.hanning(14)[1:-1] * (-1.0) ** np.arange(12)
    assert not len(found_in(values + 3e-3 * rng.standard_normal(SAMPLES), 3e-3))


@pytest.mark.parametrize("record", [overshoot(25), peaks(15), oscillator()])
def test_what_jumps_away_and_back_is_found_in_such_records(record):
    wrong = record + 1e-3 * np.random.default_rng(2).standard_normal(SAMPLES)
    truth = [400, 405, 1200, 1201, 1700, 1701, 1702]
    wrong[truth] += 8.0, -9.0, 8.0, 8.0, 6.0, 6.5, 6.0
    assert found_in(wrong, 1e-3).tolist() == truth


@pytest.mark.parametrize("length", [1, 4, 20])
def test_a_drop_out_of_the_recorder_is_found_in_a_moving_signal(length):
    values = 5.0 + np.sin(0.05 * np.arange(SAMPLES)) + 0.01 * np.random.default_rng(3).standard_normal(SAMPLES)
    values[500 : 500 + length] = 0.0
    assert found_in(values, 0.01).tolist() == list(range(500, 500 + length))


def test_a_pulse_of_a_signal_with_two_values_is_no_drop_out():
    values = np.zeros(SAMPLES)
    values[600:612] = 5.0
    assert not len(found_in(values, 1e-3))


def test_a_recorder_at_rest_loses_no_values():
    rng = np.random.default_rng(4)
    values = np.concatenate([1e-3 * rng.integers(0, 2, 60), np.cumsum(rng.standard_normal(SAMPLES))])
    campaign = valve_campaign({"spool": np.round(values, 3)[:SAMPLES]}, {"spool": 0.3})
    assert not [r for r in checked_campaign(campaign).remarks if "repeat the one before" in r.sentence]
    assert find_held_values(values, 0.3, 0.0).any(), "only the proof of the noise protects it"


def valve_campaign(signals, noise, keep=()):
    """One run with the command as its recorded drive."""
    time = INTERVAL * np.arange(SAMPLES)
    drives = {"command": Recorded(values=command(time), interval=INTERVAL)}
    run = BenchRun(
        "run", Path("run.csv"), Use.FIT, {}, time, signals, np.arange(SAMPLES) + 2,
        drives=drives, keep=frozenset(keep),
    )  # fmt: skip
    channels = {name: Channel("V" if name == "spool" else "MPa", size) for name, size in noise.items()}
    return Campaign("valve", run.file.parent, Valve(**drives), {}, channels, (run,), ())


def command(time):
    return 2.0 * np.sin(0.9 * time) + np.sin(2.3 * time)


def records(noise, resolution, rests=()):
    """Spool and pressure with noise, read with a resolution; the spool rests in some intervals."""
    rng, time = np.random.default_rng(5), INTERVAL * np.arange(SAMPLES)
    spool = command(time)
    for first, last in rests:
        spool[first:last] = spool[first]
    spool = resolution * np.round((spool + noise * rng.standard_normal(SAMPLES)) / resolution)
    pressure = 1e6 * command(time - 0.1) + 5e3 * rng.standard_normal(SAMPLES)
    return {"spool": spool, "pressure": pressure}


def test_a_rest_in_the_dead_band_stays_though_the_model_moves():
    signals = records(noise=1e-4, resolution=0.005, rests=[(700, 1208)])
    checked = checked_campaign(valve_campaign(signals, {"spool": 0.005, "pressure": 5e3}))
    assert np.isfinite(checked.runs[0].signals["spool"]).all() and not checked.removed
    (remark,) = [r for r in checked.remarks if "stuck" in r.sentence]
    assert remark.severity is Severity.WARNING and remark.sentence.endswith("used, as the records prove no fault")


def test_many_rests_are_one_remark():
    """A speed sensor shows exactly zero at every reversal, amid noise elsewhere."""
    signals = records(noise=0.02, resolution=1e-4)
    for first in range(200, 1800, 200):
        signals["spool"][first : first + 60] = 0.0
    checked = checked_campaign(valve_campaign(signals, {"spool": 0.02, "pressure": 5e3}))
    assert not checked.removed
    (remark,) = [r for r in checked.remarks if "stuck" in r.sentence]
    assert "for 60 samples" in remark.sentence and "more such places; used, as the records" in remark.sentence


def test_other_cycles_are_named_only_where_there_are_some():
    signals = records(noise=0.02, resolution=1e-4)
    signals["spool"][900] += 3.0
    checked = checked_campaign(valve_campaign(signals, {"spool": 0.02, "pressure": 5e3}))
    (remark,) = [r for r in checked.remarks if "outlier" in r.sentence]
    assert remark.sentence.endswith("(1 sample), far from its neighbours; 0.05 % of the record; left out")


def stuck_records():
    signals = records(noise=0.02, resolution=1e-4)
    signals["spool"][700:1208] = signals["spool"][700]
    return signals


def test_a_constant_amid_noise_is_a_stuck_sensor_and_has_no_weight():
    checked = checked_campaign(valve_campaign(stuck_records(), {"spool": 0.02, "pressure": 5e3}))
    assert np.flatnonzero(np.isnan(checked.runs[0].signals["spool"])).tolist() == list(range(700, 1208))
    (remark,) = [r for r in checked.remarks if "stuck" in r.sentence]
    assert remark.severity is Severity.ERROR and "for 508 samples" in remark.sentence
    assert remark.sentence.endswith("25 % of the record; left out")
    assert data_as_json(checked)["removed"] == [{"run": "run", "signal": "spool", "samples": 508, "share": 0.254}]


def test_the_campaign_can_keep_a_signal():
    campaign = valve_campaign(stuck_records(), {"spool": 0.02, "pressure": 5e3}, keep=["spool"])
    checked = checked_campaign(campaign)
    assert np.isfinite(checked.runs[0].signals["spool"]).all() and not checked.removed
    (remark,) = [r for r in checked.remarks if "stuck" in r.sentence]
    assert remark.severity is Severity.WARNING and remark.sentence.endswith("kept as the campaign says")


def test_samples_at_a_stated_limit_of_the_sensor_stay():
    """They say that the signal is there or beyond, also where the sensor ends at it only once."""
    signals = stuck_records()
    limit = float(signals["spool"][700])
    campaign = valve_campaign(signals, {"spool": 0.02, "pressure": 5e3})
    channel = dataclasses.replace(campaign.channels["spool"], limits=(-np.inf, limit))
    checked = checked_campaign(dataclasses.replace(campaign, channels=campaign.channels | {"spool": channel}))
    assert np.isfinite(checked.runs[0].signals["spool"]).all()
    assert not [r for r in checked.remarks if "stuck" in r.sentence]


def test_a_whole_machine_at_rest_is_not_stuck():
    signals = stuck_records()
    signals["pressure"][700:1208] = signals["pressure"][700]
    checked = checked_campaign(valve_campaign(signals, {"spool": 0.02, "pressure": 5e3}))
    assert not checked.removed


def test_a_model_that_differs_removes_no_signal():
    signals = records(noise=0.02, resolution=1e-4)
    signals["spool"] *= -1.0
    checked = checked_campaign(valve_campaign(signals, {"spool": 0.02, "pressure": 5e3}))
    (remark,) = [r for r in checked.remarks if "opposite sign" in r.sentence]
    assert remark.severity is Severity.WARNING
    assert checked.runs[0].valid_samples == 2 * SAMPLES


def test_keep_in_a_campaign_file(tmp_path):
    folder = copy_campaign(tmp_path / "bench")

    def with_two_zeros(frame):
        frame.loc[700:701, "outlet_pressure [MPa]"] = 0.0

    modify_table(folder, "run3.csv", with_two_zeros)
    path, text = folder / "campaign.yaml", (folder / "campaign.yaml").read_text()
    for line, kept in (("keep: all\n", True), ("keep: [outlet_pressure]\n", True), ("keep: [current]\n", False)):
        path.write_text(text + line)
        removed = checked_campaign(read_campaign(folder)).removed
        assert [(r.run, r.signal, r.samples) for r in removed] == ([] if kept else [("run3", "outlet_pressure", 2)])
    path.write_text(text.replace("file: run3.csv,", "file: run3.csv, keep: [outlet_pressure],"))
    assert not checked_campaign(read_campaign(folder)).removed
    path.write_text(text + "keep: [presure]\n")
    with pytest.raises((CampaignError, YamlError), match="keep: `all` or a list of signals"):
        read_campaign(folder)
