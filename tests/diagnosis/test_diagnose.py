"""Hidden effects found end to end: campaigns made by another integrator, what is answered, and that it helps."""

import jax.numpy as jnp
import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.config.machine_config import read_config
from edhas_jax.core import structs
from edhas_jax.core.structs import par
from edhas_jax.diagnosis.laws.curve_basis import basis
from edhas_jax.diagnosis.report.bench_findings import clear_deviations
from edhas_jax.diagnosis.report.result_file import save_diagnosis
from edhas_jax.diagnosis.search.diagnose import diagnose
from edhas_jax.diagnosis.search.posterior import NOT_FITTED
from edhas_jax.diagnosis.search.result import Diagnosis, Verdict
from edhas_jax.inference.likelihood.bench_deviations import DeviationKind
from edhas_jax.machine.effects import (
    AsymmetricFriction,
    CoggingForce,
    Effect,
    ForceConstantDroop,
    InverterDeadTime,
    LugreFriction,
    MagneticSaturation,
    ParasiticSpring,
)
from edhas_jax.machine.effects.tabulated_law import LawPlace, table_of
from edhas_jax.measurements.campaign import Channel, Use
from edhas_jax.measurements.sensor_models import SensorLag
from studies.synthetic_campaign import PlannedRun, draw_parameters, planned_campaign, synthesise

LIBRARY = (
    AsymmetricFriction, CoggingForce, ForceConstantDroop, InverterDeadTime, MagneticSaturation, ParasiticSpring
)  # fmt: skip
CHANNELS = {"voltage": Channel("V", 0.02), "current": Channel("A", 0.02), "piston_position": Channel("mm", 5e-6)}
UNCERTAIN = {"coil_resistance": 0.02, "force_constant": 0.02, "mover_damping": 0.25, "coulomb_friction": 0.25}
RUNS = tuple(
    PlannedRun(use, 0.2, {"frequency": frequency, "amplitude": amplitude})
    for use, frequency, amplitude in (
        (Use.FIT, 10.0, 3.5e-3), (Use.FIT, 25.0, 3e-3), (Use.FIT, 15.0, 4e-3), (Use.HOLDOUT, 20.0, 3.5e-3)
    )
)  # fmt: skip


class Windage(Effect):
    """Drag with the square of the speed, which the library does not have."""

    windage: float = par(25.0, "N*s^2/m^2", (0.0, 1e3), "drag per squared speed")

    def mover_force(self, s, z):
        return -self.windage * s.piston_velocity * jnp.abs(s.piston_velocity)


class SoftDeadTime(Effect):
    """A dead time that grows more slowly with the current than that of the library."""

    voltage: float = par(0.6, "V", (0.0, 5.0), "lost voltage")

    def coil_voltage_change(self, s, z):
        return -self.voltage * s.current / (jnp.abs(s.current) + 0.4)


def diagnosed(*hidden: Effect, chains=None, seed: int, on_progress=None) -> Diagnosis:
    """The diagnosis of an actuator bench on which `hidden` acts, and whose sensors have `chains`."""
    bench = edhas.ActuatorBench(reference=edhas.Sine(ramp_time=0.05), effects=(LugreFriction(),))
    plan = planned_campaign("bench", bench, UNCERTAIN, CHANNELS, RUNS, 5e-4)
    rng = np.random.default_rng(seed)
    truth = draw_parameters(plan, bench, rng)
    truth = structs.replace(truth, effects=(*truth.effects, *hidden))
    return diagnose(synthesise(plan, truth, rng, chains), LIBRARY, on_progress=on_progress)


@pytest.fixture(scope="module")
def of_a_dead_time() -> Diagnosis:
    """The diagnosis of a bench whose amplifier has a dead time."""
    return diagnosed(InverterDeadTime(dead_time_voltage=0.8), seed=2)


@pytest.fixture(scope="module")
def of_windage() -> Diagnosis:
    """The diagnosis of a bench with a drag that the library does not have."""
    return diagnosed(Windage(windage=40.0), seed=4)


@pytest.fixture(scope="module")
def of_a_lagging_sensor() -> Diagnosis:
    """The diagnosis of a bench whose current sensor lags."""
    return diagnosed(chains={"current": (SensorLag(lag_time=1e-3),)}, seed=5)


def errors(found: Diagnosis) -> tuple[float, float, float]:
    """Residual over noise on the run that no fit has seen: before, calibrated, after."""
    return tuple(found.errors()[state]["holdout"]["overall"] for state in ("before", "calibrated", "after"))


def said(found: Diagnosis) -> str:
    """The sets and their weights, for the message of a test that fails."""
    sets = [f"{of} {weight:.3f}" for of, weight in zip(found.posterior.sets, found.posterior.weights, strict=True)]
    return f"{found.verdict}, errors {errors(found)}, sets {sets}"


def test_nothing_is_missing():
    found = diagnosed(seed=1)
    before, calibrated, after = errors(found)
    assert found.verdict is Verdict.ADEQUATE and not found.named, said(found)
    assert before > 2.0 and calibrated == after == pytest.approx(1.0, abs=0.05)
    assert found.posterior.probabilities["nothing"] > 0.5 and found.left == 0.0


