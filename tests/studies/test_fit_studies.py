"""The identification studies in short form."""

import dataclasses
import importlib
import types
from pathlib import Path

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.core import structs
from edhas_jax.machine.components.coil_and_amplifier import CurrentAmplifier
from edhas_jax.machine.components.controllers import CascadeController
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.measurements.campaign import Campaign, Channel, Use
from edhas_jax.measurements.unknown_parameters import uncertain_unknowns
from studies.rk4_reference import trajectories
from tests.support.headline import headline
from tests.support.synthetic_campaign import bench, empty_campaign

FRICTION = {"dry_friction": 22.0, "viscous_drag": 240.0, "dry_ratio": 1.05, "viscous_ratio": 0.93}


def load(name):
    return importlib.import_module(f"studies.{name}")


def test_lugre_friction_is_identified():
    study = load("identification.friction")
    study.SPEEDS, study.CREEP_AMPLITUDES = (5e-3, 20e-3, 80e-3), (60e-6,)
    found = study.identify(study.add_measurements(study.planned_campaign()))
    for name, value in found.values.items():
        assert abs(value - study.TRUTH[name]) < 4.0 * found.standard_errors[name], name
        assert found.standard_errors[name] < 0.4 * study.TRUTH[name]
    assert study.draw(found).axes


def test_standard_errors_match_the_scatter_of_the_estimates(monkeypatch, capsys):
    """The study on 60 campaigns: 240 distances of the truth from the estimate, standard normal if the errors are right.

    The share inside 95 % has a standard deviation of 1.4 %, the rms distance one of 4.6 %.
    """
    study = load("identification.fit_coverage")
    campaign = empty_campaign(bench(), lengths=(201, 201, 201))
    monkeypatch.setattr(study, "read_campaign", lambda folder: campaign)
    distances = []

    def recorded(campaign, count):
        distances.append(original(campaign, count))
        return distances[-1]

    original = study.normalised_errors
    monkeypatch.setattr(study, "normalised_errors", recorded)
    study.main(["campaign", "60"])
    printed = headline(capsys)
    assert distances[0].shape == (60, len(uncertain_unknowns(campaign))) and printed["campaigns"] == "60"
    assert 0.91 <= float(printed["coverage_95"]) <= 0.99
    assert np.sqrt(np.mean(distances[0] ** 2)) == pytest.approx(1.0, abs=0.12)


@pytest.fixture(scope="module")
def drive():
    """A record of a drive like that of EMPS, with friction known here, by the explicit Runge-Kutta reference."""
    study = load("emps.published_comparison")
    machine = edhas.ActuatorBench(
        amplifier=CurrentAmplifier(amplifier_gain=1.0),
        controller=CascadeController(cascade_position_gain=160.18, cascade_velocity_gain=243.45),
        reference=edhas.Sine(amplitude=0.1, frequency=1.0, ramp_time=0.2),
    )
    machine = edhas.change(machine, force_constant=35.15, mover_mass=95.1, mover_damping=0.0, pump_stroke=0.6)
    truth = structs.replace(machine, effects=(study.DriveFriction(**FRICTION),))
    channels = {"piston_position": Channel("m", 2e-6), "voltage": Channel("V", 0.03)}
    (run,) = empty_campaign(machine, ({"frequency": 1.0},), lengths=(2001,)).runs
    time = 1e-3 * np.arange(2001)
    made = trajectories(truth, {"mover_mass": np.array([1.03 * 95.1])}, 1e-3, len(time), tuple(channels), step=2e-5)
    rng = np.random.default_rng(4)
    signals = {n: v[:, 0] + channels[n].noise * rng.standard_normal(len(time)) for n, v in made.items()}
    run = dataclasses.replace(run, use=Use.FIT, time=time, signals=signals, lines=np.arange(2001) + 2)
    return Campaign("drive", Path("drive"), machine, {"mover_mass": 0.1}, channels, (run,), ())


@pytest.mark.parametrize(("velocity", "force"), [(0.1, -(22.0 + 24.0 + 3.0)), (-0.1, 22.0 * 1.05 + 24.0 * 0.93 - 3.0)])
def test_the_friction_of_the_drive_is_its_formula(velocity, force):
    friction = load("emps.published_comparison").DriveFriction(**FRICTION, force_offset=3.0)
    found = friction.mover_friction(types.SimpleNamespace(piston_velocity=velocity), None)
    assert -float(found) == pytest.approx(force, rel=1e-9)


