"""Forward mode under XLA, eight directions with every block: for accelerators, and effects without machine code."""

from collections.abc import Mapping, Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec

from edhas_jax.design.batch.cycle import Lanes, advance, begin
from edhas_jax.design.gradient.fixed_point import Derivatives, GradientSettings, filled, settled, status
from edhas_jax.machine.rigs import Rig

# A tangent array holds DIRECTIONS × LANES numbers: little enough for the first-level cache, and no multiple of 4 kB,
# at which all arrays would fall on the same lines of it.
DIRECTIONS, LANES = 8, 28


def forward_blocks(
    machine: Rig,
    columns: Mapping[str, np.ndarray],
    lanes: Lanes,
    names: Sequence[str],
    metrics: Sequence[str],
    settings: GradientSettings,
    on_cycle=None,
) -> Derivatives:
    """As `forward`, from the periodic state in `lanes`.

    The designs are marched once for every DIRECTIONS parameters, each core its share of blocks and directions.
    """
    devices = tuple(jax.local_devices())
    count = len(next(iter(columns.values())))
    groups = [list(names[i : i + DIRECTIONS]) for i in range(0, len(names), DIRECTIONS)]
    items = [(rows, block, group) for rows, block in filled(columns, LANES) for group in groups]
    values = {n: np.full(count, np.nan) for n in metrics}
    slopes = {n: np.full((count, len(names)), np.nan) for n in metrics}
    still, most = np.ones(count, bool), 0
    for first in range(0, len(items), len(devices)):
        wave = items[first : first + len(devices)]
        padded = [wave[i % len(wave)] for i in range(len(devices))]

        def report(share, first=first, wave=wave):
            if on_cycle is not None:
                on_cycle((first + share * len(wave)) / len(items))

        kept, moved, done, terms = _wave(devices, machine, padded, lanes.y, list(columns), metrics, settings, report)
        most = max(most, terms)
        for i, (rows, _, group) in enumerate(wave):
            at = [names.index(n) for n in group]
            for n in metrics:
                values[n][rows] = kept[n][i, : len(rows)]
                slopes[n][np.ix_(rows, at)] = moved[n][i, : len(group), : len(rows)].T
            still[rows] &= done[i, : len(group), : len(rows)].all(axis=0)
    return Derivatives(values, slopes, status(machine, columns, lanes, settings, still), lanes.cycles, most)


def _wave(devices, base, items, y, names, metrics, settings: GradientSettings, report):
    """One item per device, each a block of designs and a group of directions, until all have settled."""
    columns = {n: np.stack([block[n] for _, block, _ in items]) for n in names}
    y = {n: np.stack([np.resize(v[rows], LANES) for rows, _, _ in items]) for n, v in y.items()}
    seeds = {n: np.zeros((len(items), DIRECTIONS)) for n in names}
    scales = np.zeros((len(items), DIRECTIONS, LANES))
    for i, (_, block, group) in enumerate(items):
        for d, n in enumerate(group):
            seeds[n][i, d] = 1.0
            scales[i, d] = np.abs(block[n])
    moved_y = {n: np.zeros(scales.shape) for n in y}
    slopes = {n: np.full(scales.shape, np.nan) for n in metrics}
    for number in range(settings.max_cycles):
        kept, (moved_y, moved) = _cycle(devices, base, columns, seeds, y, moved_y, settings.steps_per_cycle)
        kept, moved = jax.device_get(({n: kept[n] for n in metrics}, {n: moved[n] for n in metrics}))
        terms = {n: moved[n] - slopes[n] for n in metrics}
        wide = {n: kept[n][:, None, :] for n in metrics}
        done = settled(wide, moved, terms, scales, settings.tolerance)
        slopes = moved
        report(1.0 if done.all() else (number + 1) / settings.max_cycles)
        if done.all():
            break
    return kept, slopes, done, number + 1


@partial(jax.jit, static_argnums=0)
def _cycle(devices, machine, columns, seeds, y, moved_y, steps):
    """The cycle of every item, each on a device of its own: metrics, and tangents of (states, metrics)."""

    def item(machine, columns, seeds, y, moved_y, steps):
        columns, seeds, y, moved_y = jax.tree.map(lambda leaf: leaf[0], (columns, seeds, y, moved_y))

        def march(values, y):
            fresh = begin(machine, values, jnp.ones(LANES, bool), jnp.float64)
            lanes = advance(machine, values, fresh._replace(y=y), 0, 1, steps, -1.0, False)
            return (lanes.y, lanes.kept), lanes.kept

        def along(seed, moved_y):
            return jax.jvp(march, (columns, y), (_spread(seed), moved_y), has_aux=True)

        _, tangents, kept = jax.vmap(along, out_axes=(None, 0, None))(seeds, moved_y)
        return jax.tree.map(lambda leaf: leaf[None], (kept, tangents))

    whole, split = PartitionSpec(), PartitionSpec("cores")
    return jax.shard_map(
        item,
        mesh=Mesh(np.array(devices), ("cores",)),
        in_specs=(whole, split, split, split, split, whole),
        out_specs=split,
        check_vma=False,
    )(machine, columns, seeds, y, moved_y, steps)


def _spread(seed):
    """One direction for all lanes: the seed of each column in every lane."""
    return {n: jnp.broadcast_to(value, LANES) for n, value in seed.items()}
