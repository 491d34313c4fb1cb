"""Test benches and their test plans, for the tuning cases."""

from edhas_jax.machine.effects import EntrainedAir, KarnoppFriction, LugreFriction, PistonLeakage
from edhas_jax.machine.rigs import ActuatorBench, ActuatorSystem, PumpBench
from edhas_jax.measurements.campaign import Channel
from studies.hidden_effects.generators.benches import Bench, planned_runs

ACTUATOR_UNCERTAIN = {
    "coil_resistance": 0.03, "force_constant": 0.03, "mover_damping": 0.3, "coulomb_friction": 0.3,
    "static_friction": 0.3, "mover_mass": 0.02,
}  # fmt: skip
PUMP_UNCERTAIN = ACTUATOR_UNCERTAIN | {
    "oil_viscosity": 0.12, "air_fraction": 0.5, "valve_spring_rate": 0.08, "valve_damping": 0.2,
    "piston_clearance": 0.12, "load_orifice_area": 0.04, "pump_damping": 0.35,
}  # fmt: skip
SYSTEM_UNCERTAIN = ACTUATOR_UNCERTAIN | {
    "oil_viscosity": 0.12, "air_fraction": 0.5, "piston_clearance": 0.12, "cylinder_sliding_friction": 0.3,
    "cylinder_breakaway_friction": 0.3, "cylinder_damping": 0.25, "reversing_valve_area": 0.06,
}  # fmt: skip
VOLTAGE, CURRENT = Channel("V", 0.03), Channel("A", 0.015)
POSITION, SPEED = Channel("mm", 4e-6), Channel("m/s", 2e-3)
PRESSURE, FLOW = Channel("MPa", 1.8e3), Channel("L/min", 3e-7)
PUMP_EFFECTS = (LugreFriction, PistonLeakage, EntrainedAir)

BENCHES = (
    Bench(
        "pump with a pressure sensor in a chamber", PumpBench, PUMP_EFFECTS, PUMP_UNCERTAIN,
        {"voltage": VOLTAGE, "current": CURRENT, "piston_position": POSITION, "chamber_pressure_a": PRESSURE,
         "outlet_pressure": PRESSURE},
        planned_runs(
            {"frequency": 1.0, "amplitude": 1e-3, "load_orifice_area": 1e-6},
            ("fit", 0.55, 6.3, 3.7, 3.6), ("fit", 0.36, 12.6, 3.1, 1.6), ("fit", 0.30, 18.7, 2.7, 4.6),
            ("fit", 0.24, 27.3, 2.9, 0.9), ("fit", 0.40, 11.2, 2.2, 2.6), ("fit", 0.26, 23.6, 3.6, 2.1),
            ("holdout", 0.34, 15.7, 3.3, 1.3), ("holdout", 0.24, 31.2, 2.4, 3.3),
        ), 2e-4, 4.0,
    ),
    Bench(
        "pump with speed and flow sensors at four oil temperatures", PumpBench, PUMP_EFFECTS, PUMP_UNCERTAIN,
        {"current": CURRENT, "piston_velocity": SPEED, "piston_position": POSITION, "outlet_pressure": PRESSURE,
         "outlet_flow": FLOW},
        planned_runs(
            {"frequency": 1.0, "amplitude": 1e-3, "load_orifice_area": 1e-6, "oil_temperature": 1.0},
            ("fit", 0.50, 8.4, 3.9, 2.4, 301.15), ("fit", 0.36, 16.3, 3.2, 1.1, 322.15),
            ("fit", 0.28, 24.7, 2.6, 3.4, 310.15), ("fit", 0.44, 10.7, 3.3, 0.8, 333.15),
            ("fit", 0.32, 20.4, 2.1, 1.9, 301.15), ("holdout", 0.36, 13.4, 3.5, 1.7, 327.15),
        ), 2e-4, 3.0, {"supply_voltage": 24.0},
    ),
    Bench(
        "ten short runs of the pump", PumpBench, PUMP_EFFECTS, PUMP_UNCERTAIN,
        {"voltage": VOLTAGE, "current": CURRENT, "piston_position": POSITION, "outlet_pressure": PRESSURE,
         "outlet_flow": FLOW},
        planned_runs(
            {"frequency": 1.0, "amplitude": 1e-3, "load_orifice_area": 1e-6},
            ("fit", 0.26, 9.3, 3.6, 1.4), ("fit", 0.22, 14.4, 3.8, 4.4), ("fit", 0.20, 19.3, 3.4, 2.9),
            ("fit", 0.20, 26.4, 2.2, 1.2), ("fit", 0.20, 33.4, 2.6, 3.1), ("fit", 0.22, 17.3, 1.7, 0.7),
            ("fit", 0.24, 12.1, 2.8, 2.0), ("fit", 0.20, 29.3, 3.1, 4.9), ("holdout", 0.22, 21.9, 3.0, 1.8),
            ("holdout", 0.24, 10.3, 3.2, 3.7),
        ), 1.6e-4, 3.0,
    ),
    Bench(
        "actuator with a speed sensor", ActuatorBench, (LugreFriction,), ACTUATOR_UNCERTAIN,
        {"voltage": VOLTAGE, "current": CURRENT, "piston_position": POSITION, "piston_velocity": SPEED},
        planned_runs(
            {"frequency": 1.0, "amplitude": 1e-3},
            ("fit", 0.50, 6.7, 3.9), ("fit", 0.36, 14.2, 3.1), ("fit", 0.28, 22.3, 2.6), ("fit", 0.40, 9.7, 1.6),
            ("fit", 0.24, 31.4, 2.3), ("fit", 0.24, 39.3, 1.2), ("holdout", 0.32, 17.7, 3.4),
            ("holdout", 0.30, 26.2, 1.9),
        ), 2e-4, 1.2,
    ),
    Bench(
        "four moves of the cylinder with both pressures", ActuatorSystem, (*PUMP_EFFECTS, KarnoppFriction),
        SYSTEM_UNCERTAIN,
        {"current": CURRENT, "piston_position": POSITION, "head_pressure": PRESSURE, "rod_pressure": PRESSURE,
         "cylinder_position": POSITION},
        planned_runs(
            {"target.step_size": 1e-3, "frequency": 1.0, "ramp_time": 1.0, "load_force": 1.0},
            ("fit", 0.55, 11.0, 17.3, 0.11, 35.0), ("fit", 0.55, 6.4, 13.6, 0.11, 120.0),
            ("fit", 0.55, 8.7, 19.6, 0.11, 70.0), ("holdout", 0.55, 7.6, 15.4, 0.11, 95.0),
        ), 2e-4, 1.0,
    ),
)  # fmt: skip
