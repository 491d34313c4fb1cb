"""Forward mode: tangents by some parameters are carried through the periodic cycle together with the state.

The tangents of one design share most of their work, so a lane is a design with several of them. Where there are fewer
designs than lanes in a vector, each pair of a design and a parameter is a lane of its own instead.
"""

import functools
from collections.abc import Callable, Mapping, Sequence

import jax
import numpy as np

from edhas_jax.compiler.engines import compile_loop, many_lanes
from edhas_jax.compiler.loop_engine import LoopBody
from edhas_jax.compiler.multi_jvp import multi_jvp
from edhas_jax.core import runtime
from edhas_jax.design.batch.cycle_metrics import cycle_metrics, cycle_step, empty_sums
from edhas_jax.design.batch.periodic_solver import BatchState
from edhas_jax.design.batch.run_metrics import own_slopes
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

MOST_TANGENTS = 8  # of a lane: more no longer fit the caches
DESIGNS_OF_A_VECTOR = 8  # fewer designs do not fill the lanes of a vector


def forward(
    machine: Rig,
    columns: Mapping[str, np.ndarray],
    names: Sequence[str],
    metrics: Sequence[str],
    settings: GradientSettings,
    on_cycle: Callable[[float], None] | None = None,
    state: BatchState | None = None,
) -> Derivatives:
    """Metrics of designs and their derivatives, in forward mode; of whole runs where no sine drives the machine.

    Args:
        machine: what the designs have in common.
        columns: parameters that differ, by name in SI, each (designs,).
        names: the parameters to differentiate by, all among the columns.
        metrics: the metrics to differentiate.
        settings: steps and tolerances.
        on_cycle: called with the share of the work that is done.
        state: the periodic state of the designs, if it is known.
    """
    columns = {n: np.asarray(column, float) for n, column in columns.items()}
    base = jax.tree.map(lambda leaf: np.asarray(leaf, float), machine)
    if machine.cycle is None:
        values, slopes, status = own_slopes(machine, columns, names, metrics, settings.run.run_grid(machine))
        return Derivatives(values, slopes, status, np.zeros(len(status)), 0)
    count = len(next(iter(columns.values())))
    state = periodic_state(base, columns, settings) if state is None else state
    # a thread of a GPU has registers for one tangent at most
    on_gpu = many_lanes(count * len(names), float)
    groups = _groups(names) if count >= DESIGNS_OF_A_VECTOR and not on_gpu else [None]
    loops = [cached_loop(TangentLoop, base, tuple(columns), group, on_gpu) for group in groups]
    say, found = on_cycle or (lambda share: None), []
    for k, (loop, group) in enumerate(zip(loops, groups, strict=True)):
        report = functools.partial(lambda k, share: say((k + share) / len(loops)), k)
        found.append(loop.run(base, columns, state.y, group or names, metrics, settings, report))
    values, slopes, converged, most = zip(*found, strict=True)
    return Derivatives(
        values[0], {n: np.concatenate([of[n] for of in slopes], axis=1) for n in metrics},
        status_of(base, columns, state, settings, np.all(converged, axis=0)), state.cycles, max(most),
    )  # fmt: skip


