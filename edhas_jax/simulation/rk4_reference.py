"""A second integrator, explicit and with steps far below any other: for trajectories that no fit's own step has made.

The classical rule of Runge and Kutta, fourth order, on the pressures themselves,

    k₁ = f(t, y), k₂ = f(t + h/2, y + h k₁/2), k₃ = f(t + h/2, y + h k₂/2), k₄ = f(t + h, y + h k₃),
    y(t + h) = y + h (k₁ + 2 k₂ + 2 k₃ + k₄)/6,

has nothing in common with the package's step but the equations f: no linearisation, no slopes of orifices, no strain
pressure. Being explicit, it holds only while h is below some 2.8 of the fastest time constant (a chamber of oil behind
an open valve: about 1 µs), so it is no way to simulate, only to check and to synthesise.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from edhas_jax.compiler.native_loop import Loop
from edhas_jax.core import runtime
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.machine.rigs import Rig, State
from edhas_jax.simulation.integrator import evaluate_signals

STEP = 0.5e-6  # s
HALVINGS = 3
WILD = 50.0  # Pa; steps that hold differ by less than 0.1 Pa from one stage to the next, others soon by 10 kPa


class Unstable(ArithmeticError):
    """No step that is tried can follow the machine."""


def rates(machine: Rig, y: State, t, h) -> State:
    """dy/dt of every state, of a node of oil the rate of its pressure."""
    s, found = machine.evaluate(y, t, h, y)
    return found | s.record.pressure_rates


def runge_kutta_step(machine: Rig, y: State, t, h) -> tuple[State, Any]:
    """The state a step of `h` later, and by how much the two middle stages disagree on any pressure [Pa].

    Where h is too large for the stiffest node, its pressure does not run away, as the laws of orifices bend, but jumps
    to and fro, with plausible looks in all that is measured. The disagreement shows it.
    """

    def along(k: State, share: float) -> State:
        return {n: y[n] + share * h * k[n] for n in y}

    k1 = rates(machine, y, t, h)
    k2 = rates(machine, along(k1, 0.5), t + 0.5 * h, h)
    k3 = rates(machine, along(k2, 0.5), t + 0.5 * h, h)
    k4 = rates(machine, along(k3, 1.0), t + h, h)
    jump = jnp.zeros_like(t)
    for n in machine.evaluate(y, t, h, y)[0].record.pressure_rates:
        jump = jnp.maximum(jump, jnp.abs(h * (k3[n] - k2[n])))
    change = {n: h / 6.0 * (k1[n] + 2.0 * k2[n] + 2.0 * k3[n] + k4[n]) for n in y}
    return machine.sampling.advance(machine, y, change, t, h), jump


def trajectories(
    machine: Rig, values: Mapping[str, np.ndarray], interval: float, samples: int, watch: Sequence[str],
    step: float = STEP,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Signals (samples, lanes) every `interval` [s] from rest; `values` are parameters (lanes,) that differ by lane.

    The step is at most `step`, and is halved where it does not hold.

    Raises:
        Unstable: not even an eighth of the step holds.
        Untranslatable: the machine uses an operation that has no machine code here.
    """
    names, watch = dict.fromkeys(values, 0.0), tuple(watch)
    start = {n: 0.0 for n in machine.initial_state()}

    def go(n, carry, lane, uniform):
        (y, worst), (base, h) = carry, uniform
        y, jump = runge_kutta_step(set_parameters(base, lane), y, n * h, h)
        return y, jnp.maximum(worst, jump)

    def see(n, seen, lane, uniform):
        (values, y, t), (base, h) = lane, uniform
        signals = evaluate_signals(set_parameters(base, values), y, t, h)
        return {s: signals[s] for s in watch}

    numbers = {n: np.asarray(v, float) for n, v in values.items()}
    lanes = len(next(iter(numbers.values())))
    cache = runtime.cache_folder()
    march = Loop(go, float, (start, 0.0), names, (machine, 0.0), cache)
    look = Loop(see, float, dict.fromkeys(watch, 0.0), (names, start, 0.0), (machine, 0.0), cache)
    rest = {n: np.full(lanes, float(v)) for n, v in machine.initial_state().items()}, np.zeros(lanes)
    time = np.repeat(interval * np.arange(samples), lanes)
    wide = {n: np.tile(v, samples) for n, v in numbers.items()}
    for halving in range(HALVINGS + 1):
        per_sample = math.ceil(interval / step * 2**halving - 1e-9)
        uniform = (machine, interval / per_sample)
        (_, worst), (states, _) = march.march(rest, numbers, uniform, 0, per_sample, samples, runtime.cores())
        if not np.all(worst < WILD):  # NaN is not below either
            continue
        flat = {n: np.ravel(v) for n, v in states.items()}
        seen = look({s: np.zeros(len(time)) for s in watch}, (wide, flat, time), uniform, 0, 1)
        if all(np.isfinite(column).all() for column in seen.values()):
            return {s: column.reshape(samples, lanes) for s, column in seen.items()}
    raise Unstable(f"the machine cannot be followed with explicit steps down to {step / 2**HALVINGS:.3g} s")
