"""The effects of the library against an independent program, against reference campaigns, and switched off."""

import numpy as np
import pandas as pd
import pytest
import yaml

import edhas_jax as edhas
from edhas_jax.core import structs
from edhas_jax.core.units import to_si
from edhas_jax.diagnosis.candidates.candidate import SENSOR_FAULTS
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import LIBRARY
from edhas_jax.machine.rigs import RIGS, ActuatorBench, ActuatorSystem, PumpBench, Rig, components_by_name
from edhas_jax.simulation.run import Run, Simulation, simulate
from tests.support import DATA
from tests.support.independent_solver import trajectory
from tests.support.reference import nominal, rms

REFINED = ("lugre_friction", "piston_leakage", "entrained_air")
SENSORS = {kind.id for kind in SENSOR_FAULTS}
# parameter values that switch an effect off; effects without such a value are mounted only where needed
OFF = {
    "force_constant_droop": {"droop": 0.0}, "magnetic_saturation": {"saturation_current": 1e5},
    "reluctance_force": {"inductance_slope": 0.0}, "cogging_force": {"cogging_amplitude": 0.0},
    "eddy_drag": {"eddy_coefficient": 0.0}, "inverter_dead_time": {"dead_time_voltage": 0.0},
    "supply_sag": {"supply_resistance": 0.0}, "coil_heating": {"heat_capacity": 1e6},
    "constant_bias_force": {"bias_force": 0.0}, "parasitic_spring": {"spring_rate": 0.0},
    "asymmetric_friction": {"forward_friction": 0.0}, "asymmetric_damping": {"damping_difference": 0.0},
    "stroke_dependent_friction": {"end_friction": 0.0},
    "seal_friction": {"seal_coefficient": 0.0}, "valve_flow_force": {"flow_force_coefficient": 0.0},
    "valve_adhesion": {"adhesion_force": 0.0}, "suction_seat_leakage": {"seat_leakage_area": 0.0},
    "delivery_seat_leakage": {"seat_leakage_area": 0.0}, "hose_compliance": {"hose_compliance": 0.0},
    "outlet_line_resistance": {"line_resistance": 0.0}, "oil_temperature": {"viscosity_exponent": 0.0},
    "pressure_viscosity": {"pressure_coefficient": 0.0},
}  # fmt: skip
TIMES = np.arange(0.0, 0.06001, 0.5e-3)
CONDITIONS = {"f": 20.0, "T_ramp": 0.02, "A_load": 1e-6}
NAMES = {
    "f": "frequency", "T_ramp": "ramp_time", "A_load": "load_orifice_area", "U_max": "supply_voltage",
    "T_oil": "oil_temperature",
}  # fmt: skip

# each effect with a strong value, and conditions of the run under which it acts
CASES = {
    "force_constant_droop": ({"droop": 0.3}, {}),
    "magnetic_saturation": ({"saturation_current": 3.0}, {}),
    "reluctance_force": ({"inductance_slope": 0.4}, {}),
    "cogging_force": ({"cogging_amplitude": 5.0, "cogging_pitch": 3e-3, "cogging_phase": 0.5}, {}),
    "eddy_drag": ({"eddy_coefficient": 40.0, "eddy_velocity": 0.1}, {}),
    "inverter_dead_time": ({"dead_time_voltage": 3.0}, {}),
    "supply_sag": ({"supply_resistance": 1.0}, {"U_max": 14.0}),
    "coil_heating": ({"heat_capacity": 1.0, "thermal_resistance": 0.5}, {}),
    "constant_bias_force": ({"bias_force": 5.0}, {}),
    "parasitic_spring": ({"spring_rate": 5000.0}, {}),
    "asymmetric_friction": ({"forward_friction": 5.0}, {}),
    "asymmetric_damping": ({"damping_difference": 20.0}, {}),
    "stroke_dependent_friction": ({"end_friction": 10.0}, {}),
    "seal_friction": ({"seal_coefficient": 0.2}, {}),
    "valve_flow_force": ({"flow_force_coefficient": 1.5}, {}),
    "valve_adhesion": ({"adhesion_force": 1.0}, {}),
    "suction_seat_leakage": ({"seat_leakage_area": 1e-7}, {}),
    "delivery_seat_leakage": ({"seat_leakage_area": 1e-7}, {}),
    "hose_compliance": ({"hose_compliance": 1e-12}, {}),
    "outlet_line_resistance": ({"line_resistance": 1e10}, {}),
    "oil_temperature": ({"viscosity_exponent": 0.05}, {"T_oil": 333.15}),
    "pressure_viscosity": ({"pressure_coefficient": 1e-6}, {}),
}
# effects that change the structure of the machine, several at once where they do not exclude each other
STRUCTURES = [
    {
        "coupling_compliance": {"coupling_stiffness": 1e6, "coupling_damping": 20.0},
        "amplifier_lag": {"amplifier_time": 1e-3},
        "suction_line_inertance": {"line_inertance": 1e7, "line_resistance": 1e7},
        "outlet_line_inertance": {"line_inertance": 2e7, "line_resistance": 0.0},
    },
    {
        "backlash": {"backlash_width": 50e-6},
        "suction_line_resistance": {"line_resistance": 1e9},
        "outlet_line_resistance": {"line_resistance": 1e10},
    },
]  # fmt: skip


