"""Benches, for judging."""

from edhas_jax.machine.effects import EntrainedAir, KarnoppFriction, LugreFriction, PistonLeakage
from edhas_jax.machine.rigs import ActuatorBench, ActuatorSystem, PumpBench
from edhas_jax.measurements.campaign import Channel
from studies.hidden_effects.generators.benches import Bench, planned_runs

ACTUATOR_UNCERTAIN = {
    "coil_resistance": 0.025, "force_constant": 0.025, "mover_mass": 0.01, "mover_damping": 0.2,
    "coulomb_friction": 0.3, "static_friction": 0.3,
}  # fmt: skip
PUMP_UNCERTAIN = ACTUATOR_UNCERTAIN | {
    "oil_viscosity": 0.12, "air_fraction": 0.5, "valve_preload": 0.1, "valve_damping": 0.25,
    "piston_clearance": 0.12, "load_orifice_area": 0.04, "pump_damping": 0.35,
}  # fmt: skip
SYSTEM_UNCERTAIN = ACTUATOR_UNCERTAIN | {
    "oil_viscosity": 0.12, "air_fraction": 0.5, "piston_clearance": 0.12, "pump_damping": 0.35,
    "cylinder_sliding_friction": 0.2, "cylinder_breakaway_friction": 0.3, "cylinder_damping": 0.3,
    "reversing_valve_area": 0.06, "load_mass": 0.03,
}  # fmt: skip
ELECTRICAL_CHANNELS = {"voltage": Channel("V", 0.025), "current": Channel("A", 0.018)}
POSITION, PRESSURE = Channel("mm", 6e-6), Channel("MPa", 1.8e3)
ACTUATOR_CHANNELS = ELECTRICAL_CHANNELS | {"piston_position": POSITION, "piston_velocity": Channel("m/s", 1.5e-3)}
PUMP_CHANNELS = ELECTRICAL_CHANNELS | {
    "piston_position": POSITION, "outlet_pressure": PRESSURE, "outlet_flow": Channel("L/min", 2.5e-7),
}  # fmt: skip
SYSTEM_CHANNELS = {
    "current": Channel("A", 0.018), "piston_position": POSITION, "outlet_pressure": PRESSURE,
    "head_pressure": PRESSURE, "rod_pressure": PRESSURE, "cylinder_position": POSITION,
}  # fmt: skip
PUMP_EFFECTS = (LugreFriction, PistonLeakage, EntrainedAir)

BENCHES = (
    Bench(
        "nine runs of the pump", PumpBench, PUMP_EFFECTS, PUMP_UNCERTAIN, PUMP_CHANNELS,
        planned_runs(
            {"frequency": 1.0, "amplitude": 1e-3, "load_orifice_area": 1e-6},
            ("fit", 0.58, 5.5, 4.1, 2.8), ("fit", 0.30, 14.5, 2.9, 3.9), ("fit", 0.24, 21.0, 3.3, 2.2),
            ("fit", 0.22, 28.5, 2.5, 3.4), ("fit", 0.36, 9.5, 3.4, 0.75), ("fit", 0.26, 17.0, 3.1, 1.15),
            ("fit", 0.28, 19.0, 3.7, 4.4), ("holdout", 0.34, 11.5, 2.7, 1.8), ("holdout", 0.24, 23.5, 2.9, 1.3),
        ), 2.2e-4, 5.0,
    ),
    Bench(  # without a current sensor
        "seven runs of the pump between 20 and 60 °C", PumpBench, PUMP_EFFECTS, PUMP_UNCERTAIN,
        {name: channel for name, channel in PUMP_CHANNELS.items() if name != "current"},
        planned_runs(
            {"frequency": 1.0, "amplitude": 1e-3, "load_orifice_area": 1e-6, "oil_temperature": 1.0},
            ("fit", 0.60, 6.5, 3.2, 2.6, 306.15), ("fit", 0.38, 12.5, 3.7, 1.9, 333.15),
            ("fit", 0.26, 24.5, 2.4, 3.1, 318.15), ("fit", 0.42, 10.5, 3.0, 0.85, 318.15),
            ("fit", 0.28, 18.5, 2.8, 1.05, 293.15), ("holdout", 0.34, 14.5, 3.5, 1.5, 326.15),
            ("holdout", 0.24, 21.5, 2.6, 2.3, 299.15),
        ), 1.8e-4, 3.0, {"supply_voltage": 14.0, "piston_clearance": 28e-6},
    ),
    Bench(
        "seven runs of the actuator", ActuatorBench, (LugreFriction,), ACTUATOR_UNCERTAIN, ACTUATOR_CHANNELS,
        planned_runs(
            {"frequency": 1.0, "amplitude": 1e-3},
            ("fit", 0.56, 5.5, 4.0), ("fit", 0.40, 8.5, 3.1), ("fit", 0.30, 13.5, 3.6), ("fit", 0.24, 22.0, 2.8),
            ("fit", 0.22, 31.0, 2.2), ("fit", 0.26, 19.5, 1.6), ("holdout", 0.28, 17.0, 2.9),
        ), 2.4e-4, 1.0,
    ),
    Bench(
        "five moves of the cylinder", ActuatorSystem, (*PUMP_EFFECTS, KarnoppFriction), SYSTEM_UNCERTAIN,
        SYSTEM_CHANNELS,
        planned_runs(
            {"target.step_size": 1e-3, "frequency": 1.0, "ramp_time": 1.0, "load_force": 1.0},
            ("fit", 0.50, 9.0, 12.5, 0.09, 25.0), ("fit", 0.45, 5.5, 15.5, 0.09, 85.0),
            ("fit", 0.55, 12.0, 19.0, 0.11, 45.0), ("fit", 0.50, 7.5, 14.5, 0.11, 140.0),
            ("holdout", 0.50, 11.0, 17.5, 0.09, 70.0),
        ), 2e-4, 1.0,
    ),
)  # fmt: skip
