"""Reverse mode: sweeps back through the periodic cycle give the derivatives of a metric by any number of parameters."""

import functools
from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.compiler.native_adjoint import AdjointLoop
from edhas_jax.core import runtime
from edhas_jax.design.batch.cycle import cycle_step, empty_sums, measured
from edhas_jax.design.gradient.fixed_point import Derivatives, GradientSettings, periodic, settled, status
from edhas_jax.design.gradient.reverse_blocks import reverse_blocks
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.native_loop_cache import loop_of

TOGETHER = 256  # designs at a time: what is kept of their way does not grow with the number of designs


def reverse(
    machine: Rig,
    columns: Mapping[str, np.ndarray],
    names: Sequence[str],
    metrics: Sequence[str],
    settings: GradientSettings,
    terms: int | None = None,
) -> Derivatives:
    """As `forward`, in reverse mode, with so many `terms`, or until they no longer count.

    All designs that run together take as many terms as the slowest of them. Kept are some states of the cycle; on the
    way back the states between are computed again.
    """
    columns = {n: np.asarray(column, float) for n, column in columns.items()}
    base = jax.tree.map(lambda leaf: np.asarray(leaf, float), machine)
    lanes = periodic(base, columns, settings)
    loop = loop_of(CycleAdjoint, base, tuple(columns))
    if loop is None:
        return reverse_blocks(base, columns, lanes, names, metrics, settings, terms)
    parts = []
    for first in range(0, len(lanes.cycles), TOGETHER):
        some, y = ({n: v[first : first + TOGETHER] for n, v in table.items()} for table in (columns, lanes.y))
        parts.append(loop.run(base, some, y, names, metrics, settings, terms))
    values, slopes, still, most = zip(*parts, strict=True)
    return Derivatives(
        {n: np.concatenate([v[n] for v in values]) for n in metrics},
        {n: np.concatenate([v[n] for v in slopes]) for n in metrics},
        status(base, columns, lanes, settings, np.concatenate(still)), lanes.cycles, max(most),
    )  # fmt: skip


class CycleAdjoint:
    """The cycle of many designs and the way back through it, as machine code.

    Raises:
        Untranslatable: the machine uses an operation that has no machine code here.
    """

    def __init__(self, machine: Rig, varied: Sequence[str]):
        def body(n, carry, values, uniform):
            base, steps = uniform
            return cycle_step(set_parameters(base, values), *carry, n, steps, False)

        def bare(n, y, values, uniform):
            return body(n, (y, self._sums), values, uniform)[0]

        self._sums = {n: np.asarray(v, float) for n, v in empty_sums(machine, float).items()}
        y, values = dict.fromkeys(machine.initial_state(), 0.0), dict.fromkeys(varied, 0.0)
        uniform, cache = (machine, 0.0), runtime.cache_folder()
        self._loop = AdjointLoop(body, float, (y, self._sums), values, uniform, cache)
        # a cycle begins its sums anew: for all terms but the first only the states matter
        self._bare = AdjointLoop(bare, float, y, values, uniform, cache)

    def run(self, machine, columns, y, names, metrics, settings: GradientSettings, terms: int | None):
        """(metrics, their slopes, settled, terms) of some designs that begin the cycle at the states `y`."""
        count, steps = len(next(iter(columns.values()))), settings.steps_per_cycle
        uniform = machine, float(steps)
        nothing = {n: np.full(count, v) for n, v in self._sums.items()}
        (_, sums), trail = self._loop.run((y, nothing), columns, uniform, steps, runtime.cores())
        found, by_value, by_sums = jax.device_get(_measured(machine, columns, sums, tuple(metrics), 1.0 / steps))
        still = {n: np.zeros(count) for n in y}
        pulled = [(still, {n: v[k] for n, v in by_sums.items()}) for k in range(len(metrics))]
        slopes = {m: np.stack([by_value[n][k] for n in names], axis=1) for k, m in enumerate(metrics)}
        scales = np.abs(np.stack([columns[n] for n in names], axis=1))
        wide, done = {m: found[m][:, None] for m in metrics}, np.zeros(scales.shape, bool)
        for number in range(terms or settings.max_cycles):
            loop, way = (self._bare, trail.rows(len(y))) if number else (self._loop, trail)
            back = loop.pull(way, pulled, columns, uniform, runtime.cores())
            pulled = [by_carry if number else by_carry[0] for by_carry, _ in back]
            shares = {m: np.stack([by[n] for n in names], axis=1) for m, (_, by) in zip(metrics, back, strict=True)}
            slopes = {m: slopes[m] + shares[m] for m in metrics}
            done = settled(wide, slopes, shares, scales, settings.tolerance)
            if terms is None and number and done.all():
                break
        return {m: found[m] for m in metrics}, slopes, done.all(axis=1), number + 1


@functools.partial(jax.jit, static_argnames="metrics")
def _measured(machine, columns, sums, metrics, share):
    """The metrics (lanes,), and their derivatives (metrics, lanes) by the parameters at fixed sums and by the sums."""

    def one(values, sums):
        def metric(values, sums):
            found = measured(set_parameters(machine, values), sums, share)
            return {n: found[n] for n in metrics}

        found, pull = jax.vjp(metric, values, sums)
        rows = [{n: jnp.where(n == m, 1.0, 0.0) for n in metrics} for m in metrics]
        return found, jax.tree.map(lambda *leaves: jnp.stack(leaves), *(pull(row) for row in rows))

    found, (by_values, by_sums) = jax.vmap(one, out_axes=(0, 1))(columns, sums)
    return found, by_values, by_sums
