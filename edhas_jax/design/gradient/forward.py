"""Forward mode: a lane is a design that carries its tangents by some parameters through the periodic cycle.

The tangents of one design share most of their work. Where there are fewer designs than lanes in a vector, each pair of
a design and a parameter is a lane of its own instead.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import jax
import numpy as np

from edhas_jax.compiler.multi_jvp import multi_jvp
from edhas_jax.compiler.native_loop import Loop
from edhas_jax.core import runtime
from edhas_jax.design.batch.cycle import cycle_step, empty_sums, measured
from edhas_jax.design.gradient.fixed_point import Derivatives, GradientSettings, periodic, settled, status
from edhas_jax.design.gradient.forward_blocks import forward_blocks
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.native_loop_cache import loop_of

TOGETHER = 8  # tangents of a design: more no longer fit the caches
ENOUGH = 8  # designs that fill the lanes of a vector


def forward(
    machine: Rig,
    columns: Mapping[str, np.ndarray],
    names: Sequence[str],
    metrics: Sequence[str],
    settings: GradientSettings,
    on_cycle: Callable[[float], None] | None = None,
) -> Derivatives:
    """Metrics of designs and their derivatives by the parameters `names`, all of which are among the `columns` (SI).

    `on_cycle(share)` is called with the share of the work that is done.
    """
    columns = {n: np.asarray(column, float) for n, column in columns.items()}
    base = jax.tree.map(lambda leaf: np.asarray(leaf, float), machine)
    count = len(next(iter(columns.values())))
    lanes = periodic(base, columns, settings)
    groups = _groups(names) if count >= ENOUGH else None
    loops = [loop_of(TangentLoop, base, tuple(columns), group) for group in groups or [None]]
    if None in loops:
        return forward_blocks(base, columns, lanes, names, metrics, settings, on_cycle)
    found = []
    for k, loop in enumerate(loops):

        def report(share, k=k):
            if on_cycle is not None:
                on_cycle((k + share) / len(loops))

        group = groups[k] if groups else names
        found.append(loop.run(base, columns, lanes.y, group, metrics, settings, report))
    still = np.all([part.still for part in found], axis=0)
    return Derivatives(
        found[0].values, {n: np.concatenate([part.slopes[n] for part in found], axis=1) for n in metrics},
        status(base, columns, lanes, settings, still), lanes.cycles, max(part.terms for part in found),
    )  # fmt: skip


def _groups(names: Sequence[str]) -> list[tuple[str, ...]]:
    """The parameters in as few groups of at most TOGETHER as possible, nearly equal in size."""
    return [tuple(part) for part in np.array_split(np.array(names, object), -(-len(names) // TOGETHER))]


class Tangents(NamedTuple):
    """Of designs and a group of parameters: metrics (designs,), slopes (designs, parameters); whether they settled."""

    values: dict[str, np.ndarray]
    slopes: dict[str, np.ndarray]
    still: np.ndarray
    terms: int


class TangentLoop:
    """A cycle of many designs with tangents, as machine code.

    With a `group` every lane is a design and has a tangent by each of its parameters; without, every lane is a pair of
    a design and a parameter and has one tangent.

    Raises:
        Untranslatable: the machine uses an operation that has no machine code here.
    """

    def __init__(self, machine: Rig, varied: Sequence[str], group: tuple[str, ...] | None):
        self._group, self._each = group, range(len(group) if group else 1)

        def body(n, carry, lane, uniform):
            (state, moved), (values, seeds), (base, steps) = carry, lane, uniform

            def step(values, state):
                return cycle_step(set_parameters(base, values), *state, n, steps, False)

            along = [{n: float(n == name) for n in values} for name in group] if group else [seeds]
            state, moved = multi_jvp(
                step, (values, state), [(seed, _one(moved, k)) for k, seed in enumerate(along)]
            )  # fmt: skip
            return state, _together(moved)

        self._sums = {n: np.asarray(v, float) for n, v in empty_sums(machine, float).items()}
        state = dict.fromkeys(machine.initial_state(), 0.0), dict.fromkeys(self._sums, 0.0)
        moved = _together([state for _ in self._each])
        lane = dict.fromkeys(varied, 0.0), {} if group else dict.fromkeys(varied, 0.0)
        # one vector of so many tangents fills the nearest cache
        how = {"vectors": 1, "tangents": (_filled(state, False), _filled(moved, True))} if group else {}
        self._loop = Loop(body, float, (state, moved), lane, (machine, 0.0), runtime.cache_folder(), **how)

    def run(self, machine: Rig, columns, y, names, metrics, settings: GradientSettings, on_cycle) -> Tangents:
        """The derivatives by the parameters `names`, from the periodic states `y` of the designs of `columns`."""
        count, each = len(next(iter(columns.values()))), len(self._each)
        scales = np.abs(np.stack([columns[n] for n in names], axis=1)).reshape(-1, each)
        pairs = len(scales) // count
        values, y = ({n: np.repeat(v, pairs) for n, v in table.items()} for table in (columns, y))
        # the direction of each tangent, (lanes, tangents) for each parameter
        seeds = {n: np.tile([float(n == other) for other in names], count).reshape(-1, each) for n in columns}
        done, moved_y = np.zeros(len(scales), bool), {n: np.zeros(scales.shape) for n in y}
        kept = {n: np.full(len(scales), np.nan) for n in metrics}
        slopes = {n: np.full(scales.shape, np.nan) for n in metrics}
        for number in range(settings.max_cycles):
            rows = np.flatnonzero(~done)
            here = (_at(table, rows) for table in (values, seeds, y, moved_y))
            new, slope, moved = self._cycle(machine, *here, settings.steps_per_cycle)
            new, slope = ({n: table[n] for n in metrics} for table in (new, slope))
            terms, wide = {n: slope[n] - slopes[n][rows] for n in metrics}, {n: new[n][:, None] for n in metrics}
            done[rows] = settled(wide, slope, terms, scales[rows], settings.tolerance).all(axis=1)
            for table, part in ((kept, new), (slopes, slope), (moved_y, moved)):
                for n, column in part.items():
                    table[n][rows] = column
            on_cycle(1.0 if done.all() else (number + 1) / settings.max_cycles)
            if done.all():
                break
        return Tangents(
            {n: kept[n][::pairs] for n in metrics}, {n: slopes[n].reshape(count, -1) for n in metrics},
            done.reshape(count, pairs).all(axis=1), number + 1,
        )  # fmt: skip

    def _cycle(self, machine: Rig, values, seeds, y, moved_y, steps: int):
        """The metrics after a cycle (lanes,), and the tangents of metrics and states (lanes, tangents)."""
        count, each = next(iter(moved_y.values())).shape
        sums = {n: np.full(count, v) for n, v in self._sums.items()}
        moved = moved_y, {n: np.zeros((count, each)) for n in self._sums}
        lane = values, {} if self._group else {n: table[:, 0] for n, table in seeds.items()}
        begin = (y, sums), jax.tree.map(lambda table: [table[:, k] for k in self._each], moved)
        (_, sums), moved = self._loop(begin, lane, (machine, float(steps)), 0, steps, runtime.cores())
        moved = jax.tree.map(lambda table: np.stack(table, axis=1), moved, is_leaf=_several)
        return *jax.device_get(_measured(machine, values, seeds, sums, moved[1], 1.0 / steps)), moved[0]


def _several(leaf) -> bool:
    return isinstance(leaf, list)


def _one(tree, k: int):
    """Of a pytree of lists the k-th of each."""
    return jax.tree.map(lambda several: several[k], tree, is_leaf=_several)


def _together(trees: list):
    """One pytree of lists from a list of pytrees: what belongs to one variable lies side by side."""
    return jax.tree.map(lambda *leaves: list(leaves), *trees)


def _filled(tree, value: bool):
    return jax.tree.map(lambda _: value, tree)


def _at(columns: dict[str, np.ndarray], rows: np.ndarray) -> dict[str, np.ndarray]:
    return {n: column[rows] for n, column in columns.items()}


@jax.jit
def _measured(machine, values, seeds, sums, moved, share):
    """The metrics of a cycle (lanes,) and their tangents (lanes, directions)."""

    def one(values, seeds, sums, moved):
        def metrics(values, sums):
            return measured(set_parameters(machine, values), sums, share)

        out, along = jax.linearize(metrics, values, sums)
        return out, jax.vmap(along)(seeds, moved)

    return jax.vmap(one)(values, seeds, sums, moved)
