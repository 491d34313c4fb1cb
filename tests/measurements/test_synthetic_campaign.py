"""The Runge-Kutta reference against an independent solver and its order; campaigns made with it, and their files."""

import dataclasses

import numpy as np
import pandas as pd
import pytest
import yaml

import edhas_jax as edhas
from edhas_jax.core import structs
from edhas_jax.core.units import to_si
from edhas_jax.machine import effects as library
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.parameters import get_parameter
from edhas_jax.machine.rigs import ActuatorBench, PumpBench
from edhas_jax.measurements.campaign import CampaignError, Channel, Use
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.sensor_models import SensorGain, SensorLag
from studies.campaign_writer import write_campaign
from studies.rk4_reference import Unstable, trajectories
from studies.synthetic_campaign import PlannedRun, draw_parameters, planned_campaign, synthesise
from tests.support import DATA
from tests.support.reference import nominal

CAMPAIGNS = DATA / "campaigns"
CHANNELS = {"current": Channel("A", 0.02), "piston_position": Channel("mm", 5e-6)}
UNCERTAIN = {"coil_resistance": 0.02, "coulomb_friction": 0.25}
RUNS = (
    PlannedRun(Use.FIT, 0.2, {"frequency": 20.0, "amplitude": 3e-3}),
    PlannedRun(Use.HOLDOUT, 0.15, {"frequency": 30.0, "amplitude": 2e-3}),
)


def planned(machine=None):
    return planned_campaign("bench", machine or nominal(ActuatorBench), UNCERTAIN, CHANNELS, RUNS, 5e-4)


@pytest.mark.parametrize("name", ["open02", "open06", "open09"])
def test_the_trajectories_are_those_of_an_independent_solver(name):
    """With the parameters and effects of a run made by another solver, only the noise of its sensors remains."""
    answer = yaml.safe_load((CAMPAIGNS / "answers.yaml").read_text())[name]
    table = pd.read_csv(CAMPAIGNS / f"{name}.csv")
    kinds = {kind.id: kind for kind in library.LIBRARY}
    hidden = tuple(kinds[effect](**values) for effect, values in answer["hidden"].items())
    machine = nominal(PumpBench)
    machine = edhas.change(structs.replace(machine, effects=(*machine.effects, *hidden)), **answer["parameters"])
    units = {column.split(" [")[0]: column.split("[")[1][:-1] for column in table.columns}
    si = {n: table[f"{n} [{u}]"].to_numpy() * to_si(f"1 {u}", SIGNALS[n].unit) for n, u in units.items()}
    noise = {"voltage": 0.02, "current": 0.02, "piston_position": 5e-6, "outlet_pressure": 1500.0, "outlet_flow": 2e-7}
    lanes = {"frequency": np.array([float(get_parameter(machine, "frequency"))])}
    model = trajectories(machine, lanes, si["time"][1], len(table), tuple(noise))
    residuals = [(si[n] - model[n][:, 0]) / size for n, size in noise.items()]
    assert np.sqrt(np.mean(np.square(residuals))) == pytest.approx(1.0, abs=0.02)


def test_the_reference_is_of_fourth_order():
    lanes = {"frequency": np.array([10.0, 30.0])}
    machine = edhas.change(ActuatorBench(), ramp_time="0 s")
    exact, *found = (
        trajectories(machine, lanes, 1e-3, 40, ("current", "piston_position"), step)
        for step in (1.5625e-6, 5e-5, 2.5e-5, 1.25e-5)
    )
    for name in exact:
        errors = [np.abs(seen[name] - exact[name]).max() for seen in found]
        orders = np.log2(errors[:-1]) - np.log2(errors[1:])
        assert (np.abs(orders - 4.0) < 0.25).all(), (name, errors)


def test_an_unstable_step_is_halved_or_refused():
    """With little air and high pressure a step of 2 µs is too long for a chamber, though its result looks plausible."""
    machine = edhas.change(nominal(PumpBench), air_fraction=0.002)
    lanes = {"frequency": np.array([20.0]), "load_orifice_area": np.array([1e-6])}
    found = [trajectories(machine, lanes, 2e-4, 300, ("outlet_pressure", "current"), h) for h in (2e-6, 2.5e-7)]
    for name in found[0]:
        np.testing.assert_allclose(found[0][name], found[1][name], rtol=1e-4, atol=1e-4, err_msg=name)
    with pytest.raises(Unstable, match="explicit steps"):
        trajectories(machine, lanes, 2e-4, 300, ("current",), 5e-5)


