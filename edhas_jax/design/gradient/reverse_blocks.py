"""Reverse mode under XLA, for machines and devices that have no machine code of this package."""

import contextlib
import os
import re
from collections.abc import Mapping, Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.design.batch.cycle import Lanes, cycle_step, empty_sums, measured
from edhas_jax.design.gradient.fixed_point import Derivatives, GradientSettings, filled, settled, status
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.machine.rigs import Rig

LANES = 60  # designs in a block


def reverse_blocks(
    machine: Rig,
    columns: Mapping[str, np.ndarray],
    lanes: Lanes,
    names: Sequence[str],
    metrics: Sequence[str],
    settings: GradientSettings,
    terms: int | None = None,
) -> Derivatives:
    """As `reverse`, from the periodic state in `lanes`.

    On the way back the cycle is run again and keeps the states of its steps: 19 states × steps × LANES, 160 MB.
    """
    count = len(lanes.cycles)
    values = {n: np.full(count, np.nan) for n in metrics}
    slopes = {n: np.full((count, len(names)), np.nan) for n in metrics}
    still, most = np.ones(count, bool), 0
    for rows, block in filled(columns, LANES):
        y = {n: np.resize(v[rows], LANES) for n, v in lanes.y.items()}
        scales = np.abs(np.stack([block[n] for n in names]))
        pulled, total, number = None, {m: np.zeros(scales.shape) for m in metrics}, 0
        for number in range(terms or settings.max_cycles):
            with _flags_for_reverse():
                found, share, pulled = _pull(
                    machine, block, y, tuple(metrics), pulled, number == 0, settings.steps_per_cycle
                )
            shares = {m: np.stack([np.asarray(share[n])[k] for n in names]) for k, m in enumerate(metrics)}
            total = {m: total[m] + shares[m] for m in metrics}
            found = {m: np.asarray(found[m]) for m in metrics}
            done = settled(found, total, shares, scales, settings.tolerance)
            if terms is None and number and done.all():
                break
        most = max(most, number + 1)
        for m in metrics:
            values[m][rows] = found[m][: len(rows)]
            slopes[m][rows] = total[m][:, : len(rows)].T
        still[rows] = done.all(axis=0)[: len(rows)]
    return Derivatives(values, slopes, status(machine, columns, lanes, settings, still), lanes.cycles, most)


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


@partial(jax.jit, static_argnames=("metrics", "last", "steps"))
def _pull(machine, block, y, metrics, pulled, last: bool, steps: int):
    """Back through the cycle: metrics, and the derivatives of each by the parameters and by the states at its start.

    The `last` time it is gone through each metric starts a row of its own; before that, `pulled` holds the derivatives
    by the states at its end, (metrics, lanes) each. The number of steps is static: a loop can only be reversed if its
    length is known.
    """

    def lane(values, y, pulled):
        (y_end, found), back = jax.vjp(lambda v, y: _march(machine, v, y, metrics, steps), values, y)

        def row(k, pulled):
            cotangents = {n: jnp.where(k == i, 1.0, 0.0) if last else 0.0 * found[n] for i, n in enumerate(metrics)}
            return back((jax.tree.map(jnp.zeros_like, y_end) if last else pulled, cotangents))

        by_values, by_y = jax.vmap(row)(jnp.arange(len(metrics)), pulled)
        return found, by_values, by_y

    if last:
        pulled = jax.tree.map(lambda leaf: jnp.zeros((len(metrics), LANES)), y)
    return jax.vmap(lane, in_axes=(0, 0, 1), out_axes=(0, 1, 1))(block, y, pulled)


def _march(machine, values, y, metrics, steps: int):
    """One cycle of one design as a loop that can be reversed: each step keeps its start and is taken again."""
    m = set_parameters(machine, values)

    @jax.checkpoint
    def one(carry, n):
        return cycle_step(m, *carry, n, steps, False), None

    (y, sums), _ = jax.lax.scan(one, (y, empty_sums(m, jnp.float64)), jnp.arange(steps, dtype=jnp.float64))
    found = measured(m, sums, 1.0 / steps)
    return y, {n: found[n] for n in metrics}
