"""Benches, for judging."""

from edhas_jax.machine.effects import EntrainedAir, LugreFriction, PistonLeakage
from edhas_jax.machine.rigs import PumpBench
from edhas_jax.measurements.campaign import Channel, Use
from edhas_jax.measurements.synthetic_campaign import PlannedRun
from studies.hidden_effects.generators.benches import Bench

PUMP_UNCERTAIN = {
    "coil_resistance": 0.03, "force_constant": 0.015, "mover_damping": 0.3, "coulomb_friction": 0.2,
    "static_friction": 0.2, "oil_viscosity": 0.2, "air_fraction": 0.3, "valve_spring_rate": 0.08,
    "valve_damping": 0.2, "piston_clearance": 0.08, "load_orifice_area": 0.02, "pump_damping": 0.25,
}  # fmt: skip
PUMP_CHANNELS = {
    "voltage": Channel("V", 0.03), "current": Channel("A", 0.015), "piston_position": Channel("mm", 4e-6),
    "outlet_pressure": Channel("MPa", 2e3), "outlet_flow": Channel("L/min", 3e-7),
}  # fmt: skip


def _pump_runs(*rows) -> tuple[PlannedRun, ...]:
    """Runs from rows of use, duration [s], frequency [Hz], amplitude [mm], load orifice [mm²]."""
    return tuple(
        PlannedRun(use, seconds, {"frequency": f, "amplitude": 1e-3 * mm, "load_orifice_area": 1e-6 * area})
        for use, seconds, f, mm, area in rows
    )


SEVEN_RUNS = Bench(
    "seven runs of the pump", PumpBench, (LugreFriction, PistonLeakage, EntrainedAir), PUMP_UNCERTAIN, PUMP_CHANNELS,
    _pump_runs(
        (Use.FIT, 0.60, 6.0, 3.8, 3.6), (Use.FIT, 0.36, 12.0, 3.2, 3.6), (Use.FIT, 0.24, 24.0, 3.2, 3.0),
        (Use.FIT, 0.36, 12.0, 3.6, 0.9), (Use.FIT, 0.26, 18.0, 2.6, 1.4), (Use.HOLDOUT, 0.44, 8.0, 3.0, 1.6),
        (Use.HOLDOUT, 0.24, 27.0, 2.8, 2.4),
    ), 2e-4,
)  # fmt: skip
BENCHES = (SEVEN_RUNS,)
