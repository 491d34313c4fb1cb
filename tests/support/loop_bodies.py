"""The loop bodies of the package's own tasks, as they are handed to an engine."""

import functools
from typing import Any, NamedTuple

import jax
import numpy as np

import edhas_jax as edhas
from edhas_jax.compiler.backward_body import backward_body
from edhas_jax.compiler.loop_engine import LoopBody
from edhas_jax.design.batch.cycle_metrics import empty_sums
from edhas_jax.design.batch.periodic_solver import CycleLoop
from edhas_jax.design.gradient.forward import TangentLoop
from edhas_jax.design.gradient.reverse import CycleAdjoint
from edhas_jax.machine.effects import EntrainedAir, LugreFriction, PistonLeakage
from edhas_jax.machine.parameters import get_parameter
from edhas_jax.simulation.batch_trajectories import NamedSignals, TrajectoryLoop

VARIED = ("piston_diameter", "piston_clearance", "valve_spring_rate", "valve_mass", "valve_seat_diameter",
          "valve_preload", "frequency", "amplitude")  # fmt: skip
STEPS = 2048.0  # of a cycle
NAMES = ("pump", "system", "forward, 1 direction", "forward, 8 directions", "reverse")


def pump() -> edhas.PumpBench:
    return edhas.PumpBench(effects=(LugreFriction(), PistonLeakage(), EntrainedAir()))


@functools.cache
def body_of(name: str, dtype: str) -> LoopBody:
    """The body of one of `NAMES`, that of "reverse" goes backwards; derivatives are always in float64."""
    kind = np.dtype(dtype)
    machine = jax.tree.map(lambda leaf: np.ones(np.shape(leaf), kind), pump())
    if name == "pump":
        return CycleLoop(machine, VARIED, kind)._few.body
    if name == "system":
        system = jax.tree.map(lambda leaf: np.ones(np.shape(leaf), kind), edhas.ActuatorSystem())
        signals = NamedSignals(("piston_position",))
        return TrajectoryLoop(system, ("piston_diameter",), signals, False, kind)._advance.body
    if name.startswith("forward"):
        return TangentLoop(machine, VARIED, VARIED if "8" in name else None)._loop.body
    return backward_body(CycleAdjoint(machine, VARIED)._loop._ahead.body)


class Lanes(NamedTuple):
    """Arguments of a loop: the start, what differs from lane to lane, and what is the same."""

    carry: Any
    lane: Any
    uniform: Any


def pump_lanes(count: int, dtype: str) -> Lanes:
    """Pump benches at rest whose eight parameters differ by up to 10 %, for the body "pump"."""
    machine, rng, kind = pump(), np.random.default_rng(0), np.dtype(dtype)
    values = {n: float(get_parameter(machine, n)) * rng.uniform(0.9, 1.1, count) for n in VARIED}
    sums = {n: np.full(count, v) for n, v in empty_sums(machine, kind).items()}
    state = {n: np.full(count, float(v)) for n, v in machine.initial_state().items()}
    return Lanes((state, sums), values, (machine, STEPS, 1.0))
