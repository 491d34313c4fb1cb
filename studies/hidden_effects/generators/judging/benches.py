"""Test benches and their test plans, for the judging cases."""

from edhas_jax.machine import effects as library
from edhas_jax.machine.rigs import ActuatorBench, ActuatorSystem, PumpBench
from edhas_jax.measurements.campaign import Channel
from studies.hidden_effects.generators.benches import Bench, planned_runs

ACTUATOR_UNCERTAIN = {
    "coil_resistance": 0.025, "coil_inductance": 0.05, "force_constant": 0.02, "mover_damping": 0.35,
    "coulomb_friction": 0.35, "static_friction": 0.35,
}  # fmt: skip
PUMP_UNCERTAIN = ACTUATOR_UNCERTAIN | {
    "oil_viscosity": 0.18, "air_fraction": 0.45, "valve_preload": 0.1, "valve_damping": 0.25,
    "piston_clearance": 0.08, "load_orifice_area": 0.025, "plunger_mass": 0.05, "accumulator_pressure": 0.02,
}  # fmt: skip
SYSTEM_UNCERTAIN = ACTUATOR_UNCERTAIN | {
    "oil_viscosity": 0.18, "air_fraction": 0.45, "piston_clearance": 0.08, "load_mass": 0.03,
    "cylinder_sliding_friction": 0.35, "cylinder_breakaway_friction": 0.35, "cylinder_damping": 0.2,
    "reversing_valve_area": 0.04,
}  # fmt: skip
VOLTAGE, CURRENT = Channel("V", 0.025), Channel("A", 0.025)
POSITION, SPEED, CYLINDER_SPEED = Channel("mm", 6e-6), Channel("m/s", 1.5e-3), Channel("m/s", 1e-3)
PRESSURE, CHAMBER, FLOW = Channel("MPa", 1.2e3), Channel("MPa", 3e3), Channel("L/min", 2.5e-7)
PUMP_EFFECTS = (library.LugreFriction, library.PistonLeakage, library.EntrainedAir)
PUMP_CONDITIONS = {"frequency": 1.0, "amplitude": 1e-3, "load_orifice_area": 1e-6}

BENCHES = (
    Bench(
        "pump with both chambers watched", PumpBench, (*PUMP_EFFECTS, library.HoseCompliance),
        PUMP_UNCERTAIN | {"hose_compliance": 0.3},
        {"current": CURRENT, "piston_position": POSITION, "chamber_pressure_a": CHAMBER, "chamber_pressure_b": CHAMBER,
         "outlet_pressure": PRESSURE},
        planned_runs(
            PUMP_CONDITIONS,
            ("fit", 0.48, 7.4, 3.4, 3.2), ("fit", 0.38, 11.8, 3.0, 1.1), ("fit", 0.30, 17.1, 3.5, 2.3),
            ("fit", 0.26, 22.7, 2.8, 0.8), ("fit", 0.24, 28.6, 3.0, 3.9), ("holdout", 0.36, 13.1, 3.2, 1.9),
            ("holdout", 0.26, 25.3, 2.5, 1.3),
        ), 2e-4, 4.0,
    ),
    Bench(
        "pump on a workshop supply", PumpBench, (*PUMP_EFFECTS, library.InverterDeadTime),
        PUMP_UNCERTAIN | {"dead_time_voltage": 0.25},
        {"voltage": VOLTAGE, "current": CURRENT, "piston_position": POSITION, "outlet_pressure": PRESSURE,
         "outlet_flow": FLOW},
        planned_runs(
            PUMP_CONDITIONS,
            ("fit", 0.62, 5.7, 4.1, 2.7), ("fit", 0.34, 13.6, 3.7, 4.0), ("fit", 0.28, 21.3, 3.3, 1.5),
            ("fit", 0.24, 30.4, 2.7, 2.2), ("fit", 0.46, 8.8, 2.4, 0.9), ("fit", 0.30, 18.2, 2.0, 1.7),
            ("fit", 0.24, 26.9, 2.3, 4.7), ("holdout", 0.40, 10.9, 3.6, 3.1), ("holdout", 0.26, 24.4, 3.1, 1.0),
        ), 2e-4, 3.0, {"supply_voltage": 22.0, "dead_time_voltage": 0.8},
    ),
    Bench(
        "pump from a cold start on", PumpBench, PUMP_EFFECTS, PUMP_UNCERTAIN,
        {"voltage": VOLTAGE, "piston_position": POSITION, "piston_velocity": SPEED, "chamber_pressure_b": CHAMBER,
         "outlet_flow": FLOW},
        planned_runs(
            PUMP_CONDITIONS | {"oil_temperature": 1.0},
            ("fit", 0.44, 9.1, 3.5, 1.8, 287.15), ("fit", 0.34, 15.1, 3.1, 3.7, 295.15),
            ("fit", 0.28, 23.2, 2.9, 1.4, 304.15), ("fit", 0.30, 19.7, 2.2, 0.9, 317.15),
            ("fit", 0.46, 7.9, 3.8, 2.9, 328.15), ("holdout", 0.36, 12.2, 2.7, 1.2, 321.15),
            ("holdout", 0.30, 21.0, 3.0, 2.5, 300.15),
        ), 2.5e-4, 3.0, {"piston_clearance": 34e-6},
    ),
    Bench(
        "actuator in its guide", ActuatorBench, (library.LugreFriction, library.ForceConstantDroop),
        ACTUATOR_UNCERTAIN | {"droop": 0.3, "mover_mass": 0.03},
        {"voltage": VOLTAGE, "current": CURRENT, "piston_velocity": SPEED},
        planned_runs(
            {"frequency": 1.0, "amplitude": 1e-3},
            ("fit", 0.56, 5.9, 4.2), ("fit", 0.34, 13.3, 3.5), ("fit", 0.28, 20.7, 3.1), ("fit", 0.40, 11.4, 2.1),
            ("fit", 0.24, 28.3, 2.8), ("fit", 0.24, 36.1, 1.6), ("fit", 0.30, 16.9, 1.0), ("holdout", 0.36, 15.3, 3.8),
            ("holdout", 0.26, 24.9, 2.4),
        ), 1.6e-4, 1.2,
    ),
    Bench(
        "five moves of a heavy load", ActuatorSystem, (*PUMP_EFFECTS, library.KarnoppFriction),
        SYSTEM_UNCERTAIN,
        {"current": CURRENT, "piston_velocity": SPEED, "outlet_pressure": PRESSURE, "head_pressure": PRESSURE,
         "cylinder_position": POSITION, "cylinder_velocity": CYLINDER_SPEED},
        planned_runs(
            {"target.step_size": 1e-3, "frequency": 1.0, "ramp_time": 1.0, "load_force": 1.0},
            ("fit", 0.5, 10.3, 18.4, 0.09, 25.0), ("fit", 0.5, 5.6, 14.7, 0.12, 140.0),
            ("fit", 0.5, 7.9, 20.6, 0.1, 60.0), ("fit", 0.5, 9.4, 12.8, 0.1, 105.0),
            ("holdout", 0.5, 6.9, 16.6, 0.1, 80.0),
        ), 2e-4, 1.0, {"load_mass": 2.5},
    ),
)  # fmt: skip
