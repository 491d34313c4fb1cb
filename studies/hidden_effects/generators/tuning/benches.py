"""Benches, for tuning."""

from edhas_jax.machine.effects import EntrainedAir, LugreFriction, PistonLeakage
from edhas_jax.machine.rigs import PumpBench
from edhas_jax.measurements.campaign import Channel, Use
from edhas_jax.measurements.synthetic_campaign import PlannedRun
from studies.hidden_effects.generators.benches import Bench

PUMP_UNCERTAIN = {
    "coil_resistance": 0.02, "force_constant": 0.02, "mover_damping": 0.25, "coulomb_friction": 0.25,
    "static_friction": 0.25, "oil_viscosity": 0.15, "air_fraction": 0.4, "valve_spring_rate": 0.05,
    "valve_damping": 0.15, "piston_clearance": 0.1, "load_orifice_area": 0.03, "pump_damping": 0.3,
}  # fmt: skip
PUMP_CHANNELS = {
    "voltage": Channel("V", 0.02), "current": Channel("A", 0.02), "piston_position": Channel("mm", 5e-6),
    "outlet_pressure": Channel("MPa", 1.5e3), "outlet_flow": Channel("L/min", 2e-7),
}  # fmt: skip


def _pump_runs(*rows) -> tuple[PlannedRun, ...]:
    """Runs from rows of use, duration [s], frequency [Hz], amplitude [mm], load orifice [mm²]."""
    return tuple(
        PlannedRun(use, seconds, {"frequency": f, "amplitude": 1e-3 * mm, "load_orifice_area": 1e-6 * area})
        for use, seconds, f, mm, area in rows
    )


EIGHT_RUNS = Bench(
    "eight runs of the pump", PumpBench, (LugreFriction, PistonLeakage, EntrainedAir), PUMP_UNCERTAIN, PUMP_CHANNELS,
    _pump_runs(
        (Use.FIT, 0.72, 5.0, 3.5, 4.2), (Use.FIT, 0.42, 10.0, 3.5, 4.2), (Use.FIT, 0.27, 20.0, 3.5, 4.2),
        (Use.FIT, 0.22, 30.0, 3.5, 4.2), (Use.FIT, 0.42, 10.0, 3.5, 1.2), (Use.FIT, 0.27, 20.0, 3.0, 1.0),
        (Use.HOLDOUT, 0.32, 15.0, 3.5, 2.0), (Use.HOLDOUT, 0.24, 25.0, 3.0, 1.5),
    ), 2e-4,
)  # fmt: skip
BENCHES = (EIGHT_RUNS,)
