"""The cycles of a batch on a CPU, as machine code of its own; `edhas_jax.cycle` runs the same ones under XLA."""

import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax import backend
from edhas_jax.cycle import Lanes, begin, cycle_step, empty_sums, judged, measured
from edhas_jax.loop_cache import loop_of
from edhas_jax.native import Loop
from edhas_jax.parameters import set_parameters
from edhas_jax.system import Rig

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

        self._sums = {n: np.asarray(v, dtype) for n, v in empty_sums(machine, dtype).items()}
        carry = {n: 0.0 for n in machine.start()}, self._sums
        lane, uniform = dict.fromkeys(varied, 0.0), (machine, 0.0, 0.0)

        def loop(vectors: int) -> Loop:
            return Loop(body, dtype, carry, lane, uniform, backend.cache_folder(), vectors=vectors)

        self._many, self._few = loop(MANY), functools.cache(lambda: loop(FEW))

    def run_cycles(
        self, machine: Rig, columns: dict[str, np.ndarray], count: int, steps: int, tolerance, max_cycles: int,
        soft: bool, start: Lanes | None = None,
    ) -> Lanes:  # fmt: skip
        """Run the first `count` designs, at `steps` steps per cycle, until each is periodic or `max_cycles` are over.

        They begin at rest, or where they are at the `start`. A design that is periodic keeps the metrics of the cycle
        in which it was found to be.
        """
        size = len(next(iter(columns.values())))
        live = np.arange(size) < count
        if start is None:
            lanes = jax.device_get(_begin(machine, columns, live, tolerance.dtype))
        else:
            lanes = start._replace(done=~live)
        for number in range(max_cycles):
            rows = np.flatnonzero(~lanes.done)
            if not len(rows):
                break
            start = {n: v[rows] for n, v in lanes.y.items()}, {n: np.full(len(rows), v) for n, v in self._sums.items()}
            values = {n: v[rows] for n, v in columns.items()}
            uniform = machine, steps, float(soft and number == 0)
            # the numbers of a design are the same in both, to the bit
            loop = self._few() if 2 * len(rows) <= backend.cores() * self._many.lanes else self._many
            after = loop(start, values, uniform, 0, steps, backend.cores())
            y = {n: _spread(v, rows, lanes.y[n]) for n, v in after[0].items()}
            # the sums of designs that are done are never looked at
            sums = {n: _spread(v, rows, np.ones(size, v.dtype)) for n, v in after[1].items()}
            lanes = jax.device_get(_judged(machine, columns, lanes, y, sums, number, steps, tolerance))
        return lanes


def _spread(values: np.ndarray, rows: np.ndarray, before: np.ndarray) -> np.ndarray:
    """`values` at `rows`, elsewhere what stood there `before`."""
    out = np.array(before)
    out[rows] = values
    return out


_begin = jax.jit(begin, static_argnums=3)


@jax.jit
def _judged(machine: Rig, columns: dict[str, Any], lanes: Lanes, y, sums, number, steps, tolerance) -> Lanes:
    """`judged` for the cycle `number`, of `steps` steps, that ended with the states `y` and the sums `sums`."""
    share = jnp.ones((), tolerance.dtype) / steps

    def of_one(values, sums):
        return measured(set_parameters(machine, values), sums, share.astype(tolerance.dtype))

    return judged(lanes, y, jax.vmap(of_one)(columns, sums), number, tolerance)


def cycle_loop(machine: Rig, varied: Sequence[str], dtype) -> CycleLoop | None:
    """The loop for machines of this structure, made once; None where XLA has to do it."""
    return loop_of(CycleLoop, machine, tuple(varied), np.dtype(dtype), dtype=dtype)
