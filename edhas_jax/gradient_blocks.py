"""Forward mode under XLA, eight directions with every block: for accelerators, and effects without machine code."""

from collections.abc import Mapping, Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec

from edhas_jax.cycle import advance, begin, verdict
from edhas_jax.gradient_plan import Derivatives, GradientSettings, filled, settled
from edhas_jax.system import Rig

# A tangent array holds DIRECTIONS × LANES numbers: little enough for the first-level cache, and no multiple of 4 kB,
# at which all arrays would fall on the same lines of it.
DIRECTIONS, LANES = 8, 28


def forward_blocks(
    machine: Rig,
    columns: Mapping[str, np.ndarray],
    names: Sequence[str],
    metrics: Sequence[str],
    settings: GradientSettings,
    on_cycle=None,
) -> Derivatives:
    """Metrics of designs and their derivatives by the parameters `names`, all of which are among the `columns` (SI).

    The designs are marched once for every DIRECTIONS parameters, each core its share of blocks and directions.
    `on_cycle(share)` is called with the share of the work that is done.
    """
    devices = tuple(jax.local_devices())
    columns = {n: np.asarray(column, float) for n, column in columns.items()}
    count = len(next(iter(columns.values())))
    base = jax.tree.map(lambda leaf: np.asarray(leaf, float), machine)
    groups = [list(names[i : i + DIRECTIONS]) for i in range(0, len(names), DIRECTIONS)]
    items = [(rows, block, group) for rows, block in filled(columns, LANES) for group in groups]
    values = {n: np.full(count, np.nan) for n in metrics}
    slopes = {n: np.full((count, len(names)), np.nan) for n in metrics}
    status, most = np.zeros(count), 0
    for first in range(0, len(items), len(devices)):
        wave = items[first : first + len(devices)]
        padded = [wave[i % len(wave)] for i in range(len(devices))]

        def report(share, first=first, wave=wave):
            if on_cycle is not None:
                on_cycle((first + share * len(wave)) / len(items))

        results, cycles = _wave(devices, base, padded, list(columns), metrics, settings, report)
        most = max(most, cycles)
        for (rows, _, group), (kept, moved, verdicts) in zip(wave, results, strict=False):
            at = [names.index(n) for n in group]
            for n in metrics:
                values[n][rows] = kept[n][: len(rows)]
                slopes[n][np.ix_(rows, at)] = moved[n][: len(group), : len(rows)].T
            status[rows] = np.maximum(status[rows], verdicts[: len(rows)])
    return Derivatives(values, slopes, status, most)


def _wave(devices, base, items, names, metrics, settings: GradientSettings, report):
    """One item per device, each a block of designs and a group of directions, until all have settled."""
    columns = {n: np.stack([block[n] for _, block, _ in items]) for n in names}
    seeds = {n: np.zeros((len(items), DIRECTIONS)) for n in names}
    scales = np.zeros((len(items), DIRECTIONS, LANES))
    for i, (_, block, group) in enumerate(items):
        for d, n in enumerate(group):
            seeds[n][i, d] = 1.0
            scales[i, d] = np.abs(block[n])
    state, tangents = _begin(base, columns, seeds)
    before, done = None, False
    for number in range(settings.max_cycles):
        state, tangents = _cycle(devices, base, columns, seeds, state, tangents, number, settings.steps_per_cycle)
        kept, moved = jax.device_get((state.kept, tangents[1]))
        kept = {n: kept[n] for n in kept}
        now = {n: kept[n][:, None, :] for n in metrics}, {n: moved[n] for n in metrics}
        done = number + 1 >= settings.min_cycles and settled(*now, before, scales, settings.tolerance).all()
        before = now
        report(1.0 if done else (number + 1) / settings.max_cycles)
        if done:
            break
    results = []
    for i in range(len(items)):
        block = {n: column[i] for n, column in columns.items()}
        last = {n: v[i] for n, v in kept.items()}
        out = jax.device_get(_verdict(base, block, last, np.full(LANES, done)))
        results.append((last, {n: moved[n][i] for n in metrics}, out["status"]))
    return results, number + 1


@jax.jit
def _begin(machine, columns, seeds):
    """Lanes and their tangents at rest; leading axis: items."""

    def item(columns, seeds):
        def start(values):
            lanes = begin(machine, values, jnp.ones(LANES, bool), jnp.float64)
            return (lanes.y, lanes.kept), lanes

        def along(seed):
            return jax.jvp(start, (columns,), (_spread(seed),), has_aux=True)

        _, tangents, lanes = jax.vmap(along, out_axes=(None, 0, None))(seeds)
        return lanes, tangents

    return jax.vmap(item)(columns, seeds)


@partial(jax.jit, static_argnums=0)
def _cycle(devices, machine, columns, seeds, state, tangents, number, steps):
    """One cycle of every item, each on a device of its own."""

    def item(machine, columns, seeds, state, tangents, number, steps):
        columns, seeds, state, tangents = jax.tree.map(lambda leaf: leaf[0], (columns, seeds, state, tangents))

        def march(values, y, kept):
            lanes = advance(machine, values, state._replace(y=y, kept=kept), number, number + 1, steps, -1.0, True)
            return (lanes.y, lanes.kept), lanes

        def along(seed, moved_y, moved_kept):
            primals, moved = (columns, state.y, state.kept), (_spread(seed), moved_y, moved_kept)
            return jax.jvp(march, primals, moved, has_aux=True)

        _, tangents, lanes = jax.vmap(along, out_axes=(None, 0, None))(seeds, *tangents)
        return jax.tree.map(lambda leaf: leaf[None], (lanes, tangents))

    whole, split = PartitionSpec(), PartitionSpec("cores")
    return jax.shard_map(
        item,
        mesh=Mesh(np.array(devices), ("cores",)),
        in_specs=(whole, split, split, split, split, whole, whole),
        out_specs=split,
        check_vma=False,
    )(machine, columns, seeds, state, tangents, number, steps)


_verdict = jax.jit(verdict)


def _spread(seed):
    """One direction for all lanes: the seed of each column in every lane."""
    return {n: jnp.broadcast_to(value, LANES) for n, value in seed.items()}