BY_ID = {e.id: e for e in LIBRARY}


def switched(on: dict[str, dict[str, float]]) -> Rig:
    """A pump bench with every effect that can be switched off, all off except those in `on`."""
    values = {effect: own | on.get(effect, {}) for effect, own in OFF.items()}
    return PumpBench(effects=(*(BY_ID[n]() for n in REFINED), *(BY_ID[n](**own) for n, own in values.items())))


def run_of(machine: Rig, conditions: dict, step: float = 20e-6) -> Run:
    machine = edhas.change(machine, **{NAMES[name]: value for name, value in conditions.items()})
    return simulate(machine, Simulation(duration=TIMES[-1], sample_rate=2000.0, step=step))


def differences(run: Run, expected: dict) -> dict[str, float]:
    return {name: rms(run.signals[name] - values) / np.ptp(values) for name, values in expected.items()}


@pytest.fixture(scope="module")
def base():
    return trajectory({}, TIMES, **CONDITIONS)


def test_every_effect_has_a_reference_case():
    covered = {*CASES, *(name for structure in STRUCTURES for name in structure)}
    on_cylinder = {"load_spring", "cylinder_leakage_rise", "cylinder_seal_friction", "karnopp_friction"}
    assert covered | on_cylinder | set(REFINED) == {e.id for e in LIBRARY}


@pytest.mark.parametrize("effect", CASES)
def test_effect_agrees_with_an_independent_program(effect, base):
    values, conditions = CASES[effect]
    expected = trajectory({effect: values}, TIMES, **CONDITIONS, **conditions)
    run = run_of(switched({effect: values}), CONDITIONS | conditions)
    errors = differences(run, expected)
    size = {name: rms(expected[name] - base[name]) / np.ptp(base[name]) for name in base}
    assert max(errors.values()) < 3e-3, errors
    assert max(errors.values()) < 0.1 * max(size.values()), (errors, size)
    assert abs(run.energy_residual()) < 1e-6 and abs(run.volume_residual()) < 1e-6


@pytest.mark.parametrize("structure", STRUCTURES, ids="-".join)
def test_structural_effects_agree_with_an_independent_program(structure, base):
    """Agreement with the step of 20 µs, and an error that falls with half the step."""
    expected = trajectory(structure, TIMES, **CONDITIONS)
    added = tuple(BY_ID[n](**values) for n, values in structure.items())
    machine = PumpBench(effects=(*(BY_ID[n]() for n in REFINED), *added))
    coarse, fine = run_of(machine, CONDITIONS), run_of(machine, CONDITIONS, step=10e-6)
    worst = [max(differences(run, expected).values()) for run in (coarse, fine)]
    assert worst[0] < 1e-3 and worst[1] < 0.5 * worst[0]
    assert max(differences(coarse, base).values()) > 0.03
    assert abs(fine.energy_residual()) < 1e-6 and abs(fine.volume_residual()) < 1e-6


def test_switched_off_effects_change_nothing():
    bare, switched_off = run_of(nominal(PumpBench), CONDITIONS), run_of(switched({}), CONDITIONS)
    for name, value in bare.signals.items():
        tolerance = 1e-6 * np.ptp(value) + 1e-15
        np.testing.assert_allclose(switched_off.signals[name], value, rtol=1e-5, atol=tolerance, err_msg=name)


