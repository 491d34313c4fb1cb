"""Many designs of one machine: each to its periodic state, metrics reduced inside the time loop."""

import dataclasses
import math
from collections.abc import Mapping
from functools import partial

import jax
import numpy as np
from jax.sharding import Mesh, PartitionSpec

from edhas_jax.cycle import REASONS, Status, advance, begin, verdict
from edhas_jax.integrate import DEFAULT_STEP
from edhas_jax.parameters import get_parameter
from edhas_jax.run import Precision
from edhas_jax.system import ActuatorSystem, Rig, Sine

# Arrays of this many designs: enough to keep vector units busy, little enough to stay in the first-level cache.
LANES = {Precision.FLOAT32: 128, Precision.FLOAT64: 64}
BLOCKS_PER_CHUNK = 4


@dataclasses.dataclass(frozen=True)
class BatchSettings:
    """How a batch is run.

    `step` [s] is the largest time step: each design takes equal steps per cycle, as many as keep below it. A design is
    periodic when flow, electrical power and stroke change by less than `tolerance` from one cycle to the next. With
    `soft_start` the first cycle is a ramp, whatever ramp the machine has; without it the set point starts at once.
    """

    step: float = DEFAULT_STEP
    tolerance: float = 1e-4
    max_cycles: int = 16
    soft_start: bool = True
    precision: Precision = Precision.FLOAT64


@dataclasses.dataclass(frozen=True)
class Chunk:
    """The designs that are run together: their rows in the table, and the steps that each takes per cycle."""

    rows: np.ndarray
    steps_per_cycle: int


__all__ = ["REASONS", "BatchError", "BatchSettings", "Chunk", "Status", "plan_chunks", "run_chunk", "run_designs"]


class BatchError(ValueError):
    """These designs cannot be run as a batch."""


def plan_chunks(machine: Rig, values: Mapping[str, np.ndarray], settings: BatchSettings) -> list[Chunk]:
    """Cut a table of designs into chunks, the same for the same table wherever it is run.

    Designs that take the same number of steps per cycle go together, so that a slow frequency keeps no other waiting.

    Raises:
        BatchError: the machine is not driven by a sine on a bench.
    """
    if isinstance(machine, ActuatorSystem) or not isinstance(machine.reference, Sine):
        raise BatchError(f"a batch needs a bench that is driven by a sine; this is {machine.name}")
    count = len(next(iter(values.values())))
    varied = [values[n] for n in ("frequency", "reference.frequency") if n in values]
    frequency = np.asarray(varied[0] if varied else get_parameter(machine, "reference.frequency"), float)
    frequency = np.broadcast_to(frequency, (count,))
    steps = np.array([steps_per_cycle(f, settings.step) for f in frequency])
    size = LANES[settings.precision] * BLOCKS_PER_CHUNK
    chunks = []
    for n in np.unique(steps):
        rows = np.flatnonzero(steps == n)
        chunks += [Chunk(rows[i : i + size], int(n)) for i in range(0, len(rows), size)]
    return chunks


def steps_per_cycle(frequency: float, step: float) -> int:
    """Steps of at most `step` [s] in a cycle, rounded up on a ladder of √2 so that designs share their count."""
    least = max(1.0 / (frequency * step), 64.0)
    return int(round(64 * 2.0 ** (math.ceil(2 * math.log2(least / 64.0) - 1e-9) / 2)))


