"""Benches, for the earlier judging set."""

from edhas_jax.machine.effects import EntrainedAir, KarnoppFriction, LugreFriction, PistonLeakage
from edhas_jax.machine.rigs import ActuatorBench, ActuatorSystem, PumpBench
from edhas_jax.measurements.campaign import Channel
from studies.hidden_effects.generators.benches import Bench, planned_runs

ACTUATOR_UNCERTAIN = {
    "coil_resistance": 0.03, "force_constant": 0.015, "coil_inductance": 0.05, "mover_damping": 0.3,
    "coulomb_friction": 0.2, "static_friction": 0.2,
}  # fmt: skip
PUMP_UNCERTAIN = ACTUATOR_UNCERTAIN | {
    "oil_viscosity": 0.2, "air_fraction": 0.3, "valve_spring_rate": 0.08, "valve_damping": 0.2,
    "piston_clearance": 0.08, "load_orifice_area": 0.02, "pump_damping": 0.25,
}  # fmt: skip
SYSTEM_UNCERTAIN = ACTUATOR_UNCERTAIN | {
    "oil_viscosity": 0.2, "air_fraction": 0.3, "piston_clearance": 0.08, "pump_damping": 0.25,
    "cylinder_sliding_friction": 0.3, "cylinder_breakaway_friction": 0.2, "cylinder_damping": 0.25,
    "reversing_valve_area": 0.04, "reversing_valve_time": 0.1,
}  # fmt: skip
ACTUATOR_CHANNELS = {
    "voltage": Channel("V", 0.03), "current": Channel("A", 0.015), "piston_position": Channel("mm", 4e-6),
}  # fmt: skip
PUMP_CHANNELS = ACTUATOR_CHANNELS | {"outlet_pressure": Channel("MPa", 2e3), "outlet_flow": Channel("L/min", 3e-7)}
SYSTEM_CHANNELS = ACTUATOR_CHANNELS | {
    "head_pressure": Channel("MPa", 1.5e3), "rod_pressure": Channel("MPa", 1.5e3),
    "cylinder_position": Channel("mm", 4e-6),
}  # fmt: skip
PUMP_EFFECTS = (LugreFriction, PistonLeakage, EntrainedAir)

BENCHES = (
    Bench(
        "seven runs of the pump", PumpBench, PUMP_EFFECTS, PUMP_UNCERTAIN, PUMP_CHANNELS,
        planned_runs(
            {"frequency": 1.0, "amplitude": 1e-3, "load_orifice_area": 1e-6},
            ("fit", 0.60, 6.0, 3.8, 3.6), ("fit", 0.36, 12.0, 3.2, 3.6), ("fit", 0.24, 24.0, 3.2, 3.0),
            ("fit", 0.36, 12.0, 3.6, 0.9), ("fit", 0.26, 18.0, 2.6, 1.4), ("holdout", 0.44, 8.0, 3.0, 1.6),
            ("holdout", 0.24, 27.0, 2.8, 2.4),
        ), 2e-4, 5.0,
    ),
    Bench(
        "six runs of the pump at several oil temperatures", PumpBench, PUMP_EFFECTS, PUMP_UNCERTAIN,
        {name: channel for name, channel in PUMP_CHANNELS.items() if name != "voltage"},
        planned_runs(
            {"frequency": 1.0, "amplitude": 1e-3, "load_orifice_area": 1e-6, "oil_temperature": 1.0},
            ("fit", 0.56, 8.0, 3.0, 2.4, 303.15), ("fit", 0.34, 16.0, 3.8, 3.2, 313.15),
            ("fit", 0.28, 26.0, 2.6, 1.8, 323.15), ("fit", 0.40, 11.0, 3.9, 0.8, 323.15),
            ("fit", 0.30, 20.0, 2.2, 0.8, 303.15), ("holdout", 0.36, 13.0, 3.4, 1.2, 308.15),
        ), 1.6e-4, 3.0, {"supply_voltage": 15.5},
    ),
    Bench(
        "five runs of the actuator", ActuatorBench, (LugreFriction,), ACTUATOR_UNCERTAIN, ACTUATOR_CHANNELS,
        planned_runs(
            {"frequency": 1.0, "amplitude": 1e-3},
            ("fit", 0.50, 6.0, 3.8), ("fit", 0.36, 15.0, 2.4), ("fit", 0.26, 28.0, 3.0), ("fit", 0.44, 9.0, 4.2),
            ("holdout", 0.30, 21.0, 3.4),
        ), 1.6e-4, 1.0,
    ),
    Bench(
        "four moves of the cylinder", ActuatorSystem, (*PUMP_EFFECTS, KarnoppFriction), SYSTEM_UNCERTAIN,
        SYSTEM_CHANNELS,
        planned_runs(
            {"target.step_size": 1e-3, "frequency": 1.0, "ramp_time": 1.0, "load_force": 1.0},
            ("fit", 0.6, 10.0, 13.0, 0.12, 60.0), ("fit", 0.6, 14.0, 18.0, 0.12, 10.0),
            ("fit", 0.6, 6.0, 10.0, 0.12, 130.0), ("holdout", 0.6, 7.0, 17.0, 0.12, 100.0),
        ), 2e-4, 1.0,
    ),
)  # fmt: skip