CAMPAIGNS = DATA / "campaigns"
NOISE = {"voltage": 0.02, "current": 0.02, "piston_position": 5e-6, "outlet_pressure": 1500.0, "outlet_flow": 2e-7}
ANSWERS = yaml.safe_load((CAMPAIGNS / "answers.yaml").read_text())


@pytest.mark.parametrize("name", ANSWERS)
def test_hidden_effects_explain_a_reference_run_to_its_noise(name):
    """With the hidden effects the residual is the noise; without them it is larger."""
    table = pd.read_csv(CAMPAIGNS / f"{name}.csv")
    units = {column.split(" [")[0]: column.split("[")[1][:-1] for column in table.columns}
    si = {n: table[f"{n} [{u}]"].to_numpy() * to_si(f"1 {u}", to_unit) for (n, u), to_unit in zip(
        units.items(), ("s", "V", "A", "m", "Pa", "m^3/s"), strict=True
    )}  # fmt: skip
    settings = Simulation(duration=si["time"][-1], sample_rate=1.0 / np.diff(si["time"]).mean())

    def residuals(values):
        run = simulate(edhas.change(switched(values), **ANSWERS[name]["parameters"]), settings)
        return {n: (si[n] - run.signals[n]) / noise for n, noise in NOISE.items()}

    with_hidden, bare = residuals(ANSWERS[name]["hidden"]), residuals({})
    assert abs(rms(np.concatenate(list(with_hidden.values()))) - 1.0) < 0.03
    for signal, residual in with_hidden.items():
        assert abs(rms(residual) - 1.0) < 0.06, signal
    assert rms(np.concatenate(list(bare.values()))) > 1.3


@pytest.fixture(scope="module")
def system():
    added = library.LoadSpring(spring_rate=2e4), library.CylinderLeakageRise(), library.CylinderSealFriction()
    machine = nominal(ActuatorSystem)
    return simulate(structs.replace(machine, effects=(*machine.effects, *added)), Simulation(duration=0.3))


def test_effects_of_the_cylinder_close_the_balances(system):
    assert abs(system.energy_residual()) < 1e-6 and abs(system.volume_residual()) < 1e-6
    spring = system.energy["load_spring"][-1]
    assert spring == pytest.approx(0.5 * 2e4 * system.signals["cylinder_position"][-1] ** 2, rel=1e-6)


def test_seal_friction_of_the_cylinder_grows_with_head_pressure(system):
    s = system.signals
    sliding = s["cylinder_velocity"] > 2e-3
    area = 0.25 * np.pi * (30e-3**2 - 20e-3**2)
    expected = 10.0 + 0.02 * area * (s["head_pressure"] - 101325.0)
    assert sliding.sum() > 300
    np.testing.assert_allclose(s["cylinder_friction"][sliding], expected[sliding], rtol=1e-9)


def test_leakage_of_the_cylinder_rises_with_its_position(system):
    """The leakage loss equals the integral of conductance × drop² over the samples."""
    s, last = system.signals, {n: v[-1] for n, v in system.energy.items()}
    drop = s["head_pressure"] - s["rod_pressure"]
    power = (1e-13 + 1e-11 * np.maximum(s["cylinder_position"], 0.0)) * drop**2
    assert last["cylinder leakage"] == pytest.approx(np.trapezoid(power, s["time"]), rel=1e-3)


def test_confusable_effects_and_parameters_exist():
    ids = {e.id for e in LIBRARY}
    machines = [rig(effects=tuple(e() for e in LIBRARY)) for rig in (ActuatorBench, PumpBench, ActuatorSystem)]
    parts = [part for machine in machines for part in components_by_name(machine).values()]
    names = {p.name for part in parts for p in structs.parameters(type(part))}
    assert len(RIGS) == len(machines)
    for effect in LIBRARY:
        assert effect.looks_like and effect.confused_with, effect.id
        assert set(effect.confused_with) <= ids | names | SENSORS - {effect.id}, effect.id
        assert any(p.plausible for p in structs.parameters(effect)), effect.id
