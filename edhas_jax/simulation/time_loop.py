"""The time loop of a single run: step by step with energy balance and range checks, sample by sample."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.compiler.engines import compile_loop
from edhas_jax.compiler.loop_engine import LoopBody
from edhas_jax.core import runtime
from edhas_jax.machine.rigs import Rig, State
from edhas_jax.simulation import energy_balance
from edhas_jax.simulation.integrator import evaluate_signals, signal_names, step_with_outputs
from edhas_jax.simulation.loop_cache import cached_loop, key_of


class LoopState(NamedTuple):
    """State of the time loop between two calls.

    Attributes:
        y: state of the machine by name, SI.
        balance: energies and volumes since the start of the run.
        step_number: number of steps taken.
        failed_step: number of the first step that left the physical range, -1 if none did.
        failed_check: index in `check_names` of the check that failed then, -1 if none did.
    """

    y: State
    balance: energy_balance.Balance
    step_number: Any
    failed_step: Any
    failed_check: Any


class SampleBlock(NamedTuple):
    """The samples of one call of `integrate`; every array has the samples as its first axis.

    Attributes:
        signals: by name, SI.
        balance: energies [J] and volumes [m³] since the start of the run.
    """

    signals: dict[str, Any]
    balance: energy_balance.Balance


def check_names(machine: Rig) -> tuple[str, ...]:
    """The names of the checks in `failed_checks`: every state, then every signal with a valid range."""
    y = machine.initial_state()
    return (*sorted(y), *machine.evaluate(y, 0.0, 1.0, y)[0].record.valid_ranges)


def failed_checks(machine: Rig, y: State, t, h) -> list:
    """Whether each check fails, in the order of `check_names`: a state is not finite, a signal outside its range."""
    s, _ = machine.evaluate(y, t, h, y)
    values = s.values()
    not_finite = [~jnp.isfinite(y[n]) for n in sorted(y)]
    ranges = s.record.valid_ranges.items()
    return not_finite + [~((values[n] >= low) & (values[n] <= high)) for n, (low, high) in ranges]


def _first_failed_check(machine: Rig, y: State, t, h):
    """The index of the first check that fails, or −1."""
    index = jnp.full_like(t, -1.0)
    for k, failed in reversed(list(enumerate(failed_checks(machine, y, t, h)))):
        index = jnp.where(failed, float(k), index)
    return index


def initial_loop_state(machine: Rig, h) -> LoopState:
    """The loop state before the first step: the machine at rest, in the precision of `h`."""
    dtype = np.dtype(type(h))
    y = {n: np.asarray(v, dtype) for n, v in machine.initial_state().items()}
    rows = runtime.eval_shape(lambda m: energy_balance.zero_balance(m, m.initial_state(), h), machine)
    return LoopState(y, jax.tree.map(lambda _: np.zeros((), dtype), rows), 0, -1, -1)


def integrate(machine: Rig, begin: LoopState, h, per_sample: int, samples: int) -> tuple[LoopState, SampleBlock]:
    """Integrate over `samples` samples; the first is taken at `begin`, before its steps.

    Another rig or another list of effects compiles anew; no value does, not even the step or `per_sample`.

    Args:
        machine: the machine, its numbers in the precision of `h`.
        begin: where the loop continues.
        h: step [s].
        per_sample: number of steps after each sample.
        samples: number of samples.

    Returns:
        The loop state after the last step, and the samples.
    """
    dtype = np.dtype(type(h))
    loop = cached_loop(TimeLoop, machine, dtype, dtype=dtype)
    return loop.run(machine, begin, h, per_sample, samples)


class TimeLoop:
    """The compiled loop of `integrate`; `machine` counts only by its structure."""

    def __init__(self, machine: Rig, dtype):
        def advance(n, carry, lane, uniform):
            (y, balance, failed_step, failed_check), (base, h) = carry, uniform
            t = n * h
            after, _, at_midstep = step_with_outputs(base, y, t, h, energy_balance.midpoint_quantities)
            balance = energy_balance.add_step(base, balance, y, after, at_midstep, t, h)
            check = _first_failed_check(base, after, t + h, h)
            is_first = (check >= 0.0) & (failed_step < 0.0)
            return (
                after, balance, jnp.where(is_first, n + 1.0, failed_step), jnp.where(is_first, check, failed_check)
            )  # fmt: skip

        def evaluate(n, carry, lane, uniform):
            (y, t), (base, h) = lane, uniform
            return {n: jnp.asarray(v, dtype) for n, v in evaluate_signals(base, y, t, h).items()}

        start = initial_loop_state(machine, dtype.type(1.0))
        names = signal_names(machine)
        self._dtype, self._signals, given = dtype, dict.fromkeys(names, 0.0), (machine, 0.0)
        carry, lane = (start.y, start.balance, 0.0, 0.0), (start.y, 0.0)
        self._advance = compile_loop(
            LoopBody(advance, dtype, carry, {}, given, key=key_of(machine, "time loop"), single_lane=True)
        )
        self._evaluate = compile_loop(
            LoopBody(evaluate, dtype, self._signals, lane, given, key=key_of(machine, "signals of a run"), vectors=1)
        )

    def run(self, machine: Rig, begin: LoopState, h, per_sample: int, samples: int) -> tuple[LoopState, SampleBlock]:
        """See `integrate`."""
        first, uniform = begin.step_number, (machine, h)
        carry = begin.y, begin.balance, begin.failed_step, begin.failed_check
        carry = jax.tree.map(lambda leaf: np.full(1, leaf, self._dtype), carry)
        end, kept = self._advance.run(carry, {}, uniform, first, per_sample, samples)
        y, balance, failed_step, failed_check = jax.tree.map(lambda leaf: leaf[0], end)
        states, balances = jax.tree.map(lambda leaf: leaf[:, 0], kept[:2])
        time = ((first + per_sample * np.arange(samples)).astype(self._dtype)) * h
        empty = {n: np.zeros(samples, self._dtype) for n in self._signals}
        signals = self._evaluate(empty, (states, time), uniform, 0, 1, runtime.cores())
        state = LoopState(y, balance, first + per_sample * samples, int(failed_step), int(failed_check))
        return state, SampleBlock(signals, balances)
