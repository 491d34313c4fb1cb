"""The study of the electro-hydraulic drive, on small synthetic records of the same shape."""

import dataclasses
import gzip
from pathlib import Path

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.core.structs import replace
from edhas_jax.diagnosis.search.chosen_effects import calibrated_model, with_effect
from edhas_jax.machine.own_rig import check_rig
from edhas_jax.measurements.campaign import BenchRun, Campaign, Channel, Use
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.clock_alignment import with_aligned_clocks
from edhas_jax.measurements.measurement_model import MeasurementModel
from studies.mbari import discovery
from studies.mbari.records import ATMOSPHERE, FITTED, HELD_OUT, POUND_FORCE, campaign_of, other_records
from studies.mbari.rig import INCH, PSI, RPM, MotorCoulomb, MotorViscous, PowerTakeOff, ReliefValve

COLUMNS = (
    "time(s),Pos(in),Spd(in/s),RPM,LowerHydPress(psig),UpperHydPress(psig),VBus,WindCurr(A),LowerSpringPressure(psia),"
    "UpperSpringPressure(psia),TestMachineForce(lbs)"
)
LATE = {FITTED: 0.1, HELD_OUT: 0.4}  # s, the recorder of the motor
HIDDEN = MotorViscous(drag=0.006), MotorCoulomb(torque=0.3), ReliefValve()


def motion(amplitudes):
    """Position of the ram (samples,) in m and its time: strokes with rests between them, some faster than others."""
    parts = [np.full(100, 0.1)]
    for speed in amplitudes:
        ramp = np.arange(0.1, 1.6, 0.02 * speed)
        parts += [ramp, np.full(100, ramp[-1]), ramp[::-1], np.full(100, 0.1)]
    position = np.convolve(np.concatenate(parts), np.hanning(25) / np.hanning(25).sum(), "same")[20:-20]
    return 0.02 * np.arange(len(position)), position


def write_record(folder, name, speeds, sign):
    """A record in the format of the bench, made with the hidden effects; `sign` is that of the lower pressure."""
    time, position = motion(speeds)
    speed = np.gradient(position, time)
    current = 30.0 * np.tanh(speed / 0.4)  # the electric machine brakes
    plant = edhas.change(replace(PowerTakeOff(), effects=HIDDEN), lower_start=ATMOSPHERE, **{
        "low.start_pressure": 1.05e6, "up.start_pressure": 0.78e6,
        "low.start_travel": 2.03 - position[0], "up.start_travel": position[0], "low.dead_volume": 0.045,
    })  # fmt: skip
    drives = {
        n: edhas.Recorded(values=v, interval=0.02) for n, v in (("ram_position", position), ("current", current))
    }
    plain = campaign_of_one(replace(plant, **drives), time)
    found = MeasurementModel(plain, plain.machine, (), plain.runs).predict_all_runs(np.zeros(0), 8)[0].values

    def late(values):
        return np.interp(time - LATE[name], time, values)

    rng = np.random.default_rng(0)
    rows = np.column_stack([
        time, position / INCH, speed / INCH, late(found["motor_speed"]) / RPM + rng.normal(0.0, 1.0, len(time)),
        sign * (found["lower_pressure"] - ATMOSPHERE) / PSI + rng.normal(0.0, 1.0, len(time)),
        (found["upper_pressure"] - ATMOSPHERE) / PSI + rng.normal(0.0, 1.0, len(time)), 300.0 + 0.0 * time,
        late(current), found["lower_gas"] / PSI, found["upper_gas"] / PSI, found["ram_force"] / POUND_FORCE,
    ])  # fmt: skip
    with gzip.open(folder / name, "wt") as stream:
        stream.write(f"#{COLUMNS}\n")
        np.savetxt(stream, rows, fmt="%.4f")


def campaign_of_one(machine, time):
    """A campaign with one run without measurements."""
    names = ("motor_speed", "lower_pressure", "upper_pressure", "ram_force", "lower_gas", "upper_gas")
    run = BenchRun("run", Path("run"), Use.FIT, {}, time, {}, np.arange(len(time)))
    return Campaign("one", Path("."), machine, {}, {n: Channel("Pa", 1.0) for n in names}, (run,), ())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    found = tmp_path_factory.mktemp("mbari")
    write_record(found, FITTED, (0.1, 0.3, 0.5), -1.0)
    write_record(found, HELD_OUT, (0.2, 0.4), 1.0)
    return found


def test_the_rig_is_declared_correctly():
    check_rig(PowerTakeOff)


def test_the_check_finds_the_reversed_sensor_and_the_clocks(folder):
    raw = checked_campaign(campaign_of(folder, clocks=False, reversed_signals=()))
    wrong = [r for r in raw.remarks if "opposite sign" in r.sentence]
    assert [(r.file.name, r.sentence.split()[0]) for r in wrong] == [(FITTED, "lower_pressure")]
    aligned = with_aligned_clocks(campaign_of(folder), 4)
    found = {r.file.name: float(r.sentence.split(" is ")[1].split()[0]) for r in aligned.remarks}
    units = {r.file.name: 1e-3 if " ms " in r.sentence else 1.0 for r in aligned.remarks}
    for name, late in LATE.items():
        assert found[name] * units[name] == pytest.approx(late, abs=0.04), "the plain model has no losses"
    before = discovery.errors_of(PowerTakeOff(), campaign_of(folder, clocks=False))
    after = discovery.errors_of(PowerTakeOff(), aligned)
    assert after[1].speed < 0.7 * before[1].speed


def test_further_records_are_judged_only(folder, tmp_path):
    assert other_records(folder) == []
    (tmp_path / "another.exp.gz").write_bytes((folder / FITTED).read_bytes())
    (other,) = other_records(tmp_path)
    aligned = with_aligned_clocks(other, 4)
    assert discovery.errors_of(PowerTakeOff(), aligned)[0].speed < 60.0
    assert other.runs[0].signals["lower_pressure"].mean() > ATMOSPHERE, "its sign is turned over"


def test_friction_is_next_and_comes_out_as_it_was_hidden(folder):
    aligned = with_aligned_clocks(campaign_of(folder), 4)
    accuracy = dataclasses.replace(aligned.stated_accuracy, clocks={})
    campaign = checked_campaign(dataclasses.replace(aligned, stated_accuracy=accuracy))
    calibrated = dataclasses.replace(calibrated_model(campaign), resolution=discovery.SEARCH)
    first = discovery.next_effect(campaign, calibrated, list(discovery.EFFECTS))
    assert first in (MotorViscous, MotorCoulomb)
    model = calibrated
    for kind in (MotorViscous, MotorCoulomb, ReliefValve):
        model = with_effect(campaign, model, kind, max_steps=40)
    values = model.evaluated.fit.values
    assert values["motor_viscous.drag"] == pytest.approx(0.006, rel=0.1)
    assert values["motor_coulomb.torque"] == pytest.approx(0.3, rel=0.1)
    errors = discovery.errors_of(discovery.fitted_machine(model), aligned)
    assert errors[0].speed < 10.0 and errors[1].speed < 10.0