def test_the_drive_study_finds_the_friction_that_the_record_was_made_with(drive):
    study = load("emps.published_comparison")
    columns, names = study.MODELS["asymmetric"]
    found = study.fit_loop(drive, names)
    for name, value in (FRICTION | {"mover_mass": 1.03 * 95.1}).items():
        assert abs(found.values[name] - value) < 4.0 * found.standard_errors[name] < 0.2 * value, name
    assert study.loop_error(found) == pytest.approx(2e-6, rel=0.1)
    assert study.loop_error(study.fit_loop(drive, ())) > 10e-6
    assert study.force_error(drive, columns) < 3.0 < 25.0 < study.force_error(drive, ())


def test_the_delay_of_the_measured_speed_is_found_in_the_record(drive):
    """Set point, position and command are enough; no model of the machine is needed."""
    study = load("emps.whole_record")
    (run,), law, lag = drive.runs, drive.machine.controller, 1.5e-3
    time = run.time

    def motion(t, order):
        omegas, sizes = 2.0 * np.pi * np.array([1.0, 5.3]), np.array([0.1, 0.01])
        return sum(a * w**order * np.sin(w * t + 0.5 * np.pi * order) for w, a in zip(omegas, sizes, strict=True))

    set_point = motion(time, 0) + 4e-3 * np.cos(2.0 * np.pi * 2.1 * time)
    speed_set_point = law.cascade_position_gain * (set_point - motion(time, 0))
    voltage = law.cascade_velocity_gain * (speed_set_point - motion(time - lag, 1))
    voltage += 2e-3 * np.random.default_rng(1).standard_normal(len(time))
    signals = {"piston_position": motion(time, 0), "voltage": voltage}
    late = dataclasses.replace(run, signals=signals, reference=Recorded(values=set_point, interval=1e-3))
    found = study.speed_delay(late, law)
    assert found.delay == pytest.approx(lag, abs=5e-6) and found.gain == pytest.approx(1.0, abs=1e-4)
    assert found.rms < 3e-3 and study.compare_law(late, law, 0.0).rms > 100.0 * found.rms


def test_a_controller_with_late_speed_follows_its_law(drive):
    """The simulated command is that of the control law if the speed in it is delayed by the lag."""
    study = load("emps.whole_record")
    lag = 0.5e-3
    machine = study.with_late_speed(drive, lag).machine
    time, channels = drive.runs[0].time, ("piston_position", "voltage", "reference")
    made = trajectories(machine, {"mover_mass": np.array([95.1])}, 1e-3, len(time), channels, step=2e-5)
    position, voltage, set_point = (made[n][:, 0] for n in channels)
    run = dataclasses.replace(
        drive.runs[0], signals={"piston_position": position, "voltage": voltage},
        reference=Recorded(values=set_point, interval=1e-3),
    )  # fmt: skip
    assert study.compare_law(run, drive.machine.controller, lag).gain == pytest.approx(1.0, abs=1e-3)
    assert study.compare_law(run, drive.machine.controller, 0.0).gain > 1.04


def test_the_drive_record_is_split_where_the_drive_has_returned():
    """Two strokes: the second half begins where the first one did, has its own set point, and is held out."""
    study = load("emps.discovery")
    time = 1e-2 * np.arange(801)
    position = np.where(time < 4.3, 1.0 - np.cos(2 * np.pi * time / 4.3), 1.0 - np.cos(2 * np.pi * (time - 4.3) / 3.7))
    campaign = empty_campaign(bench())
    signals = {"piston_position": position, "voltage": 3.0 + time}
    run = dataclasses.replace(campaign.runs[0], time=time, signals=signals, lines=np.arange(801) + 2)
    run = dataclasses.replace(run, reference=Recorded(values=0.1 * position, interval=1e-2))
    first, second = study.split_record(dataclasses.replace(campaign, runs=(run,))).runs
    assert [first.use, second.use] == [Use.FIT, Use.HOLDOUT]
    assert len(first.time) == 430 and second.time[0] == 0.0 and second.lines[0] == 432
    np.testing.assert_array_equal(second.reference.values, 0.1 * position[430:])
    assert np.isnan(second.signals["voltage"][:10]).all() and second.signals["voltage"][10] == pytest.approx(7.4)
