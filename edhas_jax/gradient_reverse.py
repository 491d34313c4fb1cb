"""Reverse mode: one sweep back through the cycles gives the derivatives of a metric by any number of parameters."""

import functools
from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax import backend
from edhas_jax.cycle import cycle_step, empty_sums, measured, verdict
from edhas_jax.cycle_loop import begin_lanes, judge_cycle
from edhas_jax.gradient_plan import Derivatives, GradientSettings
from edhas_jax.gradient_reverse_blocks import pull_begin, reverse_blocks
from edhas_jax.loop_cache import loop_of
from edhas_jax.native import AdjointLoop
from edhas_jax.parameters import set_parameters
from edhas_jax.system import Rig

TOGETHER = 256  # designs at a time: what is kept of their way does not grow with the number of designs
NEVER = np.array(-1.0)  # tolerance at which no design counts as periodic, so that all go on


def reverse(
    machine: Rig,
    columns: Mapping[str, np.ndarray],
    names: Sequence[str],
    metrics: Sequence[str],
    settings: GradientSettings,
    cycles: int | None = None,
) -> Derivatives:
    """As `forward`, in reverse mode, after so many `cycles`, or as many as the metrics take to settle.

    All designs run as many cycles as the slowest of those that run together. Kept are some states of every cycle; on
    the way back the states between are computed again, so that the memory needed hardly grows with the cycles.
    """
    columns = {n: np.asarray(column, float) for n, column in columns.items()}
    base = jax.tree.map(lambda leaf: np.asarray(leaf, float), machine)
    loop = loop_of(CycleAdjoint, base, tuple(columns))
    if loop is None:
        return reverse_blocks(machine, columns, names, metrics, settings, cycles)
    count = len(next(iter(columns.values())))
    parts = []
    for first in range(0, count, TOGETHER):
        some = {n: column[first : first + TOGETHER] for n, column in columns.items()}
        parts.append(loop.run(base, some, names, metrics, settings, cycles))
    values = {n: np.concatenate([p.values[n] for p in parts]) for n in metrics}
    slopes = {n: np.concatenate([p.slopes[n] for p in parts]) for n in metrics}
    status = np.concatenate([p.status for p in parts])
    return Derivatives(values, slopes, status, max(p.cycles for p in parts))


class CycleAdjoint:
    """Whole cycles of many designs and the way back through them, as machine code.

    Raises:
        Untranslatable: the machine uses an operation that has no machine code here.
    """

    def __init__(self, machine: Rig, varied: Sequence[str]):
        def body(n, carry, values, uniform):
            base, steps, ramp = uniform
            return cycle_step(set_parameters(base, values), *carry, n, steps, ramp > 0.5)

        def bare(n, y, values, uniform):
            return body(n, (y, self._sums), values, uniform)[0]

        self._sums = {n: np.asarray(v, float) for n, v in empty_sums(machine, float).items()}
        y, values = dict.fromkeys(machine.start(), 0.0), dict.fromkeys(varied, 0.0)
        uniform, cache = (machine, 0.0, 0.0), backend.cache_folder()
        self._loop = AdjointLoop(body, float, (y, self._sums), values, uniform, cache)
        # each cycle begins its sums anew: before the last one only the states matter
        self._bare = AdjointLoop(bare, float, y, values, uniform, cache)

    def run(self, machine, columns, names, metrics, settings: GradientSettings, cycles: int | None) -> Derivatives:
        """Derivatives of some designs, all after the same number of cycles."""
        count, steps = len(next(iter(columns.values()))), settings.steps_per_cycle
        nothing = {n: np.full(count, v) for n, v in self._sums.items()}
        lanes = jax.device_get(begin_lanes(machine, columns, np.ones(count, bool), jnp.float64))
        trails, done = [], np.zeros(count, bool)
        while len(trails) < (cycles or settings.max_cycles):
            if cycles is None and len(trails) > settings.min_cycles and done.all():
                break
            uniform = machine, float(steps), float(not trails)
            (y, sums), trail = self._loop.run((lanes.y, nothing), columns, uniform, steps, backend.cores())
            lanes = jax.device_get(judge_cycle(machine, columns, lanes, y, sums, len(trails), steps, NEVER))
            trails.append(trail)
            done = lanes.kept["residual"] <= settings.tolerance
        run_cycles = len(trails)
        found = jax.device_get(_measured(machine, columns, sums, tuple(metrics), 1.0 / steps))
        status = jax.device_get(_verdict(machine, columns, lanes.kept, done))["status"]
        by_value, by_sums = found[1:]
        still = {n: np.zeros(count) for n in y}
        pulled = [(still, {n: v[k] for n, v in by_sums.items()}) for k in range(len(metrics))]
        moved = [{n: v[k] for n, v in by_value.items()} for k in range(len(metrics))]
        for number in reversed(range(run_cycles)):
            uniform = machine, float(steps), float(number == 0)
            trail, last = trails.pop(), number == run_cycles - 1
            loop, trail = (self._loop, trail) if last else (self._bare, trail.rows(len(y)))
            back = loop.pull(trail, pulled, columns, uniform, backend.cores())
            pulled = [by_carry[0] if last else by_carry for by_carry, _ in back]
            moved = [{n: v + share[n] for n, v in m.items()} for m, (_, share) in zip(moved, back, strict=True)]
        share = jax.device_get(pull_begin(machine, columns, {n: np.stack([row[n] for row in pulled]) for n in y}))
        slopes = {
            metric: np.stack([moved[k][n] + share[n][k] for n in names], axis=1) for k, metric in enumerate(metrics)
        }
        return Derivatives(dict(found[0]), slopes, status.astype(float), run_cycles)


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


_verdict = jax.jit(verdict)
