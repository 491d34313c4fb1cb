"""Run each design of a table to its periodic state, and report a status per design.

A design is run cycle by cycle from rest until its metrics no longer change. The cycles go through the loop engine, all
designs that are not yet periodic side by side; convergence is tested after each cycle.
"""

import dataclasses
import functools
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.compiler.engines import compile_loop
from edhas_jax.compiler.loop_engine import LoopBody
from edhas_jax.core import runtime
from edhas_jax.design.batch.cycle_metrics import cycle_change, cycle_metrics, cycle_step, empty_sums
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.loop_cache import cached_loop, key_of
from edhas_jax.simulation.validity import status_of

# tables are filled up to one of two lengths, so that another number of designs compiles nothing
SHORT_TABLE, LONG_TABLE = 1024, 4096
GPU_TABLE = 32 * LONG_TABLE  # of a GPU, which takes tens of thousands of designs at a time
# vectors of designs interleaved: four hide the latency of results, two leave no core idle where few designs are left
MANY_VECTORS, FEW_VECTORS = 4, 2
CHANGE = "_change"  # among the metrics: their change in the last cycle


class BatchState(NamedTuple):
    """Where the designs of a batch stand; every leaf has the shape (designs,).

    Attributes:
        y: the state at the end of the last cycle.
        metrics: those of the last cycle that counts.
        cycles: number of that cycle.
        done: no further cycle is wanted.
    """

    y: dict[str, Any]
    metrics: dict[str, Any]
    cycles: Any
    done: Any


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class StackedLeaves:
    """The leaves of a pytree, all of one shape, as the rows of one `table`.

    XLA takes longer to be handed a hundred arrays than to test a thousand designs for convergence.
    """

    table: Any
    structure: Any = dataclasses.field(metadata={"static": True})

    @classmethod
    def of(cls, tree: Any, dtype=None) -> "StackedLeaves":
        """The rows of a `tree`: a NumPy array of the type `dtype`, or without one an array of JAX."""
        leaves, structure = jax.tree.flatten(tree)
        return cls(jnp.stack(leaves) if dtype is None else np.array(leaves, dtype), structure)

    @property
    def tree(self) -> Any:
        """The pytree whose leaves are the rows."""
        return jax.tree.unflatten(self.structure, list(self.table))


def run_to_periodic(
    machine: Rig, columns: Mapping[str, np.ndarray], steps: int, tolerance, max_cycles: int, soft: bool,
    start: BatchState | None = None, many_lanes: bool = False,
) -> BatchState:  # fmt: skip
    """Run designs until each is periodic, or `max_cycles` are over.

    A design that is periodic keeps the metrics of the cycle in which it was found to be. The result of a design depends
    on it alone, not on the number of cores or on the other designs.

    Args:
        machine: what the designs have in common.
        columns: parameters that differ, by name in SI, each (designs,).
        steps: time steps per cycle.
        tolerance: relative change over two cycles below which a design is periodic; its type is the precision.
        max_cycles: most cycles of a design.
        soft: whether the first cycle is a ramp.
        start: where the designs begin; None: at rest.
        many_lanes: whether they are part of a task with so many designs that a GPU is faster (`engines.many_lanes`).
    """
    loop = cycle_loop(machine, columns, tolerance.dtype, many_lanes)
    count, rows = _filled_rows(columns)
    start = None if start is None else jax.tree.map(lambda leaf: leaf[rows], start)
    columns = {n: v[rows] for n, v in columns.items()}
    state = loop.run(machine, columns, count, steps, tolerance, max_cycles, soft, start)
    return jax.tree.map(lambda leaf: leaf[:count], state)


def cycle_loop(machine: Rig, names: Collection[str], dtype, many_lanes: bool) -> "CycleLoop":
    """The loop that runs designs with these parameters; arguments as of `run_to_periodic`."""
    return cached_loop(CycleLoop, machine, tuple(sorted(names)), np.dtype(dtype), many_lanes, dtype=dtype)


