"""Benchmark campaigns that are difficult to fit: a coarse time step is misleading, or χ² has many local minima."""

import functools

import numpy as np

from edhas_jax.diagnosis.search.diagnose import diagnose
from edhas_jax.diagnosis.search.holdout_split import split_for_holdout
from edhas_jax.inference.fit.calibrated_model import CALIBRATION_STEPS, calibrate, misfit_beyond_noise
from edhas_jax.inference.fit.evaluated_fit import find_minima
from edhas_jax.inference.fit.fit_problem import calibration_problem
from edhas_jax.inference.fit.unpredictable_part import unpredictable_part
from edhas_jax.machine.effects import (
    LIBRARY,
    EntrainedAir,
    KarnoppFriction,
    LugreFriction,
    ParasiticSpring,
    PistonLeakage,
)
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.machine.rigs import ActuatorBench, ActuatorSystem, PumpBench
from edhas_jax.measurements.campaign import Campaign, Channel
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.time_resolution import MAX_DERIVATIVE, choose_time_resolution
from studies.hidden_effects.generators.benches import Bench, planned_runs
from studies.hidden_effects.generators.laws import Law, law
from studies.hidden_effects.generators.records import recorded
from studies.hidden_effects.generators.sizes import mounted
from studies.synthetic_campaign import planned_campaign

OF_ACTUATOR = {
    "coil_resistance": 0.02, "force_constant": 0.02, "mover_damping": 0.25, "coulomb_friction": 0.25,
    "static_friction": 0.25,
}  # fmt: skip
OF_OIL = {"oil_viscosity": 0.15, "air_fraction": 0.4, "piston_clearance": 0.1, "pump_damping": 0.3}
OF_VALVES = {"valve_spring_rate": 0.05, "valve_damping": 0.15, "load_orifice_area": 0.03}
OF_CYLINDER = {
    "cylinder_sliding_friction": 0.25, "cylinder_breakaway_friction": 0.25, "cylinder_damping": 0.2,
    "reversing_valve_area": 0.05,
}  # fmt: skip
POSITION, VOLTAGE = Channel("mm", 5e-6), Channel("V", 0.02)
PUMP_EFFECTS = (LugreFriction, PistonLeakage, EntrainedAir)
# three runs of the pump in which nothing is missing, and whose valves bounce
PUMP = Bench(
    "pump", PumpBench, PUMP_EFFECTS, OF_ACTUATOR | OF_OIL | OF_VALVES,
    {"voltage": VOLTAGE, "piston_position": POSITION, "outlet_pressure": Channel("MPa", 1.5e3)},
    planned_runs(
        {"frequency": 1.0, "amplitude": 1e-3, "load_orifice_area": 1e-6},
        ("fit", 0.4532, 5.0, 3.5, 4.2), ("fit", 0.17, 20.0, 3.5, 4.2), ("fit", 0.2644, 10.0, 3.5, 1.2),
        ("holdout", 0.2014, 15.0, 3.5, 2.0),
    ), 2e-4, 1.0,
)  # fmt: skip
OF_PUMP = {
    "coil_resistance": 1.394, "force_constant": 25.61, "mover_damping": 13.38, "coulomb_friction": 4.031,
    "static_friction": 5.963, "oil_viscosity": 0.0324, "air_fraction": 2.693e-3, "valve_spring_rate": 144.5,
    "valve_damping": 1.221, "piston_clearance": 16.37e-6, "pump_damping": 4.2,
}  # fmt: skip
# a cylinder that sticks, and a bias force that the model does not have
SYSTEM = Bench(
    "system", ActuatorSystem, (*PUMP_EFFECTS, KarnoppFriction), OF_ACTUATOR | OF_OIL | OF_CYLINDER,
    {"piston_position": POSITION, "outlet_pressure": Channel("MPa", 2e3), "cylinder_position": POSITION},
    planned_runs(
        {"target.step_size": 1e-3, "frequency": 1.0, "ramp_time": 1.0, "load_force": 1.0},
        ("fit", 0.5916, 12.0, 16.0, 0.1, 20.0), ("fit", 0.5916, 5.0, 20.0, 0.1, 150.0),
    ), 2e-4, 1.0,
)  # fmt: skip
OF_SYSTEM = {
    "coil_resistance": 1.456, "force_constant": 24.3, "mover_damping": 18.68, "coulomb_friction": 4.814,
    "static_friction": 6.03, "oil_viscosity": 0.03884, "air_fraction": 6.912e-3, "piston_clearance": 21.54e-6,
    "pump_damping": 9.111, "cylinder_sliding_friction": 13.93, "cylinder_breakaway_friction": 24.28,
    "cylinder_damping": 91.31, "reversing_valve_area": 5.579e-6,
}  # fmt: skip
BIAS = law(None, "TrailingBias", "Source: chosen.", {"bias_size": ("N", -5.0, 5.0)},
           mover_force=lambda e, s, z: -e.bias_size * (1.0 - 0.4 * s.piston_position / 5e-3))  # fmt: skip
