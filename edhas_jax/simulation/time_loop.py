"""The time loop of a single run: step by step with energy balance and range checks, sample by sample."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from edhas_jax.machine.rigs import Rig, State
from edhas_jax.simulation import energy_balance
from edhas_jax.simulation.integrator import evaluate_signals, step_with_outputs


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
    failed = jnp.stack(failed_checks(machine, y, t, h))
    return jnp.where(failed.any(), jnp.argmax(failed), -1)


def initial_loop_state(machine: Rig, h) -> LoopState:
    """The loop state before the first step: the machine at rest, in the precision of `h`."""
    dtype = jnp.result_type(h)
    y = {n: jnp.asarray(v, dtype) for n, v in machine.initial_state().items()}
    zero = jnp.zeros((), int)
    return LoopState(y, energy_balance.zero_balance(machine, y, h), zero, zero - 1, zero - 1)


@partial(jax.jit, static_argnames="samples")
def integrate(machine: Rig, begin: LoopState, h, per_sample, samples: int) -> tuple[LoopState, SampleBlock]:
    """Integrate over `samples` samples; the first is taken at `begin`, before its steps.

    Another number of samples, another rig or another list of effects compiles anew; no other value does, not even the
    step or `per_sample`.

    Args:
        machine: the machine.
        begin: where the loop continues.
        h: step [s].
        per_sample: number of steps after each sample.
        samples: number of samples.

    Returns:
        The loop state after the last step, and the samples.
    """
    dtype = jnp.result_type(h)

    def advance(_, loop: LoopState) -> LoopState:
        t = loop.step_number.astype(dtype) * h
        y, _, at_midstep = step_with_outputs(machine, loop.y, t, h, energy_balance.midpoint_quantities)
        balance = energy_balance.add_step(machine, loop.balance, loop.y, y, at_midstep, t, h)
        check = _first_failed_check(machine, y, t + h, h)
        is_first = (check >= 0) & (loop.failed_step < 0)
        return LoopState(
            y, balance, loop.step_number + 1,
            jnp.where(is_first, loop.step_number + 1, loop.failed_step),
            jnp.where(is_first, check, loop.failed_check),
        )  # fmt: skip

    def sample(loop: LoopState, _):
        signals = evaluate_signals(machine, loop.y, loop.step_number.astype(dtype) * h, h)
        return jax.lax.fori_loop(0, per_sample, advance, loop), SampleBlock(signals, loop.balance)

    return jax.lax.scan(sample, begin, length=samples)
