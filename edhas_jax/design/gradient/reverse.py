"""Reverse mode: sweeps back through the periodic cycle give the derivatives of a metric by any number of parameters."""

from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.compiler.engines import compile_adjoint_loop, many_lanes
from edhas_jax.compiler.loop_engine import LoopBody
from edhas_jax.core import runtime
from edhas_jax.design.batch.cycle_metrics import cycle_metrics, cycle_step, empty_sums
from edhas_jax.design.batch.periodic_solver import BatchState
from edhas_jax.design.gradient.fixed_point import (
    Derivatives,
    GradientSettings,
    periodic_state,
    series_converged,
    status_of,
)
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.loop_cache import cached_loop

DESIGNS_PER_SWEEP = 256  # so that the checkpoints do not grow with the number of designs
GPU_DESIGNS_PER_SWEEP = 16384


def reverse(
    machine: Rig,
    columns: Mapping[str, np.ndarray],
    names: Sequence[str],
    metrics: Sequence[str],
    settings: GradientSettings,
    terms: int | None = None,
    state: BatchState | None = None,
) -> Derivatives:
    """As `forward`, in reverse mode.

    All designs that run together take as many terms as the slowest of them.

    Args:
        machine: what the designs have in common.
        columns: parameters that differ, by name in SI, each (designs,).
        names: the parameters to differentiate by, all among the columns.
        metrics: the metrics to differentiate.
        settings: steps and tolerances.
        terms: number of terms of the series; None: until they no longer count.
        state: the periodic state of the designs, if it is known.
    """
    columns = {n: np.asarray(column, float) for n, column in columns.items()}
    base = jax.tree.map(lambda leaf: np.asarray(leaf, float), machine)
    state = periodic_state(base, columns, settings) if state is None else state
    on_gpu = many_lanes(len(state.cycles), float)
    loop = cached_loop(CycleAdjoint, base, tuple(columns), on_gpu)
    parts, length = [], GPU_DESIGNS_PER_SWEEP if on_gpu else DESIGNS_PER_SWEEP
    for first in range(0, len(state.cycles), length):
        last = first + length
        some, y = ({n: v[first:last] for n, v in table.items()} for table in (columns, state.y))
        parts.append(loop.run(base, some, y, names, metrics, settings, terms))
    values, slopes, converged, most = zip(*parts, strict=True)
    return Derivatives(
        {n: np.concatenate([v[n] for v in values]) for n in metrics},
        {n: np.concatenate([v[n] for v in slopes]) for n in metrics},
        status_of(base, columns, state, settings, np.concatenate(converged)), state.cycles, max(most),
    )  # fmt: skip


class CycleAdjoint:
    """The cycle of many designs and its reverse-mode derivative."""

    def __init__(self, machine: Rig, varied: Sequence[str], many_lanes: bool = False):
        def step(n, carry, values, uniform):
            base, steps = uniform
            return cycle_step(set_parameters(base, values), *carry, n, steps, False)

        def state_step(n, y, values, uniform):
            return step(n, (y, self._sums), values, uniform)[0]

        self._sums = {n: np.asarray(v, float) for n, v in empty_sums(machine, float).items()}
        y, values = dict.fromkeys(machine.initial_state(), 0.0), dict.fromkeys(varied, 0.0)
        uniform = machine, 0.0
        options = {"many_lanes": many_lanes}
        self._loop = compile_adjoint_loop(LoopBody(step, float, (y, self._sums), values, uniform, **options))
        # a cycle begins its sums anew: for all terms but the first only the states matter
        self._state_loop = compile_adjoint_loop(LoopBody(state_step, float, y, values, uniform, **options))

    def run(self, machine, columns, y, names, metrics, settings: GradientSettings, terms: int | None):
        """(metrics, their slopes, converged, terms) of some designs that begin the cycle at the states `y`."""
        count, steps = len(next(iter(columns.values()))), settings.steps_per_cycle
        uniform = machine, float(steps)
        zero_sums = {n: np.full(count, v) for n, v in self._sums.items()}
        (_, sums), checkpoints = self._loop.run((y, zero_sums), columns, uniform, steps, runtime.cores())
        found, by_value, by_sums = jax.device_get(
            _metric_cotangents(machine, columns, sums, tuple(metrics), 1.0 / steps)
        )
        zero = {n: np.zeros(count) for n in y}
        cotangents = [(zero, {n: v[k] for n, v in by_sums.items()}) for k in range(len(metrics))]
        slopes = {m: np.stack([by_value[n][k] for n in names], axis=1) for k, m in enumerate(metrics)}
        scales = np.abs(np.stack([columns[n] for n in names], axis=1))
        wide, done = {m: found[m][:, None] for m in metrics}, np.zeros(scales.shape, bool)
        for number in range(terms or settings.max_cycles):
            loop = self._state_loop if number else self._loop
            back = loop.vjp(checkpoints, cotangents, columns, uniform, runtime.cores())
            cotangents = [by_carry if number else by_carry[0] for by_carry, _ in back]
            term = {m: np.stack([by[n] for n in names], axis=1) for m, (_, by) in zip(metrics, back, strict=True)}
            slopes = {m: slopes[m] + term[m] for m in metrics}
            done = series_converged(wide, slopes, term, scales, settings.tolerance)
            if terms is None and number and done.all():
                break
        return {m: found[m] for m in metrics}, slopes, done.all(axis=1), number + 1


@runtime.jit(static_argnames="metrics")
def _metric_cotangents(machine, columns, sums, metrics, share):
    """The metrics (lanes,), and their derivatives (metrics, lanes) by the parameters at fixed sums and by the sums."""

    def one(values, sums):
        def metric(values, sums):
            found = cycle_metrics(set_parameters(machine, values), sums, share)
            return {n: found[n] for n in metrics}

        found, pull = jax.vjp(metric, values, sums)
        rows = [{n: jnp.where(n == m, 1.0, 0.0) for n in metrics} for m in metrics]
        return found, jax.tree.map(lambda *leaves: jnp.stack(leaves), *(pull(row) for row in rows))

    found, (by_values, by_sums) = jax.vmap(one, out_axes=(0, 1))(columns, sums)
    return found, by_values, by_sums
