"""The cycles of a table of designs, as machine code where there is any, else under XLA; and what became of each."""

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from edhas_jax.design.batch import cycle_xla
from edhas_jax.design.batch.cycle import Lanes, verdict
from edhas_jax.design.batch.cycle_loop import cycle_loop
from edhas_jax.design.batch.rows import Rows
from edhas_jax.machine.rigs import Rig

# tables are filled up to one of two lengths, so that another number of designs compiles nothing
SHORT, CHUNK = 1024, 4096


def run_cycles(
    machine: Rig, columns: Mapping[str, np.ndarray], steps: int, tolerance, max_cycles: int, soft: bool,
    start: Lanes | None = None,
) -> Lanes:  # fmt: skip
    """The designs of `columns` (SI) after as many cycles as each takes to become periodic, at most `max_cycles`.

    Each takes `steps` steps per cycle in the precision of `tolerance`, from rest or where it is at the `start`; the
    first cycle is a ramp if `soft`. The result depends on the designs alone, not on the number of cores or on the
    neighbours.
    """
    how = steps, tolerance, max_cycles, soft
    loop = cycle_loop(machine, sorted(columns), tolerance.dtype)
    if loop is None:
        return cycle_xla.run_cycles(machine, dict(columns), *how, start)
    count, rows = _rows(columns)
    start = None if start is None else jax.tree.map(lambda leaf: leaf[rows], start)
    lanes = loop.run_cycles(machine, {n: v[rows] for n, v in columns.items()}, count, *how, start)
    return jax.tree.map(lambda leaf: leaf[:count], lanes)


def told(machine: Rig, columns: Mapping[str, np.ndarray], kept: Mapping[str, np.ndarray], done) -> dict[str, Any]:
    """The metrics that designs have `kept`, with the `status` of each; those that are not `done` are not periodic."""
    count, rows = _rows(columns)
    dtype = np.asarray(next(iter(kept.values()))).dtype
    tables = (Rows.of({n: v[rows] for n, v in of.items()}, dtype) for of in (columns, kept))
    metrics, status = jax.device_get(_verdict(machine, *tables, np.asarray(done)[rows]))
    return {n: v[:count] for n, v in (metrics.tree | {"status": status}).items()}


@jax.jit
def _verdict(machine: Rig, columns: Rows, kept: Rows, done):
    """`verdict`, in tables."""
    out = verdict(machine, columns.tree, kept.tree, done)
    status = out.pop("status")
    return Rows.of(out), status


def _rows(columns: Mapping[str, np.ndarray]) -> tuple[int, np.ndarray]:
    """The number of designs, and which design stands in each row of the table once it is filled up."""
    count = len(next(iter(columns.values())))
    filled = SHORT if count <= SHORT else -(-count // CHUNK) * CHUNK
    return count, np.resize(np.arange(count), filled)