def test_one_effect(of_a_dead_time):
    found = of_a_dead_time
    before, calibrated, after = errors(found)
    assert found.verdict is Verdict.MISSING_EFFECT, said(found)
    assert [c.id for c in found.named] == ["inverter_dead_time"]
    assert before > calibrated > 1.1 and after == pytest.approx(1.0, abs=0.05)
    assert found.posterior.evidence(found.named[0]) > 0.0
    assert found.posterior.probabilities["inverter_dead_time"] > 0.9 * (1.0 - NOT_FITTED)
    assert next(iter(found.posterior.locations())) == "coil"
    name = "inverter_dead_time.dead_time_voltage"
    assert abs(found.final.values[name] - 0.8) < max(0.08, 2.0 * found.final.standard_errors[name])


def test_two_effects():
    found = diagnosed(ForceConstantDroop(droop=0.15), InverterDeadTime(dead_time_voltage=0.6), seed=3)
    before, calibrated, after = errors(found)
    assert found.verdict is Verdict.MISSING_EFFECT, said(found)
    assert {c.id for c in found.named} == {"inverter_dead_time", "force_constant_droop"}
    assert before > calibrated > 1.1 and after == pytest.approx(1.0, abs=0.05)
    assert min(found.posterior.probabilities[c.name] for c in found.named) > 0.8 * (1.0 - NOT_FITTED)
    assert [len(of.members) for of in found.growth()] == [0, 1, 2]


def test_a_law_that_differs_is_mounted_as_a_curve(tmp_path):
    found = diagnosed(SoftDeadTime(), seed=5)
    assert [c.id for c in found.named] == ["inverter_dead_time"], said(found)
    assert found.laws[0].differs
    (law,) = found.curves
    assert law.of == "inverter_dead_time" and law.place == LawPlace("coil_voltage_change", "current")
    assert errors(found)[2] == pytest.approx(1.0, abs=0.05)
    fit, table = found.final, law.table(found.final)
    current = np.array([-2.0, -1.0, -0.5, 0.5, 1.0, 2.0])
    library = -fit.values["inverter_dead_time.dead_time_voltage"] * np.tanh(current / 0.05)
    true = -0.6 * current / (np.abs(current) + 0.4)
    # a part in proportion to the current is that of the resistance
    resistance = np.column_stack([current, library + basis(table.nodes, current) @ table.values - true])
    slope = resistance[:, 0] @ resistance[:, 1] / (current @ current)
    assert resistance[:, 1] - slope * current == pytest.approx(0.0, abs=0.03)
    save_diagnosis(found, tmp_path)
    written = read_config(tmp_path / "config.yaml").machine
    assert {effect.id for effect in written.effects} == {effect.id for effect in fit.machine.effects}
    assert table_of(written.effects[-1]).values == pytest.approx(table.values, rel=1e-6)


def test_an_effect_outside_the_library(of_windage):
    found = of_windage
    before, calibrated, after = errors(found)
    assert found.verdict is Verdict.UNKNOWN_EFFECT, said(found)
    assert before > calibrated > 1.1
    where = found.posterior.locations()
    # a fault of a sensor that would change nothing keeps its prior odds
    assert next(iter(where)) == "mover" and where.get("sensor", 0.0) < 0.1 and where["mover"] > 0.8
    assert found.free_term.place == LawPlace("mover_force", "piston_velocity")
    table = found.free_term.table(found.final)
    # parts that are constant in size, or in proportion to the speed, are also those of uncertain parameters
    speed, drag = table.nodes, -40.0 * table.nodes * np.abs(table.nodes)
    columns = np.column_stack([speed, np.sign(speed)])
    difference = table.values - drag
    difference = difference - columns @ np.linalg.lstsq(columns, difference)[0]
    assert np.abs(difference).max() < 0.1 * np.abs(drag).max()
    assert after == pytest.approx(1.0, abs=0.05)
    assert found.posterior.probabilities["unknown"] > 0.95 * (1.0 - NOT_FITTED)


def test_a_sensor_that_lags(of_a_lagging_sensor):
    found = of_a_lagging_sensor
    before, calibrated, after = errors(found)
    assert found.verdict is Verdict.MISSING_EFFECT, said(found)
    assert [c.name for c in found.named] == ["sensor_lag on current"]
    assert before > calibrated > 1.05 and after == pytest.approx(1.0, abs=0.05)
    assert next(iter(found.posterior.locations())) == "sensor"
    assert found.final.values["current.sensor_lag.lag_time"] == pytest.approx(1e-3, rel=0.05)


def test_an_unnecessary_correction_of_the_time_is_undone(of_a_lagging_sensor):
    """Without the lag the model fits better with all records shifted; with the lag no trigger deviates."""
    assert not any(map(any, of_a_lagging_sensor.final.problem.time_errors.values()))
    assert all(r.deviation.kind is not DeviationKind.TRIGGER for r in clear_deviations(of_a_lagging_sensor.after))
