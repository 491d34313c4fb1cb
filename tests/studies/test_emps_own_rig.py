"""The linear drive as a machine of one's own: its closed loop, its slots, and a record of the same shape."""

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

import edhas_jax as edhas
from edhas_jax.core.structs import replace
from edhas_jax.diagnosis.search.chosen_effects import calibrated_model, with_effect
from edhas_jax.machine.effects.mover.lugre_friction import LugreFriction
from edhas_jax.measurements.campaign import Use
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.simulation.rig_contract import run_is_valid, slots_act
from edhas_jax.simulation.run_settings import Simulation
from studies.emps.own_rig import campaign_of
from studies.emps.rig import LinearDrive


def test_the_closed_loop_is_the_linear_one():
    sine = edhas.Sine(amplitude=0.02, frequency=0.5, ramp_time=0.0)
    run = edhas.simulate(replace(LinearDrive(), target=sine), Simulation(duration=4.0, sample_rate=500.0))
    gain, kp, kv, mass = 35.15065, 160.18, 243.45, 95.1
    loop = StateSpace([[0.0, 1.0], [-gain * kv * kp / mass, -gain * kv / mass]], [[0.0], [gain * kv * kp / mass]],
                      [[1.0, 0.0]], [[0.0]])  # fmt: skip
    time = np.linspace(0.0, 4.0, 20001)
    exact = lsim(loop, 0.02 * np.sin(np.pi * time), time)[1]
    reached = np.interp(run.signals["time"], time, exact)
    assert np.abs(run.signals["piston_position"] - reached).max() < 1e-6


def test_the_check_names_the_effects_of_the_library_and_what_others_read():
    (found,) = [finding for finding in slots_act(LinearDrive()) if finding.check == "library"]
    mounted, _, lacking = found.sentence.partition("; no signal")
    assert "lugre_friction" in mounted and "cogging_force" in mounted
    assert "seal_friction (chamber_pressure_a)" in lacking and "lugre_friction" not in lacking


def test_friction_is_recovered_from_a_record_that_begins_in_motion(tmp_path):
    time = 1e-3 * np.arange(8000)
    target = 0.05 * (1.0 - np.cos(2.0 * np.pi * time / 4.0)) + 0.01 * np.sin(2.0 * np.pi * time)
    friction = LugreFriction(coulomb_friction=20.0, static_friction=20.0, viscous_friction=200.0)
    plant = replace(LinearDrive(), effects=(friction,), target=edhas.Recorded(values=target, interval=1e-3))
    signals = edhas.simulate(plant, Simulation(duration=8.0, sample_rate=1000.0)).signals
    rng = np.random.default_rng(0)
    rows = np.column_stack([
        signals["time"], np.interp(signals["time"], time, target),
        signals["piston_position"] + 2e-6 * rng.normal(size=len(signals["time"])),
        signals["voltage"] + 0.03 * rng.normal(size=len(signals["time"])),
    ])[1000:]  # fmt: skip
    rows[:, 0] -= rows[0, 0]
    header = "time [s],reference_position [m],piston_position [m],voltage [V]"
    np.savetxt(tmp_path / "run1.csv", rows, fmt="%.9g", delimiter=",", header=header, comments="")
    campaign = checked_campaign(campaign_of(tmp_path / "run1.csv"))
    assert [run.use for run in campaign.runs] == [Use.FIT, Use.HOLDOUT]
    model = with_effect(campaign, calibrated_model(campaign), LugreFriction, max_steps=30)
    values = model.evaluated.fit.values
    assert values["moved_mass"] == pytest.approx(95.1, rel=0.01)
    assert values["lugre_friction.coulomb_friction"] == pytest.approx(20.0, rel=0.05)
    assert values["lugre_friction.viscous_friction"] == pytest.approx(200.0, rel=0.05)
    assert model.evaluated.rms_over_noise(Use.HOLDOUT) < 1.2


def test_the_check_says_where_nothing_moves():
    (still,) = [f for f in run_is_valid(LinearDrive()) if f.check == "run"]
    assert still.passed and "nothing moves" in still.sentence
    driven = replace(LinearDrive(), target=edhas.Sine(amplitude=0.02, frequency=0.5, ramp_time=0.0))
    (moving,) = [f for f in run_is_valid(driven) if f.check == "run"]
    assert moving.passed and "nothing moves" not in moving.sentence
