"""Validity of results: runs and designs that are wrong, or that a machine cannot give, say so."""

import dataclasses
import json

import jax.numpy as jnp
import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.config.machine_config import read_config
from edhas_jax.config.run_folder import save_run
from edhas_jax.core.structs import par
from edhas_jax.design.batch.batch import BatchSettings, run_designs
from edhas_jax.machine.effects import Effect, EffectError, EntrainedAir, LugreFriction, PistonLeakage
from edhas_jax.machine.effects.validation import check_effect
from edhas_jax.simulation.run_checks import check_run, largest_change, step_change
from edhas_jax.simulation.validity import STEP_SENSITIVITY, Status, failed_tests
from tests.support import CONFIGS, ROOT

PAPER = CONFIGS / "paper.yaml"
HARD_VALVES = ["valve_contact_stiffness=100MN/m", "load_orifice_area=1mm^2", "frequency=20Hz", "duration=0.3s"]
PUMP = edhas.PumpBench(effects=(LugreFriction(), PistonLeakage(), EntrainedAir()))


def flow(run) -> float:
    """Mean flow [L/min]."""
    return run.metrics["mean_flow"].value * 6e4


def run_of(*overrides: str):
    config = read_config(PAPER, [*overrides])
    return edhas.simulate(config.machine, config.simulation)


def set_options(overrides) -> list[str]:
    return [word for override in overrides for word in ("--set", override)]


def test_the_default_step_is_halved_until_the_result_is_right(tmp_path, capsys):
    folder = tmp_path / "run"
    assert main(["simulate", str(PAPER), *set_options(HARD_VALVES), "--out", str(folder), "--no-figure"]) == 0
    printed = capsys.readouterr().out
    assert "20 µs is too large" in printed and "valid: periodic" in printed
    run = edhas.open_run(folder)
    # 0.61 L/min at 20 µs
    assert flow(run) == pytest.approx(flow(run_of(*HARD_VALVES, "step=1us")), rel=5e-3)
    assert run.valid and run.status is Status.OK and run.step < 20e-6


def test_oil_that_a_plunger_drags_through_its_gap_counts_as_swept():
    """Without it a pump with a wide gap would have more than 100 %; the same in a run and in a batch."""
    wide = {"piston_clearance": np.array([80e-6]), "load_orifice_area": np.array([10e-6])}
    run = edhas.simulate(PUMP, edhas.Simulation(duration=0.5), **{n: float(v[0]) for n, v in wide.items()})
    efficiency = run.metrics["volumetric_efficiency"]
    assert 0.985 < efficiency.value < 1.0 and str(efficiency) == f"{100 * efficiency.value:.5g} %"
    assert run.metrics["mean_flow"].value > PUMP.pump.area() * mean_speed(run) > 0.0
    batch = run_designs(PUMP, wide, BatchSettings())
    assert float(batch["volumetric_efficiency"][0]) == pytest.approx(efficiency.value, rel=1e-3)


def mean_speed(run) -> float:
    """Mean of the speed of the piston over the last whole cycles [m/s]."""
    t, cycle = run.signals["time"], 1.0 / float(run.machine.reference.frequency)
    inside = t >= t[-1] - 2.0 * cycle
    return float(np.abs(run.signals["piston_velocity"][inside]).mean())


@pytest.mark.parametrize(
    ("changed", "fails"),
    [
        ({}, False),
        ({"volumetric_efficiency": 1.0004}, False),
        ({"volumetric_efficiency": 1.001}, True),
        ({"volumetric_efficiency": -0.03}, True),
        ({"delivered_power": 10.02, "copper_loss": 0.0}, True),
        ({"delivered_power": 9.9, "copper_loss": 0.0}, False),
    ],
)
def test_an_efficiency_above_one_is_not_valid(changed, fails):
    values = {"mean_electrical_power": 10.0, "copper_loss": 2.0, "delivered_power": 5.0, "volumetric_efficiency": 0.9}
    applies = dict(failed_tests(PUMP, values | changed, periodic=True, xp=np))
    assert bool(applies[Status.IMPLAUSIBLE]) is fails and not Status.IMPLAUSIBLE.is_valid


def test_a_step_that_is_too_large_gives_an_invalid_result(tmp_path, capsys):
    folder = tmp_path / "run"
    asked = [*set_options([*HARD_VALVES, "step=20us"]), "--out", str(folder), "--no-figure"]
    assert main(["simulate", str(PAPER), *asked]) == 3
    printed = capsys.readouterr().out
    assert "not valid: step_too_large" in printed and "use step: " in printed
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["status"] == "step_too_large" and metrics["valid"] is False and "mean_flow" in metrics
    step = metrics["reason"].partition("use step: ")[2]
    run = edhas.open_run(folder)
    assert not run.valid and run.status is Status.STEP_TOO_LARGE and run.reason == metrics["reason"]
    better = run_of(*HARD_VALVES, f"step={step}")
    assert better.valid and flow(better) == pytest.approx(1.683, rel=5e-3)


