"""Benches, for tuning."""

from edhas_jax.machine.effects import EntrainedAir, KarnoppFriction, LugreFriction, PistonLeakage
from edhas_jax.machine.rigs import ActuatorBench, ActuatorSystem, PumpBench
from edhas_jax.measurements.campaign import Channel
from studies.hidden_effects.generators.benches import Bench, planned_runs

ACTUATOR_UNCERTAIN = {
    "coil_resistance": 0.02, "force_constant": 0.02, "mover_damping": 0.25, "coulomb_friction": 0.25,
    "static_friction": 0.25,
}  # fmt: skip
PUMP_UNCERTAIN = ACTUATOR_UNCERTAIN | {
    "oil_viscosity": 0.15, "air_fraction": 0.4, "valve_spring_rate": 0.05, "valve_damping": 0.15,
    "piston_clearance": 0.1, "load_orifice_area": 0.03, "pump_damping": 0.3,
}  # fmt: skip
SYSTEM_UNCERTAIN = ACTUATOR_UNCERTAIN | {
    "oil_viscosity": 0.15, "air_fraction": 0.4, "piston_clearance": 0.1, "pump_damping": 0.3,
    "cylinder_sliding_friction": 0.25, "cylinder_breakaway_friction": 0.25, "cylinder_damping": 0.2,
    "reversing_valve_area": 0.05,
}  # fmt: skip
ACTUATOR_CHANNELS = {
    "voltage": Channel("V", 0.02), "current": Channel("A", 0.02), "piston_position": Channel("mm", 5e-6),
}  # fmt: skip
PUMP_CHANNELS = ACTUATOR_CHANNELS | {"outlet_pressure": Channel("MPa", 1.5e3), "outlet_flow": Channel("L/min", 2e-7)}
SYSTEM_CHANNELS = {
    "current": Channel("A", 0.02), "piston_position": Channel("mm", 5e-6), "outlet_pressure": Channel("MPa", 2e3),
    "head_pressure": Channel("MPa", 2e3), "cylinder_position": Channel("mm", 5e-6),
}  # fmt: skip
PUMP_EFFECTS = (LugreFriction, PistonLeakage, EntrainedAir)

BENCHES = (
    Bench(
        "eight runs of the pump", PumpBench, PUMP_EFFECTS, PUMP_UNCERTAIN, PUMP_CHANNELS,
        planned_runs(
            {"frequency": 1.0, "amplitude": 1e-3, "load_orifice_area": 1e-6},
            ("fit", 0.72, 5.0, 3.5, 4.2), ("fit", 0.42, 10.0, 3.5, 4.2), ("fit", 0.27, 20.0, 3.5, 4.2),
            ("fit", 0.22, 30.0, 3.5, 4.2), ("fit", 0.42, 10.0, 3.5, 1.2), ("fit", 0.27, 20.0, 3.0, 1.0),
            ("holdout", 0.32, 15.0, 3.5, 2.0), ("holdout", 0.24, 25.0, 3.0, 1.5),
        ), 2e-4, 5.0,
    ),
    Bench(
        "five runs of the pump at three oil temperatures", PumpBench, PUMP_EFFECTS, PUMP_UNCERTAIN,
        {name: channel for name, channel in PUMP_CHANNELS.items() if name != "outlet_flow"},
        planned_runs(
            {"frequency": 1.0, "amplitude": 1e-3, "load_orifice_area": 1e-6, "oil_temperature": 1.0},
            ("fit", 0.60, 7.0, 4.0, 3.0, 313.15), ("fit", 0.40, 14.0, 2.5, 2.0, 298.15),
            ("fit", 0.34, 22.0, 3.2, 0.9, 328.15), ("fit", 0.50, 9.0, 3.4, 0.7, 298.15),
            ("holdout", 0.36, 17.0, 3.0, 1.4, 320.15),
        ), 2.5e-4, 3.0, {"supply_voltage": 20.0},
    ),
    Bench(
        "six runs of the actuator", ActuatorBench, (LugreFriction,), ACTUATOR_UNCERTAIN, ACTUATOR_CHANNELS,
        planned_runs(
            {"frequency": 1.0, "amplitude": 1e-3},
            ("fit", 0.60, 5.0, 3.5), ("fit", 0.40, 12.0, 3.5), ("fit", 0.30, 25.0, 3.5), ("fit", 0.40, 10.0, 1.2),
            ("fit", 0.25, 35.0, 2.0), ("holdout", 0.32, 18.0, 3.0),
        ), 2e-4, 1.0,
    ),
    Bench(
        "four steps of the cylinder", ActuatorSystem, (*PUMP_EFFECTS, KarnoppFriction), SYSTEM_UNCERTAIN,
        SYSTEM_CHANNELS,
        planned_runs(
            {"target.step_size": 1e-3, "frequency": 1.0, "ramp_time": 1.0, "load_force": 1.0},
            ("fit", 0.6, 12.0, 16.0, 0.1, 20.0), ("fit", 0.6, 8.0, 12.0, 0.1, 90.0),
            ("fit", 0.6, 5.0, 20.0, 0.1, 150.0), ("holdout", 0.6, 9.0, 14.0, 0.1, 50.0),
        ), 2e-4, 1.0,
    ),
)  # fmt: skip
