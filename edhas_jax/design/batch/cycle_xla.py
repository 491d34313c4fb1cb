"""The cycles of a batch under XLA: on a GPU, and for machines that the package's own machine code does not reach."""

from functools import partial

import jax
import numpy as np
from jax.sharding import Mesh, PartitionSpec

from edhas_jax.design.batch.cycle import Lanes, advance, begin
from edhas_jax.machine.rigs import Rig

# Arrays of this many bytes: enough to keep vector units busy, little enough to stay in the first-level cache.
LANE_BYTES = 512
BLOCKS = 4  # of lanes on each device


def run_cycles(
    machine: Rig, columns: dict[str, np.ndarray], steps: int, tolerance, max_cycles: int, soft: bool,
    start: Lanes | None = None,
) -> Lanes:  # fmt: skip
    """Run designs of `steps` steps per cycle until each is periodic, or `max_cycles` are over; see `cycle.advance`.

    They begin at rest, or where they are at the `start`. The result depends on the designs alone, not on the number of
    cores or on the neighbours.
    """
    dtype, every = tolerance.dtype, np.arange(len(next(iter(columns.values()))))
    lanes, devices = LANE_BYTES // dtype.itemsize, tuple(jax.local_devices()[:BLOCKS])
    parts = []
    for first in range(0, len(every), lanes * BLOCKS):
        rows = every[first : first + lanes * BLOCKS]
        begin = None if start is None else jax.tree.map(lambda leaf, rows=rows: leaf[rows], start)
        parts.append(_few(machine, _at(columns, rows), steps, tolerance, max_cycles, soft, lanes, devices, begin))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


def _few(machine, columns, steps, tolerance, max_cycles, soft, lanes, devices, start) -> Lanes:
    """The designs that fit the lanes of one device."""
    every = np.arange(len(next(iter(columns.values()))))
    slots, live = _placed(every, lanes, len(devices))
    if start is None:
        state = jax.device_get(_begin(machine, _at(columns, slots), live, tolerance.dtype))
    else:
        state = jax.tree.map(lambda leaf: leaf[slots], start)._replace(done=~live)
    out = jax.tree.map(lambda leaf: np.zeros_like(leaf[every]), state)
    number = 0
    for until in _stages(max_cycles):
        state = jax.device_get(
            _advance(devices, machine, _at(columns, slots), state, number, until, steps, tolerance, soft)
        )
        for whole, part in zip(jax.tree.leaves(out), jax.tree.leaves(state), strict=True):
            whole[slots[live]] = part[live]
        number, still = until, np.flatnonzero(live & ~state.done)
        if not len(still):
            break
        # the designs that are not yet periodic close ranks, so that they do not keep whole blocks waiting
        order, live = _placed(still, lanes, len(devices))
        slots = slots[order]
        state = jax.tree.map(lambda leaf, order=order: leaf[order], state)._replace(done=~live)
    return out


def _at(columns: dict[str, np.ndarray], rows: np.ndarray) -> dict[str, np.ndarray]:
    return {n: column[rows] for n, column in columns.items()}


def _placed(rows: np.ndarray, lanes: int, devices: int) -> tuple[np.ndarray, np.ndarray]:
    """Which of `rows` stands in which lane, block after block in turn over the devices, and which lanes are filled.

    Each device gets room for a whole chunk, so that its program is the same, to the bit, however many there are.
    """
    slots = np.resize(rows, devices * BLOCKS * lanes)
    live = np.zeros(slots.size, bool)
    for block, first in enumerate(range(0, len(rows), lanes)):
        part = rows[first : first + lanes]
        at = (block % devices * BLOCKS + block // devices) * lanes
        slots[at : at + len(part)], live[at : at + len(part)] = part, True
    return slots, live


def _stages(max_cycles: int) -> list[int]:
    """The cycles after which the designs close ranks."""
    return sorted({min(n, max_cycles) for n in (4, 5, 6, 8, 12, 24, 48, max_cycles)})


_begin = jax.jit(begin, static_argnums=3)


@partial(jax.jit, static_argnums=0)
def _advance(devices, machine, columns, state, number, until, steps, tolerance, soft):
    """`advance` for a whole chunk: each core runs its share of the blocks, one after the other."""

    def blocks(machine, columns, state, *numbers):
        return jax.lax.map(lambda block: advance(machine, *block, *numbers), (columns, state))

    def fold(leaf):
        return leaf.reshape(len(devices) * BLOCKS, -1)

    whole, split = PartitionSpec(), PartitionSpec("cores")
    result = jax.shard_map(
        blocks,
        mesh=Mesh(np.array(devices), ("cores",)),
        in_specs=(whole, split, split, *[whole] * 5),
        out_specs=split,
        check_vma=False,
    )(machine, *jax.tree.map(fold, (columns, state)), number, until, steps, tolerance, soft)
    return jax.tree.map(lambda leaf: leaf.reshape(-1), result)