@pytest.mark.parametrize(
    "overrides",
    [
        ["stop_stiffness=10 GN/m", "amplitude=8mm", "duration=0.2s"],
        ["velocity_gain=1e6 V*s/m", "duration=0.2s"],
        ["position_gain=100 MV/m", "duration=0.11s", "frequency=100Hz"],
        ["frequency=2kHz", "duration=0.11s"],
    ],
)
def test_extreme_parameters_within_their_ranges_are_not_silently_wrong(overrides):
    run = run_of("step=20us", *overrides)
    assert not run.valid and run.status is Status.STEP_TOO_LARGE


def test_undamped_valves_that_never_settle_say_so():
    run = run_of("valve_damping=0 N*s/m", "duration=0.5s")
    assert run.status in (Status.NOT_PERIODIC, Status.STEP_TOO_LARGE) and run.step < 20e-6


def test_a_machine_on_its_stops_is_valid_with_a_warning(tmp_path, capsys):
    asked = ["--set", "amplitude=6 mm", "--set", "duration=0.25s", "--out", str(tmp_path / "run"), "--no-figure"]
    assert main(["simulate", str(CONFIGS / "actuator.yaml"), *asked]) == 0
    assert "valid, with a warning: hit_stops: the piston ran onto an end stop" in capsys.readouterr().out
    run = edhas.open_run(tmp_path / "run")
    assert run.valid and run.status is Status.HIT_STOPS


def test_a_run_that_has_not_settled_says_so():
    run = run_of("amplitude=3 mm", "outlet_volume=20 L", "duration=0.4s")
    assert run.valid and run.status is Status.NOT_PERIODIC
    assert "mean flow still changes by" in run.reason


def test_too_few_samples_of_a_cycle_are_said():
    run = run_of("duration=0.3s", "sample_rate=100Hz", "accuracy=1%")
    assert not run.valid and run.status is Status.FEW_SAMPLES and "0.16 kHz" in run.reason


class PoweredMover(Effect):
    """A force along the velocity: energy from nowhere."""

    powered_damping: float = par(120.0, "N*s/m", (0.0, 1e4), "force over speed")

    def mover_force(self, s, z):
        return self.powered_damping * s.piston_velocity


FAULTY = {
    Status.HIT_STOPS: {"amplitude": 5.5e-3},
    Status.STALLED: {"supply_voltage": 1.0},
    Status.RELIEF_OPEN: {"accumulator_pressure": 20e6},
    Status.IMPLAUSIBLE: {"powered_damping": 120.0},
}


@pytest.mark.parametrize("status", FAULTY)
def test_a_run_and_a_design_have_the_same_status(status):
    machine = edhas.PumpBench(effects=(*PUMP.effects, PoweredMover(powered_damping=0.0)))
    values = FAULTY[status]
    run = edhas.simulate(edhas.change(machine, **values), edhas.Simulation(duration=0.4, step=20e-6))
    design = run_designs(machine, {n: np.array([v]) for n, v in values.items()}, BatchSettings(step=50e-6))
    assert run.status is status and Status(int(design["status"][0])) is status
    assert run.valid is status.is_valid is (status in (Status.HIT_STOPS, Status.STALLED))


def test_no_selection_by_a_metric_finds_a_design_that_is_not_ok(tmp_path):
    """At 20 MPa the open relief valve makes an efficiency of 3800 %."""
    designs = {"accumulator_pressure": np.array([0.2e6, 20e6, 0.2e6]), "amplitude": np.array([3.5e-3, 3.5e-3, 6e-3])}
    sweep = edhas.Sweep(PUMP, designs, BatchSettings(step=50e-6))
    table = edhas.run_sweep(sweep, tmp_path / "sweep")
    assert list(table["status"]) == ["ok", "relief_open", "hit_stops"]
    assert list(table.nlargest(3, "overall_efficiency").index) == [0, 1, 2] and table["mean_flow"].notna().sum() == 1
    assert 0.0 < table["overall_efficiency"].max() < 1.0
    assert "relief pressure" in table["reason"][1]


class WeakAmplifier(Effect):
    """Limits of the amplifier, beyond which the model says nothing."""

    current_limit: float = par(0.1, "A", (0.0, 1e3), "largest current")
    voltage_limit: float = par(1e3, "V", (0.0, 1e4), "largest voltage")

    def mover_force(self, s, z):
        s.record_valid_range("current", -self.current_limit, self.current_limit)
        s.record_valid_range("voltage", -self.voltage_limit, self.voltage_limit)
        return 0.0


