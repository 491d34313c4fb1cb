"""The cycles of a batch on a CPU, as machine code of its own; `edhas_jax.design.batch.cycle` runs the same ones under
XLA."""

import dataclasses
import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.compiler.native_loop import Loop
from edhas_jax.core import runtime
from edhas_jax.design.batch.cycle import Lanes, begin, cycle_step, empty_sums, judged, measured
from edhas_jax.design.batch.rows import Rows
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.native_loop_cache import key_of, loop_of

# vectors of designs side by side: fewer wait for their own results, and more leave cores idle where few are left
MANY, FEW = 4, 2


class CycleLoop:
    """Whole cycles of many designs of one kind of machine.

    `machine` and the `varied` parameters count only by their structure.

    Raises:
        Untranslatable: the machine uses an operation that has no machine code here.
    """

    def __init__(self, machine: Rig, varied: Sequence[str], dtype):
        def body(n, carry, values, uniform):
            base, steps, ramp = uniform
            return cycle_step(set_parameters(base, values), *carry, n, steps, ramp > 0.5)

        sums = {n: np.asarray(v, dtype) for n, v in empty_sums(machine, dtype).items()}
        self._sums = Rows.of(sums, dtype)
        carry = {n: 0.0 for n in machine.initial_state()}, sums
        self._carry = jax.tree.structure(carry)
        lane, uniform = dict.fromkeys(varied, 0.0), (machine, 0.0, 0.0)

        def loop(vectors: int) -> Loop:
            key = key_of(machine, "cycle", tuple(varied), np.dtype(dtype), vectors)
            return Loop(body, dtype, carry, lane, uniform, runtime.cache_folder(), key, vectors=vectors)

        self._many, self._few = loop(MANY), functools.cache(lambda: loop(FEW))

    def run_cycles(
        self, machine: Rig, columns: dict[str, np.ndarray], count: int, steps: int, tolerance, max_cycles: int,
        soft: bool, start: Lanes | None = None,
    ) -> Lanes:  # fmt: skip
        """Run the first `count` designs, at `steps` steps per cycle, until each is periodic or `max_cycles` are over.

        They begin at rest, or where they are at the `start`. A design that is periodic keeps the metrics of the cycle
        in which it was found to be.
        """
        dtype = tolerance.dtype
        table = Rows.of(columns, dtype)
        given = Rows.of(machine, dtype), table
        live = np.arange(table.table.shape[1]) < count
        if start is None:
            y, *lanes = _begin(*given, live)
        else:
            y, *lanes = Rows.of(start.y, dtype), Rows.of(start.kept, dtype), start.cycles, ~live
        states, done = np.array(y.table), ~live
        sums = np.empty((len(self._sums.table), live.size), dtype)
        for number in range(max_cycles):
            rows = np.flatnonzero(~done)
            if not len(rows):
                break
            here = [*states[:, rows], *self._sums.table]
            values = jax.tree.unflatten(table.structure, list(table.table[:, rows]))
            uniform = machine, steps, float(soft and number == 0)
            # the numbers of a design are the same in both, to the bit
            loop = self._few() if 2 * len(rows) <= runtime.cores() * self._many.lanes else self._many
            after = loop(jax.tree.unflatten(self._carry, here), values, uniform, 0, steps, runtime.cores())
            # those of designs that are done are left as they are; their sums are never looked at
            after = np.array(jax.tree.leaves(after))
            states[:, rows], sums[:, rows] = after[: len(states)], after[len(states) :]
            ended = dataclasses.replace(self._sums, table=sums)
            lanes = _judged(*given, *lanes, ended, number, steps, tolerance)
            done = np.asarray(lanes[-1])
        kept, *rest = jax.device_get(lanes)
        return Lanes(dataclasses.replace(y, table=states).tree, kept.tree, *rest)


@jax.jit
def _begin(machine: Rows, columns: Rows, live):
    """`begin`, in tables."""
    lanes = begin(machine.tree, columns.tree, live, columns.table.dtype)
    return lanes._replace(y=Rows.of(lanes.y), kept=Rows.of(lanes.kept))


@jax.jit
def _judged(machine: Rows, columns: Rows, kept: Rows, cycles, done, sums: Rows, number, steps, tolerance):
    """`judged` for the cycle `number`, of `steps` steps, that ended with the `sums`; in tables, without the states."""
    share = (jnp.ones((), tolerance.dtype) / steps).astype(tolerance.dtype)

    def of_one(values, sums):
        return measured(set_parameters(machine.tree, values), sums, share)

    new = jax.vmap(of_one)(columns.tree, sums.tree)
    lanes = judged(Lanes(None, kept.tree, cycles, done), None, new, number, tolerance)
    return Rows.of(lanes.kept), lanes.cycles, lanes.done


def cycle_loop(machine: Rig, varied: Sequence[str], dtype) -> CycleLoop | None:
    """The loop for machines of this structure, made once; None where XLA has to do it."""
    return loop_of(CycleLoop, machine, tuple(varied), np.dtype(dtype), dtype=dtype)
