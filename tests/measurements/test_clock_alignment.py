"""Records of several recorders: a constant shift of one clock is found and removed, without a calibrated model."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from edhas_jax import Recorded, Rig, change, drive, par, signal, state
from edhas_jax.core.remark import Severity
from edhas_jax.measurements.accuracy import BenchAccuracy, RecorderClock
from edhas_jax.measurements.campaign import BenchRun, Campaign, Channel, Use
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.clock_alignment import find_clock_shifts, shifted, with_aligned_clocks
from edhas_jax.measurements.measurement_model import MeasurementModel

INTERVAL, COUNT = 0.02, 3000  # 50 Hz, a minute
TWO_CLOCKS = {"load": RecorderClock(("torque", "speed"), 0.3)}


class Shaft(Rig):
    """A shaft that a motor turns through a spring against a load; position of the motor and torque are imposed."""

    time_step, duration = 0.01, 60.0

    angle = drive("rad", "angle of the motor", 0.0)
    torque = drive("N*m", "torque of the load", 0.0)
    inertia: float = par(1.0, "kg*m^2", (0.01, 100.0), "moment of inertia")
    stiffness: float = par(30.0, "N*m/rad", (0.1, 1e4), "stiffness of the spring")
    drag: float = par(4.0, "N*m*s/rad", (0.0, 1e3), "torque per speed")
    turned = state("rad", "angle of the shaft", 0.0)
    speed = state("rad/s", "speed of the shaft", 0.0)
    spring_torque = signal("N*m", "torque of the spring")

    def equations(self, y, s):
        spring = self.stiffness * (s.angle - y.turned)
        s.set(spring_torque=spring)
        return {"turned": y.speed, "speed": (spring - s.torque - self.drag * y.speed) / self.inertia}


def smooth_steps(seed, count=COUNT):
    """A random piecewise constant record (count,), smoothed over 0.4 s."""
    rng = np.random.default_rng(seed)
    held = np.repeat(rng.normal(size=count // 100 + 1), 100)[:count]
    return np.convolve(held, np.hanning(21) / np.hanning(21).sum(), "same")


def true_run(late, name="run", count=COUNT):
    """A run whose load recorder is late by `late` [s], as a stiffer and heavier shaft than the model's does it."""
    time = INTERVAL * np.arange(count)
    drives = {"angle": smooth_steps(1, count), "torque": 10.0 * smooth_steps(2, count)}
    drives = {n: Recorded(values=v, interval=INTERVAL) for n, v in drives.items()}
    run = BenchRun(name, Path(f"{name}.csv"), Use.FIT, {}, time, {}, np.arange(count) + 2, None, drives)
    plant = change(Shaft(), inertia=1.3, stiffness=35.0, drag=5.0)
    campaign = Campaign("shaft", Path("."), plant, {}, {"speed": Channel("rad/s", 0.02)}, (run,), ())
    names = ("speed", "spring_torque")
    found = MeasurementModel(campaign, plant, (), (run,), signals=names).predict_all_runs(np.zeros(0), 4)[0].values
    rng = np.random.default_rng(3)
    run = dataclasses.replace(run, signals={n: found[n] + 0.02 * rng.normal(size=count) for n in names})
    (run,) = shifted((run,), TWO_CLOCKS["load"], -late)
    return run


def campaign_with(*runs, clocks=TWO_CLOCKS):
    """The campaign of some runs with the model that is not calibrated."""
    channels = {"speed": Channel("rad/s", 0.02), "spring_torque": Channel("N*m", 0.02)}
    accuracy = BenchAccuracy(recorder_filter=0.0, clocks=clocks)
    return Campaign("shaft", Path("."), Shaft(), {}, channels, runs, (), stated_accuracy=accuracy)


@pytest.mark.parametrize("late", [0.35, -0.11])
def test_a_late_clock_is_found_with_a_model_that_is_not_calibrated(late):
    run = true_run(late)
    found = find_clock_shifts(campaign_with(run), (run,), 2)
    assert found["load"] == pytest.approx(late, abs=0.02), "a part of a response time of the shaft, 0.17 s"


def test_the_shift_moves_signals_and_drives_of_that_recorder_only():
    run = true_run(0.36)  # 18 samples: nothing is interpolated
    (back,) = shifted((run,), TWO_CLOCKS["load"], 0.36)
    reference = true_run(0.0)
    inside = slice(18, -18)
    assert np.allclose(back.signals["speed"][inside], reference.signals["speed"][inside], rtol=0.0, atol=1e-12)
    assert np.allclose(back.drives["torque"].values[inside], reference.drives["torque"].values[inside], atol=1e-12)
    assert back.signals["spring_torque"] is run.signals["spring_torque"] and back.drives["angle"] is run.drives["angle"]
    assert np.isnan(back.signals["speed"][-10:]).all(), "what was not recorded is missing"