@pytest.mark.parametrize("limits", [{"current_limit": 0.1}, {"current_limit": 100.0, "voltage_limit": 0.1}])
def test_a_design_is_tested_for_every_limited_signal(limits):
    """A single run ends at such a signal; a batch knew some of them only."""
    machine = edhas.ActuatorBench(effects=(WeakAmplifier(**limits),))
    with pytest.raises(edhas.SimulationError, match="left its physical range"):
        edhas.simulate(machine, edhas.Simulation(duration=0.2))
    design = run_designs(machine, {"mover_mass": np.array([0.12])}, BatchSettings(step=50e-6))
    assert Status(int(design["status"][0])) is Status.OUT_OF_RANGE


def test_compare_says_that_the_run_of_a_model_is_not_valid():
    campaign = edhas.read_campaign(ROOT / "tests" / "data" / "campaign_bench")
    campaign = dataclasses.replace(campaign, runs=campaign.runs[:1])
    remarks = edhas.compare(campaign, edhas.change(campaign.machine, accumulator_pressure=8e6)).remarks
    sentence = "the model's run is not valid: the accumulator pressure is above the relief pressure"
    assert any(sentence in str(remark) for remark in remarks)
    assert not any("not valid" in str(remark) for remark in edhas.compare(campaign).remarks)


def root_drag(law):
    """An effect whose friction is a function of the piston velocity."""
    body = {"strength": par(5.0, "N", (0.0, 1e3), "friction at 1 m/s"), "__annotations__": {"strength": float},
            "mover_friction": lambda self, s, z: self.strength * law(s.piston_velocity)}  # fmt: skip
    return type("RootDrag", (Effect,), body)()


def test_a_law_with_an_infinite_slope_at_rest_is_named():
    """Its time steps would leave the piston at rest, with 34 A in the coil and a balance that is NaN."""
    laws = (
        lambda v: jnp.sqrt(jnp.abs(v)), lambda v: jnp.sign(v) * jnp.abs(v) ** 0.5,
        lambda v: jnp.where(v >= 0.0, jnp.sqrt(jnp.abs(v)), -jnp.sqrt(jnp.abs(v))),
    )  # fmt: skip
    for law in laws:
        with pytest.raises(EffectError, match="RootDrag.mover_friction.* with respect to piston_velocity at rest"):
            check_effect(root_drag(law), edhas.ActuatorBench())
    check_effect(root_drag(lambda v: v / (v * v + 1e-6) ** 0.25), edhas.ActuatorBench())


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_a_balance_that_is_not_finite_is_not_valid(tmp_path, wrong):
    run = edhas.simulate(edhas.ActuatorBench(), edhas.Simulation(duration=0.2))
    broken = dataclasses.replace(run, energy=run.energy | {"copper": run.energy["copper"] + wrong})
    status, reason = check_run(broken.record, broken.energy_residual(), broken.volume_residual())
    assert status is Status.NOT_FINITE and "energy balance is not a finite number" in reason
    assert json.loads((save_run(broken, tmp_path / "run", figure=False) / "run.json").read_text())["step"] > 0.0


def test_a_signal_that_is_no_number_has_changed_beyond_all_limits():
    run = edhas.simulate(edhas.ActuatorBench(), edhas.Simulation(duration=0.2))
    signals = run.signals | {"piston_position": run.signals["piston_position"] * np.nan}
    assert largest_change(run.machine, run.signals, signals) == ("piston_position", np.inf)
    assert step_change(run.record, dataclasses.replace(run.record, signals=signals)) == ("peak stroke", np.inf)


def test_a_set_point_beyond_all_machines_gives_no_warning_of_numpy():
    """Warnings are errors in the tests: the status tells what happened."""
    run = edhas.simulate(edhas.ActuatorBench(reference=edhas.Sine(amplitude=1e300)), edhas.Simulation(duration=0.2))
    assert run.status is Status.NOT_FINITE and not np.isfinite(run.metrics["tracking_error"].value)


def test_the_oil_balance_of_a_pump_that_delivers_nothing_has_no_error():
    run = edhas.simulate(edhas.PumpBench(), edhas.Simulation(duration=0.05))
    still = dataclasses.replace(run, volume=run.volume | {n: 0.0 * run.volume[n] for n in run.volume if "deliv" in n})
    assert run.volume_residual() != 0.0 and still.volume_residual() == 0.0


@pytest.mark.parametrize(("row", "name"), [("leakage_", "mean leakage"), ("load orifice", "delivered power")])
def test_the_step_is_checked_by_leakage_and_delivered_power_too(row, name):
    """What changes by 4 % while flow, electrical power and stroke stay is no longer passed over."""
    run = edhas.simulate(PUMP, edhas.Simulation(duration=0.3))
    sums = {"energy": run.energy, "volume": run.volume}
    other = {of: {n: v * (1.04 if n.startswith(row) else 1.0) for n, v in sums[of].items()} for of in sums}
    changed, share = step_change(run.record, dataclasses.replace(run.record, **other))
    assert changed == name and share > STEP_SENSITIVITY