ACTUATOR = Bench(
    "actuator", ActuatorBench, (LugreFriction,), OF_ACTUATOR,
    {"voltage": VOLTAGE, "current": Channel("A", 0.02), "piston_position": POSITION},
    planned_runs(
        {"frequency": 1.0, "amplitude": 1e-3},
        ("fit", 0.186, 25.0, 3.5), ("fit", 0.2478, 10.0, 1.2), ("holdout", 0.1984, 18.0, 3.0),
    ), 2e-4, 1.0,
)  # fmt: skip
OF_THE_ACTUATOR = {
    "coil_resistance": 1.367, "force_constant": 24.15, "mover_damping": 15.29, "coulomb_friction": 4.707,
    "static_friction": 8.377,
}  # fmt: skip
SPRING = law(ParasiticSpring, "HardeningSpring", "Source: Duffing (1918).", {"spring_size": ("N/m", 50.0, 3000.0)},
             mover_force=lambda e, s, z:
             -e.spring_size * s.piston_position * (1.0 + (s.piston_position / 3e-3) ** 2))  # fmt: skip


def measured(bench: Bench, values: dict[str, float], hidden: Law | None = None, size: float = 0.0) -> Campaign:
    """What a bench measures with these parameters, and with a hidden law of a size."""
    machine = bench.machine()
    plan = planned_campaign(bench.id, machine, bench.uncertain, bench.channels, bench.runs, bench.interval)
    truth = set_parameters(machine, values)
    truth = truth if hidden is None else mounted(truth, hidden, {hidden.size.name: size})
    return recorded(plan, truth, np.random.default_rng(0))


def prepared(campaign: Campaign) -> Campaign:
    """A campaign with its data checked; some runs, or the last third of each run, are held out from fits."""
    return split_for_holdout(checked_campaign(campaign))[0]


@functools.cache
def pump_campaign() -> Campaign:
    """The pump whose valves bounce."""
    return prepared(measured(PUMP, OF_PUMP))


@functools.cache
def system_campaign() -> Campaign:
    """The cylinder that sticks."""
    return prepared(measured(SYSTEM, OF_SYSTEM, BIAS, -1.843))


def test_too_coarse_a_step_has_false_minima():
    campaign = pump_campaign()
    problem = calibration_problem(campaign)
    resolution = choose_time_resolution(problem.model(), np.zeros(len(problem.unknowns)))
    starts = np.clip(np.random.default_rng(0).normal(size=(8, len(problem.unknowns))), -2.0, 2.0)
    starts[0] = 0.0
    coarse, finer = (
        find_minima(problem, starts, factor * resolution.coarse, CALIBRATION_STEPS).model.cost for factor in (1, 2)
    )
    assert np.ptp(coarse) > 300.0 and np.ptp(finer) < 3.0  # nats
    calibrated, chosen = calibrate(campaign)
    assert misfit_beyond_noise(calibrated) == 0.0 and chosen.coarse == chosen.fine


def test_derivatives_of_a_cylinder_that_sticks_are_bounded():
    campaign = system_campaign()
    problem = calibration_problem(campaign)
    model, x = problem.model(), np.zeros(len(problem.unknowns))
    resolution = choose_time_resolution(model, x)

    def largest(steps: int) -> float:
        found = model.predict_all_runs(x, steps, with_sensitivities=True)
        return max(np.abs(p.sensitivities[n]).max() / np.ptp(v) for p in found.values() for n, v in p.values.items())

    assert largest(resolution.coarse) < MAX_DERIVATIVE < 1e6 < largest(model.min_steps_per_sample())


def test_a_cylinder_that_sticks_makes_signals_irregular():
    """Neighbours of a point of the whole system scatter, those of a point of the pump do not."""
    scatter = []
    for campaign in (system_campaign(), pump_campaign()):
        problem = calibration_problem(campaign)
        x = np.zeros(len(problem.unknowns))
        steps = choose_time_resolution(problem.model(), x).fine
        scatter.append(unpredictable_part(problem, x, steps, min_scatter=8.0))
    system, pump = scatter
    assert max(size / system_campaign().channels[name].noise for name, size in system.items()) > 0.02
    assert pump == {}


def test_of_two_effects_that_imitate_each_other_the_plausible_one_stays():
    """The spring has another law than that of the library, and a cogging force of long pitch fits as well."""
    found = diagnose(measured(ACTUATOR, OF_THE_ACTUATOR, SPRING, 557.2), LIBRARY)
    assert [candidate.name for candidate in found.named] == ["parasitic_spring"]
    assert [law.differs for law in found.laws] == [True]
