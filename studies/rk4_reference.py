"""Independent explicit integrator (classical Runge-Kutta of fourth order) for checks and synthetic data.

The classical rule of Runge and Kutta, fourth order, on the pressures themselves,

    k₁ = f(t, y), k₂ = f(t + h/2, y + h k₁/2), k₃ = f(t + h/2, y + h k₂/2), k₄ = f(t + h, y + h k₃),
    y(t + h) = y + h (k₁ + 2 k₂ + 2 k₃ + k₄)/6,

shares nothing with the package's step but the equations f: no linearisation, no slopes of orifices, no strain pressure.
Being explicit, it is stable only while h is below about 2.8 times the fastest time constant (oil in a chamber behind an
open valve: about 1 µs), so it is too slow for anything but checks and synthetic data.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from edhas_jax.compiler.engines import compile_loop
from edhas_jax.compiler.loop_engine import Loop, LoopBody
from edhas_jax.core import runtime
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.machine.rigs import Rig, State
from edhas_jax.simulation.integrator import evaluate_signals, rates

LARGEST_RK4_STEP = 0.5e-6  # s
MOST_HALVINGS = 3
MOST_DISAGREEMENT = 50.0  # Pa between stages; below 0.1 Pa where the step is stable, soon 10 kPa where it is not
SAMPLES_PER_CHECK = 250  # after which a step that is not stable is given up


class Unstable(ArithmeticError):
    """No step that is tried is stable for this machine."""


def runge_kutta_step(machine: Rig, y: State, t, h) -> tuple[State, Any]:
    """The state a step of `h` [s] later, and the largest disagreement of the two middle stages on a pressure [Pa].

    Where h is too large for the stiffest node, its pressure does not diverge, because orifice flow is sublinear, but
    oscillates, and everything that is measured looks plausible. The disagreement shows it.
    """

    def along(k: State, share: float) -> State:
        return {n: y[n] + share * h * k[n] for n in y}

    k1, nodes = rates(machine, y, t, h)
    k2, _ = rates(machine, along(k1, 0.5), t + 0.5 * h, h)
    k3, _ = rates(machine, along(k2, 0.5), t + 0.5 * h, h)
    k4, _ = rates(machine, along(k3, 1.0), t + h, h)
    disagreement = jnp.zeros_like(t)
    for n in nodes:
        disagreement = jnp.maximum(disagreement, jnp.abs(h * (k3[n] - k2[n])))
    change = {n: h / 6.0 * (k1[n] + 2.0 * k2[n] + 2.0 * k3[n] + k4[n]) for n in y}
    return machine.advance(y, change, t, h), disagreement


def trajectories(
    machine: Rig, values: Mapping[str, np.ndarray], interval: float, samples: int, watch: Sequence[str],
    step: float = LARGEST_RK4_STEP,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Signals of runs from rest, each (samples, runs) in SI by name.

    Args:
        machine: what the runs have in common.
        values: parameters that differ from run to run, by name in SI, each (runs,).
        interval: time between two samples [s].
        samples: number of samples.
        watch: names of the signals.
        step: largest time step [s]; it is halved where it is not stable.

    Raises:
        Unstable: not even an eighth of the step is stable.
    """
    names, watch = dict.fromkeys(values, 0.0), tuple(watch)
    start = {n: 0.0 for n in machine.initial_state()}

    def advance(n, carry, lane, uniform):
        (y, worst), (base, h) = carry, uniform
        y, disagreement = runge_kutta_step(set_parameters(base, lane), y, n * h, h)
        return y, jnp.maximum(worst, disagreement)

    def evaluate(n, signals, lane, uniform):
        (values, y, t), (base, h) = lane, uniform
        found = evaluate_signals(set_parameters(base, values), y, t, h)
        return {s: found[s] for s in watch}

    numbers = {n: np.asarray(v, float) for n, v in values.items()}
    lanes = len(next(iter(numbers.values())))
    # one vector: the few runs of a campaign fill no more
    loop = compile_loop(LoopBody(advance, float, (start, 0.0), names, (machine, 0.0), vectors=1))
    signals = compile_loop(LoopBody(evaluate, float, dict.fromkeys(watch, 0.0), (names, start, 0.0), (machine, 0.0)))
    at_rest = {n: np.full(lanes, float(v)) for n, v in machine.initial_state().items()}, np.zeros(lanes)
    time = np.repeat(interval * np.arange(samples), lanes)
    wide = {n: np.tile(v, samples) for n, v in numbers.items()}
    for halving in range(MOST_HALVINGS + 1):
        per_sample = math.ceil(interval / step * 2**halving - 1e-9)
        uniform = (machine, interval / per_sample)
        states = _states(loop, at_rest, numbers, uniform, per_sample, samples)
        if states is None:
            continue
        flat = {n: np.ravel(v) for n, v in states.items()}
        found = signals({s: np.zeros(len(time)) for s in watch}, (wide, flat, time), uniform, 0, 1)
        if all(np.isfinite(column).all() for column in found.values()):
            return {s: column.reshape(samples, lanes) for s, column in found.items()}
    raise Unstable(f"the machine cannot be followed with explicit steps down to {step / 2**MOST_HALVINGS:.3g} s")


def _states(
    loop: Loop, at_rest: tuple, numbers: dict[str, np.ndarray], uniform: tuple, per_sample: int, samples: int
) -> State | None:
    """The states at the samples, each (samples, runs); None where the step is not stable."""
    carry, parts = at_rest, []
    for done in range(0, samples, SAMPLES_PER_CHECK):
        count = min(SAMPLES_PER_CHECK, samples - done)
        carry, (states, _) = loop.run(carry, numbers, uniform, done * per_sample, per_sample, count, runtime.cores())
        if not np.all(carry[1] < MOST_DISAGREEMENT):  # NaN is not below either
            return None
        parts.append(states)
    return {n: np.concatenate([part[n] for part in parts]) for n in parts[0]}