def test_parameters_are_drawn_within_two_standard_deviations():
    campaign, rng = planned(), np.random.default_rng(3)
    draws = np.array(
        [
            [float(get_parameter(draw_parameters(campaign, campaign.machine, rng), n)) for n in UNCERTAIN]
            for _ in range(300)
        ]
    )
    known = [float(get_parameter(campaign.machine, n)) for n in UNCERTAIN]
    sizes = np.log(draws / known) / list(UNCERTAIN.values())
    assert np.abs(sizes).max() == pytest.approx(2.0)  # about one in twenty is clipped
    assert np.abs(sizes.mean(axis=0)).max() < 0.2
    assert np.abs(sizes.std(axis=0) - 0.96).max() < 0.1
    assert abs(np.corrcoef(sizes.T)[0, 1]) < 0.2


def test_signals_have_the_stated_noise_and_whole_converter_steps():
    campaign = planned()
    one, other = (synthesise(campaign, campaign.machine, np.random.default_rng(seed)) for seed in (0, 1))
    for a, b in zip(one.runs, other.runs, strict=True):
        for name, channel in CHANNELS.items():
            difference = a.signals[name] - b.signals[name]
            assert np.std(difference) / channel.noise == pytest.approx(np.sqrt(2.0), rel=0.12)
    values = np.concatenate([run.signals["current"] for run in one.runs])
    bit = 2.0 * 1.25 * np.abs(values).max() / 2**16
    steps = np.diff(np.unique(values))
    assert steps.min() == pytest.approx(bit, rel=1e-3)
    np.testing.assert_allclose(steps / steps.min(), np.round(steps / steps.min()), atol=1e-6 * steps.max() / bit)


def test_a_sensor_fault_changes_its_signal_only():
    campaign = planned()
    quiet = {n: dataclasses.replace(c, noise=1e-12) for n, c in CHANNELS.items()}
    campaign = dataclasses.replace(campaign, channels=quiet)
    chains = {"current": (SensorGain(gain=1.1),)}
    without = synthesise(campaign, campaign.machine, np.random.default_rng(0)).runs[0].signals
    with_gain = synthesise(campaign, campaign.machine, np.random.default_rng(0), chains).runs[0].signals
    np.testing.assert_allclose(with_gain["current"], 1.1 * without["current"], atol=2e-3)
    np.testing.assert_array_equal(with_gain["piston_position"], without["piston_position"])
    lag = {"current": (SensorLag(lag_time=1e-3),)}
    lagged = synthesise(campaign, campaign.machine, np.random.default_rng(0), None, lag)
    # the equation of the lag, τ ẏ = u − y, integrated over the run
    after, time = lagged.runs[0].signals["current"], campaign.runs[0].time
    assert np.trapezoid(without["current"] - after, time) == pytest.approx(1e-3 * (after[-1] - after[0]), rel=0.08)
    assert np.abs(after - without["current"]).max() > 0.02


def test_a_written_campaign_reads_back_unchanged(tmp_path):
    machine = edhas.change(PumpBench(effects=(library.PistonLeakage(),)), coil_resistance="1.5 ohm")
    runs = [PlannedRun(Use.FIT, 0.02, {"frequency": 20.0}), PlannedRun(Use.HOLDOUT, 0.01, {"load_orifice_area": 2e-6})]
    channels = CHANNELS | {"outlet_pressure": Channel("MPa", 1.5e3)}
    plan = planned_campaign("mine", machine, {"coil_resistance": 0.02}, channels, runs, 5e-4)
    campaign = synthesise(plan, machine, np.random.default_rng(0))
    folder = tmp_path / "mine"
    assert write_campaign(campaign, folder)[1] == folder / "run1.csv"
    back = read_campaign(folder)
    assert not back.remarks
    assert (back.name, back.uncertain, back.channels) == (campaign.name, campaign.uncertain, campaign.channels)
    assert [type(e) for e in back.machine.effects] == [library.PistonLeakage]
    assert float(get_parameter(back.machine, "coil_resistance")) == 1.5
    for a, b in zip(back.runs, campaign.runs, strict=True):
        assert (a.use, a.conditions) == (b.use, b.conditions)
        for name, values in b.signals.items():
            np.testing.assert_allclose(a.signals[name], values, rtol=1e-5, atol=1e-9)
    with pytest.raises(CampaignError, match="exists already"):
        write_campaign(campaign, folder)


def test_what_cannot_be_synthesised_or_written_is_refused(tmp_path):
    campaign = planned()
    run = campaign.runs[0]
    uneven = dataclasses.replace(run, time=run.time**1.01)
    with pytest.raises(CampaignError, match="sampled evenly"):
        synthesise(dataclasses.replace(campaign, runs=(uneven,)), campaign.machine, np.random.default_rng(0))
    stepped = dataclasses.replace(campaign, machine=structs.replace(campaign.machine, reference=edhas.Step()))
    with pytest.raises(CampaignError, match="another reference"):
        write_campaign(stepped, tmp_path / "stepped")