def test_checking_the_data_aligns_the_clocks_and_says_so():
    runs = true_run(0.35, "late"), true_run(0.0, "right")
    checked = checked_campaign(campaign_with(*runs))
    notes = [r for r in checked.remarks if "clock of load" in r.sentence]
    assert [str(r.file) for r in notes if "late in this run; corrected" in r.sentence][:1] == ["late.csv"]
    assert notes[0].severity is Severity.NOTE
    delays = {run.name: find_clock_shifts(checked, (run,), 2).get("load", 0.0) for run in checked.runs}
    assert max(map(abs, delays.values())) < 0.01, "nothing is left to align"
    without = campaign_with(*runs, clocks={})
    assert with_aligned_clocks(without, 2) is without


def test_a_machine_at_rest_is_not_a_stuck_sensor():
    """Sensors of speed show exactly zero at rest: that says nothing about the sensor, even while the model moves."""
    run = true_run(0.0)
    still = slice(1000, 2000)
    drives = {}
    for name, record in run.drives.items():
        values = np.array(record.values)
        values[still] = values[still.start]
        drives[name] = Recorded(values=values, interval=INTERVAL)
    resting = dict(run.signals) | {"speed": np.array(run.signals["speed"])}
    resting["speed"][1000:2000] = 0.0
    checked = checked_campaign(campaign_with(dataclasses.replace(run, signals=resting, drives=drives), clocks={}))
    assert np.isfinite(checked.runs[0].signals["speed"][1100:1900]).all()
    moving = dict(run.signals) | {"speed": resting["speed"]}
    checked = checked_campaign(campaign_with(dataclasses.replace(run, signals=moving), clocks={}))
    assert np.isfinite(checked.runs[0].signals["speed"][1100:1900]).all()
    assert any("speed: stuck at 0" in r.sentence for r in checked.remarks), "while the drive moves, it is said"


def test_a_reversed_sensor_is_found_in_a_long_record():
    run = true_run(0.0, count=10000)  # 200 s
    signals = dict(run.signals) | {"spring_torque": -run.signals["spring_torque"]}
    checked = checked_campaign(campaign_with(dataclasses.replace(run, signals=signals), clocks={}))
    assert any("opposite sign" in r.sentence for r in checked.remarks)
    assert "spring_torque" in checked.runs[0].signals, "the model proves nothing"


def test_a_campaign_file_names_its_clocks(tmp_path):
    (tmp_path / "shaft.py").write_text(
        "from edhas_jax import Rig, drive, par, state\n\n\nclass Lag(Rig):\n    time_step, duration = 0.01, 60.0\n"
        "    force = drive('N', 'force', 1.0)\n    delay: float = par(1.0, 's', (0.1, 10.0), 'lag')\n"
        "    speed = state('m/s', 'speed', 0.0)\n\n    def equations(self, y, s):\n"
        "        return {'speed': (s.force - y.speed) / self.delay}\n"
    )
    rows = [f"{0.02 * k:.2f},{np.sin(0.02 * k):.6f},{0.5 * np.sin(0.02 * k - 0.5):.6f}" for k in range(500)]
    (tmp_path / "run.csv").write_text("\n".join(["time [s],f [N],v [m/s]", *rows]) + "\n")
    text = (
        "rig: shaft.py:Lag\ndrives: {force: f}\nuncertain: {delay: 0.3}\n"
        "signals: {speed: {column: v, unit: m/s, noise: 0.01}}\n"
        "accuracy: {clocks: {motor: {channels: [CHANNELS], shift: 0.2 s}}}\nruns: [{file: run.csv, use: fit}]\n"
    )
    (tmp_path / "campaign.yaml").write_text(text.replace("CHANNELS", "speed, force"))
    found = read_campaign(tmp_path, [str(tmp_path / "shaft.py")]).stated_accuracy.clocks
    assert found == {"motor": RecorderClock(("speed", "force"), 0.2)}
    (tmp_path / "campaign.yaml").write_text(text.replace("CHANNELS", "spede"))
    with pytest.raises(Exception, match="spede is not recorded; nearest: speed"):
        read_campaign(tmp_path, [str(tmp_path / "shaft.py")])
