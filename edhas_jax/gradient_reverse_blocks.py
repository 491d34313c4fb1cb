"""Reverse mode under XLA, for machines and devices that have no machine code of this package."""

import contextlib
import os
import re
from collections.abc import Mapping, Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.cycle import advance, begin, cycle_step, empty_sums, measured, verdict
from edhas_jax.gradient_plan import Derivatives, GradientSettings, filled
from edhas_jax.parameters import set_parameters
from edhas_jax.system import Rig

LANES = 60  # designs in a block


def reverse_blocks(
    machine: Rig,
    columns: Mapping[str, np.ndarray],
    names: Sequence[str],
    metrics: Sequence[str],
    settings: GradientSettings,
    cycles: int | None = None,
) -> Derivatives:
    """As `reverse`: after so many `cycles`, or as many as the metrics take to settle.

    Kept are the states at the start of every cycle; on the way back each cycle is run again and keeps the states of
    its steps. So the memory does not grow with the number of cycles: 19 states × steps per cycle × LANES, 160 MB.
    """
    columns = {n: np.asarray(column, float) for n, column in columns.items()}
    count = len(next(iter(columns.values())))
    base = jax.tree.map(lambda leaf: np.asarray(leaf, float), machine)
    values = {n: np.full(count, np.nan) for n in metrics}
    slopes = {n: np.full((count, len(names)), np.nan) for n in metrics}
    status = np.zeros(count)
    for rows, block in filled(columns, LANES):
        starts, state = [], _begin(base, block)
        done = np.zeros(LANES, bool)
        while len(starts) < (cycles or settings.max_cycles):
            if cycles is None and len(starts) > settings.min_cycles and done.all():
                break
            starts.append(state.y)
            state = _cycle(base, block, state, len(starts) - 1, settings.steps_per_cycle)
            done = np.asarray(state.kept["residual"]) <= settings.tolerance
        status[rows] = np.asarray(_verdict(base, block, state.kept, done)["status"])[: len(rows)]
        pulled, moved = None, {n: np.zeros((len(metrics), LANES)) for n in columns}
        for number in reversed(range(len(starts))):
            last = number == len(starts) - 1
            with _flags_for_reverse():
                found, share, pulled = _pull(
                    base, block, starts[number], tuple(metrics), pulled, last, number == 0, settings.steps_per_cycle
                )
            moved = {n: moved[n] + share[n] for n in moved}
            if last:
                values |= {n: _put(values[n], rows, found[n]) for n in metrics}
        with _flags_for_reverse():
            share = pull_begin(base, block, pulled)
        for k, metric in enumerate(metrics):
            for j, n in enumerate(names):
                slopes[metric][rows, j] = np.asarray(moved[n] + share[n])[k, : len(rows)]
    return Derivatives(values, slopes, status, len(starts))


def _put(column, rows, block):
    column[rows] = np.asarray(block)[: len(rows)]
    return column


@contextlib.contextmanager
def _flags_for_reverse():
    """The compiler flags under which a loop that keeps its states is fast.

    What makes the plain loop fast, a loop compiled as one function, copies the kept states in every step. The flags are
    read anew at each compilation because `--xla_flags_reset` is set when JAX starts.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    os.environ["XLA_FLAGS"] = re.sub(r"(while_loop_byte_threshold=)\d+", r"\g<1>1024", flags)
    try:
        yield
    finally:
        os.environ["XLA_FLAGS"] = flags


@jax.jit
def _begin(machine, block):
    return begin(machine, block, jnp.ones(LANES, bool), jnp.float64)


@jax.jit
def _cycle(machine, block, lanes, number, steps):
    return advance(machine, block, lanes, number, number + 1, steps, -1.0, True)


_verdict = jax.jit(verdict)


@partial(jax.jit, static_argnames=("metrics", "last", "steps"))
def _pull(machine, block, y, metrics, pulled, last: bool, first, steps: int):
    """Back through one cycle: metrics, and the derivatives of each by the parameters and by the states at its start.

    In the `last` cycle each metric starts a row of its own; before it, `pulled` holds the derivatives by the states at
    its end, (metrics, lanes) each. The number of steps is static: a loop can only be reversed if its length is known.
    """

    def lane(values, y, pulled):
        (y_end, found), back = jax.vjp(lambda v, y: _march(machine, v, y, metrics, first, steps), values, y)

        def row(k, pulled):
            cotangents = {n: jnp.where(k == i, 1.0, 0.0) if last else 0.0 * found[n] for i, n in enumerate(metrics)}
            return back((jax.tree.map(jnp.zeros_like, y_end) if last else pulled, cotangents))

        by_values, by_y = jax.vmap(row)(jnp.arange(len(metrics)), pulled)
        return found, by_values, by_y

    if last:
        pulled = jax.tree.map(lambda leaf: jnp.zeros((len(metrics), LANES)), y)
    return jax.vmap(lane, in_axes=(0, 0, 1), out_axes=(0, 1, 1))(block, y, pulled)


@jax.jit
def pull_begin(machine, block, pulled):
    """Back through the start from rest."""

    def lane(values, pulled):
        def start(v):
            m = set_parameters(machine, v)
            return {n: jnp.asarray(x, jnp.float64) for n, x in m.start().items()}

        return jax.vmap(lambda row: jax.vjp(start, values)[1](row)[0])(pulled)

    return jax.vmap(lane, in_axes=(0, 1), out_axes=1)(block, pulled)


def _march(machine, values, y, metrics, first, steps: int):
    """One cycle of one design as a loop that can be reversed: each step keeps its start and is taken again."""
    m = set_parameters(machine, values)

    @jax.checkpoint
    def one(carry, n):
        return cycle_step(m, *carry, n, steps, first), None

    (y, sums), _ = jax.lax.scan(one, (y, empty_sums(m, jnp.float64)), jnp.arange(steps, dtype=jnp.float64))
    found = measured(m, sums, 1.0 / steps)
    return y, {n: found[n] for n in metrics}
