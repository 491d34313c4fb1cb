"""Benches whose test plans, sensors and sheets are drawn at random, once and for all."""

import dataclasses

import numpy as np

from edhas_jax.machine.effects import EntrainedAir, KarnoppFriction, LugreFriction, PistonLeakage
from edhas_jax.machine.rigs import ActuatorBench, ActuatorSystem, PumpBench
from edhas_jax.measurements.campaign import Channel, Use
from studies.hidden_effects.generators.benches import Bench
from studies.synthetic_campaign import PlannedRun

SEED = 20261125
PUMPS, ACTUATORS, SYSTEMS = 16, 4, 4  # number of benches
SHARE_OF_SYSTEMS = 0.1  # of the cases: the system takes longest
FASTEST = 0.6  # m/s, peak velocity of the mover that the supply allows
LEAST_SENSORS = 3
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


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _with_noise(rng: np.random.Generator, channels: dict[str, Channel]) -> dict[str, Channel]:
    """The sensors, the noise of each multiplied by a random factor of 0.5 … 3."""
    return {n: dataclasses.replace(c, noise=c.noise * _log_uniform(rng, 0.5, 3.0)) for n, c in channels.items()}


def _sensors(rng: np.random.Generator, channels: dict[str, Channel]) -> dict[str, Channel]:
    """A random selection of the sensors, at least three, with random noise levels."""
    kept = [name for name in channels if rng.uniform() < 0.85]
    kept = kept if len(kept) >= LEAST_SENSORS else list(channels)
    return _with_noise(rng, {name: channels[name] for name in kept})


def _sheet(rng: np.random.Generator, uncertain: dict[str, float]) -> dict[str, float]:
    """The sheet with 0.6 … 1.6 times the usual uncertainty of each parameter."""
    return {name: spread * _log_uniform(rng, 0.6, 1.6) for name, spread in uncertain.items()}


def _cyclic_runs(rng: np.random.Generator, extremes: dict[str, tuple[float, float]]) -> tuple[PlannedRun, ...]:
    """Four to nine runs of two to four cycles; one or two are held out.

    Args:
        rng: the random generator.
        extremes: the range of each condition besides frequency and amplitude, SI.
    """
    count = int(rng.integers(4, 10))
    frequencies = np.exp(rng.permutation(np.linspace(np.log(4.0), np.log(32.0), count)) + rng.uniform(-0.1, 0.1, count))
    runs = []
    for k, frequency in enumerate(map(float, frequencies)):
        amplitude = min(_log_uniform(rng, 1.2e-3, 4.5e-3), FASTEST / (2.0 * np.pi * frequency))
        conditions = {"frequency": frequency, "amplitude": amplitude}
        conditions |= {name: _log_uniform(rng, *limits) for name, limits in extremes.items()}
        use = Use.HOLDOUT if k >= count - (1 if count < 7 else 2) else Use.FIT
        runs.append(PlannedRun(use, float(np.clip(rng.uniform(2.0, 5.0) / frequency, 0.2, 0.7)), conditions))
    return tuple(runs)


def _pump(rng: np.random.Generator, k: int) -> Bench:
    extremes = {"load_orifice_area": (0.6e-6, 6e-6)}
    if rng.uniform() < 0.3:
        extremes |= {"oil_temperature": (295.0, 330.0)}
    known = {"supply_voltage": 20.0} if rng.uniform() < 0.3 else {}
    return Bench(
        f"varied pump {k}", PumpBench, PUMP_EFFECTS, _sheet(rng, PUMP_UNCERTAIN), _sensors(rng, PUMP_CHANNELS),
        _cyclic_runs(rng, extremes), float(rng.choice([1.5e-4, 2e-4, 3e-4])), 0.8 / PUMPS, known,
    )  # fmt: skip


def _actuator(rng: np.random.Generator, k: int) -> Bench:
    return Bench(
        f"varied actuator {k}", ActuatorBench, (LugreFriction,), _sheet(rng, ACTUATOR_UNCERTAIN),
        _with_noise(rng, ACTUATOR_CHANNELS),
        _cyclic_runs(rng, {}), float(rng.choice([1.5e-4, 2e-4, 3e-4])), (0.2 - SHARE_OF_SYSTEMS) / ACTUATORS,
    )  # fmt: skip


def _system(rng: np.random.Generator, k: int) -> Bench:
    runs = []
    for number in range(int(rng.integers(3, 6))):
        conditions = {
            "target.step_size": _log_uniform(rng, 4e-3, 14e-3), "frequency": float(rng.uniform(11.0, 21.0)),
            "ramp_time": float(rng.uniform(0.08, 0.14)), "load_force": float(rng.uniform(10.0, 160.0)),
        }  # fmt: skip
        runs.append(PlannedRun(Use.FIT if number else Use.HOLDOUT, float(rng.uniform(0.45, 0.65)), conditions))
    return Bench(
        f"varied system {k}", ActuatorSystem, (*PUMP_EFFECTS, KarnoppFriction), _sheet(rng, SYSTEM_UNCERTAIN),
        _sensors(rng, SYSTEM_CHANNELS), tuple(runs), 2e-4, SHARE_OF_SYSTEMS / SYSTEMS,
    )  # fmt: skip


def _drawn() -> tuple[Bench, ...]:
    rng = np.random.default_rng(SEED)
    pumps = [_pump(rng, k) for k in range(1, PUMPS + 1)]
    actuators = [_actuator(rng, k) for k in range(1, ACTUATORS + 1)]
    return (*pumps, *actuators, *(_system(rng, k) for k in range(1, SYSTEMS + 1)))


BENCHES = _drawn()