class CycleLoop:
    """Whole cycles of many designs; `machine` and the `varied` parameters count only by their structure.

    Attributes:
        engine: name of the engine that runs them.
    """

    def __init__(self, machine: Rig, varied: Sequence[str], dtype, many_lanes: bool = False):
        def step(n, carry, values, uniform):
            base, steps, ramp = uniform
            return cycle_step(set_parameters(base, values), *carry, n, steps, ramp > 0.5)

        sums = empty_sums(machine, dtype)
        self._sums = StackedLeaves.of(sums, dtype)
        carry = {n: 0.0 for n in machine.initial_state()}, sums
        self._carry = jax.tree.structure(carry)
        lane, key = dict.fromkeys(varied, 0.0), key_of(machine, "cycle", tuple(varied))
        given = machine, 0.0, 0.0
        body = LoopBody(step, dtype, carry, lane, given, key=key, vectors=FEW_VECTORS, many_lanes=many_lanes)
        self._few = compile_loop(body)
        self.engine = self._few.engine
        self._many = functools.cache(lambda: self._few.with_vectors(MANY_VECTORS))

    def run(
        self, machine: Rig, columns: dict[str, np.ndarray], count: int, steps: int, tolerance, max_cycles: int,
        soft: bool, start: BatchState | None,
    ) -> BatchState:  # fmt: skip
        """See `run_to_periodic`; only the first `count` designs are run, the others fill the table up."""
        dtype = tolerance.dtype
        table = StackedLeaves.of(columns, dtype)
        given = StackedLeaves.of(machine, dtype), table
        live = np.arange(table.table.shape[1]) < count
        if start is None:
            y, *progress = _at_rest(*given, live)
        else:
            y = StackedLeaves.of(start.y, dtype)
            progress = [StackedLeaves.of(start.metrics, dtype), start.cycles, ~live]
        states, done = np.array(y.table), ~live
        sums = np.empty((len(self._sums.table), live.size), dtype)
        for number in range(max_cycles):
            rows = np.flatnonzero(~done)
            if not len(rows):
                break
            before = jax.tree.unflatten(self._carry, [*states[:, rows], *self._sums.table])
            values = jax.tree.unflatten(table.structure, list(table.table[:, rows]))
            uniform = machine, steps, float(soft and number == 0)
            # the numbers of a design are the same in both, to the bit
            loop = self._few if len(rows) <= runtime.cores() * self._few.lanes else self._many()
            after = np.array(jax.tree.leaves(loop(before, values, uniform, 0, steps, runtime.cores())))
            # finished designs keep their state; their sums are not read
            states[:, rows], sums[:, rows] = after[: len(states)], after[len(states) :]
            ended = dataclasses.replace(self._sums, table=sums)
            progress = _update_convergence(*given, *progress, ended, number, steps, tolerance)
            done = np.asarray(progress[-1])
        metrics, *rest = jax.device_get(progress)
        return BatchState(dataclasses.replace(y, table=states).tree, metrics.tree, *rest)


@runtime.jit
def _at_rest(machine: StackedLeaves, columns: StackedLeaves, live):
    """State, metrics, cycles and `done` of designs that have not begun; those that are not `live` only fill up."""
    dtype = columns.table.dtype

    def one(values):
        m = set_parameters(machine.tree, values)
        y = {n: jnp.asarray(v, dtype) for n, v in m.initial_state().items()}
        unknown = jnp.ones((), dtype)
        sums = {n: jnp.asarray(v) for n, v in empty_sums(m, dtype).items()}
        return y, cycle_metrics(m, sums, unknown) | {CHANGE: unknown, "residual": unknown}

    y, metrics = jax.vmap(one)(columns.tree)
    return StackedLeaves.of(y), StackedLeaves.of(metrics), jnp.zeros_like(live, int), ~live


@runtime.jit
def _update_convergence(
    machine: StackedLeaves, columns: StackedLeaves, metrics: StackedLeaves, cycles, done, sums: StackedLeaves, number,
    steps, tolerance,
):  # fmt: skip
    """Metrics, cycles and `done` after the cycle `number`, of `steps` steps, that ended with these sums.

    The residual is the larger of the last two changes: a single one may be small where a slow drift turns around.
    """
    share = (jnp.ones((), tolerance.dtype) / steps).astype(tolerance.dtype)
    kept = metrics.tree
    new = jax.vmap(lambda v, s: cycle_metrics(set_parameters(machine.tree, v), s, share))(columns.tree, sums.tree)
    change = cycle_change(new, kept)
    residual = jnp.where(number < 2, jnp.ones_like(change), jnp.maximum(change, kept[CHANGE]))
    new = new | {CHANGE: change, "residual": residual}
    kept = {n: jnp.where(done, kept[n], new[n]) for n in kept}
    cycles = jnp.where(done, cycles, number + 1)
    finite = jnp.isfinite(kept["mean_electrical_power"])
    return StackedLeaves.of(kept), cycles, done | (new["residual"] <= tolerance) | ~finite


def metrics_with_status(
    machine: Rig, columns: Mapping[str, np.ndarray], metrics: Mapping[str, np.ndarray], converged
) -> dict[str, Any]:
    """The metrics of designs with their `status` (designs,), an integer of `Status`.

    Args:
        machine: what the designs have in common.
        columns: parameters that differ, by name in SI, each (designs,).
        metrics: those of a `BatchState`.
        converged: (designs,) whether each design is periodic.
    """
    count, rows = _filled_rows(columns)
    dtype = np.asarray(next(iter(metrics.values()))).dtype
    tables = (StackedLeaves.of({n: v[rows] for n, v in of.items()}, dtype) for of in (columns, metrics))
    table, status = jax.device_get(_status(machine, *tables, np.asarray(converged)[rows]))
    return {n: v[:count] for n, v in (table.tree | {"status": status}).items()}


@runtime.jit
def _status(machine: Rig, columns: StackedLeaves, metrics: StackedLeaves, converged):
    def one(values, out, ok):
        return status_of(set_parameters(machine, values), out, ok)

    status = jax.vmap(one)(columns.tree, metrics.tree, converged)
    return StackedLeaves.of({n: v for n, v in metrics.tree.items() if not n.startswith("_")}), status


def _filled_rows(columns: Mapping[str, np.ndarray]) -> tuple[int, np.ndarray]:
    """The number of designs, and which design stands in each row of the table once it is filled up."""
    count = len(next(iter(columns.values())))
    filled = SHORT_TABLE if count <= SHORT_TABLE else -(-count // LONG_TABLE) * LONG_TABLE
    return count, np.resize(np.arange(count), filled)