def run_chunk(
    machine: Rig, values: Mapping[str, np.ndarray], chunk: Chunk, settings: BatchSettings
) -> dict[str, np.ndarray]:
    """Run the designs of one chunk: every metric in SI, `status`, `cycles` and `residual`, one value per row.

    The result depends on the designs and settings alone, not on the number of cores or on the neighbours.
    """
    lanes, dtype = LANES[settings.precision], np.dtype(settings.precision.value)
    devices = tuple(jax.local_devices()[:BLOCKS_PER_CHUNK])
    base = jax.tree.map(lambda leaf: np.asarray(leaf, dtype), machine)
    columns = {n: np.asarray(v)[chunk.rows].astype(dtype) for n, v in values.items()}
    numbers = chunk.steps_per_cycle, dtype.type(settings.tolerance), settings.soft_start
    every = np.arange(len(chunk.rows))
    slots, live = _placed(every, lanes, len(devices))
    state = jax.device_get(_begin(base, _at(columns, slots), live, dtype))
    kept, cycles, done = (jax.tree.map(lambda leaf: np.zeros_like(leaf[every]), part) for part in state[1:])
    number = 0
    for until in _stages(settings.max_cycles):
        state = jax.device_get(_advance(devices, base, _at(columns, slots), state, number, until, *numbers))
        for name, column in state.kept.items():
            kept[name][slots[live]] = column[live]
        cycles[slots[live]], done[slots[live]] = state.cycles[live], state.done[live]
        number, still = until, np.flatnonzero(live & ~state.done)
        if not len(still):
            break
        # the designs that are not yet periodic close ranks, so that they do not keep whole blocks waiting
        order, live = _placed(still, lanes, len(devices))
        slots = slots[order]
        state = jax.tree.map(lambda leaf, order=order: leaf[order], state)._replace(done=~live)
    out = jax.device_get(_verdict(base, columns, kept, done))
    return {n: np.asarray(v, float) for n, v in out.items()} | {"cycles": cycles.astype(float)}


def _at(columns: dict[str, np.ndarray], rows: np.ndarray) -> dict[str, np.ndarray]:
    return {n: column[rows] for n, column in columns.items()}


def _placed(rows: np.ndarray, lanes: int, devices: int) -> tuple[np.ndarray, np.ndarray]:
    """Which of `rows` stands in which lane, block after block in turn over the devices, and which lanes are filled.

    Each device gets room for a whole chunk, so that its program is the same, to the bit, however many there are.
    """
    slots = np.resize(rows, devices * BLOCKS_PER_CHUNK * lanes)
    live = np.zeros(slots.size, bool)
    for block, first in enumerate(range(0, len(rows), lanes)):
        part = rows[first : first + lanes]
        at = (block % devices * BLOCKS_PER_CHUNK + block // devices) * lanes
        slots[at : at + len(part)], live[at : at + len(part)] = part, True
    return slots, live


def _stages(max_cycles: int) -> list[int]:
    """The cycles after which the designs close ranks."""
    return sorted({min(n, max_cycles) for n in (4, 5, 6, 8, 12, 24, 48, max_cycles)})


def run_designs(
    machine: Rig, values: Mapping[str, np.ndarray], settings: BatchSettings = BatchSettings(), on_chunk=None
) -> dict[str, np.ndarray]:
    """Run a table of designs (columns: parameter name → SI values) and return its metrics in the same order.

    `on_chunk(done, total)` is called with the number of designs after each chunk.
    """
    count = len(next(iter(values.values())))
    table: dict[str, np.ndarray] = {}
    done = 0
    for chunk in plan_chunks(machine, values, settings):
        for name, column in run_chunk(machine, values, chunk, settings).items():
            table.setdefault(name, np.full(count, np.nan))[chunk.rows] = column
        done += len(chunk.rows)
        if on_chunk is not None:
            on_chunk(done, count)
    return table


_begin = jax.jit(begin, static_argnums=3)
_verdict = jax.jit(verdict)


@partial(jax.jit, static_argnums=0)
def _advance(devices, machine, columns, state, number, until, steps, tolerance, soft):
    """`advance` for a whole chunk: each core runs its share of the blocks, one after the other."""

    def blocks(machine, columns, state, *numbers):
        return jax.lax.map(lambda block: advance(machine, *block, *numbers), (columns, state))

    def fold(leaf):
        return leaf.reshape(len(devices) * BLOCKS_PER_CHUNK, -1)

    whole, split = PartitionSpec(), PartitionSpec("cores")
    result = jax.shard_map(
        blocks,
        mesh=Mesh(np.array(devices), ("cores",)),
        in_specs=(whole, split, split, *[whole] * 5),
        out_specs=split,
        check_vma=False,
    )(machine, *jax.tree.map(fold, (columns, state)), number, until, steps, tolerance, soft)
    return jax.tree.map(lambda leaf: leaf.reshape(-1), result)