def _groups(names: Sequence[str]) -> list[tuple[str, ...]]:
    """The parameters in as few groups of at most `MOST_TANGENTS` as possible, nearly equal in size."""
    return [tuple(part) for part in np.array_split(np.array(names, object), -(-len(names) // MOST_TANGENTS))]


class TangentLoop:
    """A cycle of many designs with tangents.

    With a `group` every lane is a design and has a tangent by each of its parameters; without, every lane is a pair of
    a design and a parameter and has one tangent.
    """

    def __init__(self, machine: Rig, varied: Sequence[str], group: tuple[str, ...] | None, many_lanes: bool = False):
        self._group, self._tangents = group, range(len(group) if group else 1)

        def advance(n, carry, lane, uniform):
            (state, tangents), (values, seeds), (base, steps) = carry, lane, uniform

            def step(values, state):
                return cycle_step(set_parameters(base, values), *state, n, steps, False)

            if not group:  # work on one tangent alone keeps fewer values at a time
                state, tangent = jax.jvp(step, (values, state), (seeds, _tangent(tangents, 0)))
                return state, _interleaved([tangent])
            directions = [{n: float(n == name) for n in values} for name in group]
            state, tangents = multi_jvp(
                step, (values, state), [(seed, _tangent(tangents, k)) for k, seed in enumerate(directions)]
            )  # fmt: skip
            return state, _interleaved(tangents)

        self._sums = {n: np.asarray(v, float) for n, v in empty_sums(machine, float).items()}
        state = dict.fromkeys(machine.initial_state(), 0.0), dict.fromkeys(self._sums, 0.0)
        tangents = _interleaved([state for _ in self._tangents])
        lane = dict.fromkeys(varied, 0.0), {} if group else dict.fromkeys(varied, 0.0)
        # one vector of so many tangents fills the nearest cache
        marked = jax.tree.map(lambda _: False, state), jax.tree.map(lambda _: True, tangents)
        options = {"many_lanes": many_lanes} | ({"vectors": 1, "tangents": marked} if group else {})
        self._loop = compile_loop(LoopBody(advance, float, (state, tangents), lane, (machine, 0.0), **options))

    def run(self, machine: Rig, columns, y, names, metrics, settings: GradientSettings, on_cycle):
        """(metrics, their slopes, converged, terms) of designs from their periodic states `y`; slopes by `names`."""
        count, width = len(next(iter(columns.values()))), len(self._tangents)
        scales = np.abs(np.stack([columns[n] for n in names], axis=1)).reshape(-1, width)
        pairs = len(scales) // count
        values, y = ({n: np.repeat(v, pairs) for n, v in table.items()} for table in (columns, y))
        # the direction of each tangent, (lanes, tangents) for each parameter
        seeds = {n: np.tile([float(n == other) for other in names], count).reshape(-1, width) for n in columns}
        done, tangents_y = np.zeros(len(scales), bool), {n: np.zeros(scales.shape) for n in y}
        kept = {n: np.full(len(scales), np.nan) for n in metrics}
        slopes = {n: np.full(scales.shape, np.nan) for n in metrics}
        for number in range(settings.max_cycles):
            rows = np.flatnonzero(~done)
            tables = ({n: v[rows] for n, v in table.items()} for table in (values, seeds, y, tangents_y))
            new, slope, moved = self._cycle(machine, *tables, settings.steps_per_cycle)
            new, slope = ({n: table[n] for n in metrics} for table in (new, slope))
            terms, wide = {n: slope[n] - slopes[n][rows] for n in metrics}, {n: new[n][:, None] for n in metrics}
            done[rows] = series_converged(wide, slope, terms, scales[rows], settings.tolerance).all(axis=1)
            for table, part in ((kept, new), (slopes, slope), (tangents_y, moved)):
                for n, column in part.items():
                    table[n][rows] = column
            on_cycle(1.0 if done.all() else (number + 1) / settings.max_cycles)
            if done.all():
                break
        kept, slopes = {n: kept[n][::pairs] for n in metrics}, {n: slopes[n].reshape(count, -1) for n in metrics}
        return kept, slopes, done.reshape(count, pairs).all(axis=1), number + 1

    def _cycle(self, machine: Rig, values, seeds, y, tangents_y, steps: int):
        """The metrics after a cycle (lanes,), and the tangents of metrics and states (lanes, tangents)."""
        count, width = next(iter(tangents_y.values())).shape
        sums = {n: np.full(count, v) for n, v in self._sums.items()}
        tangents = tangents_y, {n: np.zeros((count, width)) for n in self._sums}
        lane = values, {} if self._group else {n: table[:, 0] for n, table in seeds.items()}
        begin = (y, sums), jax.tree.map(lambda table: [table[:, k] for k in self._tangents], tangents)
        (_, sums), tangents = self._loop(begin, lane, (machine, float(steps)), 0, steps, runtime.cores())
        tangents = jax.tree.map(lambda table: np.stack(table, axis=1), tangents, is_leaf=_is_list)
        found = jax.device_get(_metric_tangents(machine, values, seeds, sums, tangents[1], 1.0 / steps))
        return *found, tangents[0]


def _is_list(leaf) -> bool:
    return isinstance(leaf, list)


def _tangent(tree, k: int):
    """Of a pytree of lists the k-th entry of each."""
    return jax.tree.map(lambda several: several[k], tree, is_leaf=_is_list)


def _interleaved(trees: list):
    """One pytree of lists from a list of pytrees: the tangents of one variable lie side by side."""
    return jax.tree.map(lambda *leaves: list(leaves), *trees)


@runtime.jit
def _metric_tangents(machine, values, seeds, sums, tangents, share):
    """The metrics of a cycle (lanes,) and their tangents (lanes, directions)."""

    def one(values, seeds, sums, tangents):
        def metrics(values, sums):
            return cycle_metrics(set_parameters(machine, values), sums, share)

        out, linear = jax.linearize(metrics, values, sums)
        return out, jax.vmap(linear)(seeds, tangents)

    return jax.vmap(one)(values, seeds, sums, tangents)
