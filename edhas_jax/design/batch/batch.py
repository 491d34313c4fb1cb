"""Many designs of one machine: each to its periodic state, metrics reduced inside the time loop."""

import dataclasses
import math
from collections.abc import Mapping

import jax
import numpy as np

from edhas_jax.design.batch.cycle import REASONS, Lanes, Status, changed
from edhas_jax.design.batch.cycles import CHUNK, run_cycles, told
from edhas_jax.machine.parameters import get_parameter
from edhas_jax.machine.rigs import ActuatorSystem, Rig, Sine
from edhas_jax.simulation.integrator import DEFAULT_STEP
from edhas_jax.simulation.run import Precision

SLOW = 8  # cycles beyond which the step is looked at, by so many MORE with a longer one
MORE = 2
HANGS = 0.01  # change of flow, power or stroke with the step above which a design is flagged


@dataclasses.dataclass(frozen=True)
class BatchSettings:
    """How a batch is run.

    `step` [s] is the largest time step: each design takes equal steps per cycle, as many as keep below it. A design is
    periodic when flow, electrical power and stroke change by less than `tolerance` from one cycle to the next, twice in
    a row; one that takes more than eight cycles is flagged if they hang on the step by more than 1 %. With `soft_start`
    the first cycle is a ramp, whatever ramp the machine has; without it the set point starts at once.
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
    steps = steps_per_cycle(frequency, settings.step)
    chunks = []
    for n in np.unique(steps):
        rows = np.flatnonzero(steps == n)
        chunks += [Chunk(rows[i : i + CHUNK], int(n)) for i in range(0, len(rows), CHUNK)]
    return chunks


def steps_per_cycle(frequency, step: float) -> np.ndarray:
    """Steps of at most `step` [s] in a cycle, rounded up on a ladder of √2 so that designs share their count."""
    least = np.maximum(1.0 / (np.asarray(frequency) * step), 64.0)
    return np.rint(64 * 2.0 ** (np.ceil(2 * np.log2(least / 64.0) - 1e-9) / 2)).astype(int)


def run_chunk(
    machine: Rig, values: Mapping[str, np.ndarray], chunk: Chunk, settings: BatchSettings
) -> dict[str, np.ndarray]:
    """Run the designs of one chunk: every metric in SI, `status`, `cycles` and `residual`, one value per row.

    The result depends on the designs and settings alone, not on the number of cores or on the neighbours.
    """
    dtype = np.dtype(settings.precision.value)
    base = jax.tree.map(lambda leaf: np.asarray(leaf, dtype), machine)
    columns = {n: np.asarray(v)[chunk.rows].astype(dtype) for n, v in values.items()}
    how = dtype.type(settings.tolerance), settings.max_cycles, settings.soft_start
    lanes = run_cycles(base, columns, chunk.steps_per_cycle, *how)
    out = told(base, columns, lanes.kept, lanes.done) | {"cycles": lanes.cycles}
    out = {n: np.asarray(v, float) for n, v in out.items()}
    slow = np.flatnonzero((out["cycles"] > SLOW) & (out["status"] == Status.OK))
    if len(slow):
        here, columns = jax.tree.map(lambda leaf: leaf[slow], (lanes, columns))
        hangs = _step_matters(base, columns, here, chunk.steps_per_cycle, dtype)
        out["status"][slow[hangs]] = Status.STEP_TOO_LARGE
    return out


def _step_matters(base: Rig, columns: dict[str, np.ndarray], lanes: Lanes, steps: int, dtype) -> np.ndarray:
    """Which of some designs change by more than `HANGS` when they go on with a step √2 times as long.

    Designs that take long to become periodic are near to losing their period, where the step matters most.
    """
    coarser = int(round(steps / math.sqrt(2.0)))
    # a tolerance below zero: none of these cycles is the last one
    after = run_cycles(base, columns, coarser, dtype.type(-1.0), MORE, False, lanes)
    return ~(np.asarray(_changed(after.kept, lanes.kept)) <= HANGS)


_changed = jax.jit(changed)


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
