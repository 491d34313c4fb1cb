"""Runs side by side as machine code: the march of many lanes and their signals, with one derivative per lane."""

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.compiler.native_loop import Loop
from edhas_jax.compiler.threads import each
from edhas_jax.core import runtime, structs
from edhas_jax.machine.components.set_points import Recorded, RecordedInterval
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.integrator import evaluate_signals, step
from edhas_jax.simulation.native_loop_cache import key_of, loop_of


class MarchLoop:
    """The march of lanes of one kind of machine with the parameters `varied`, and its signals `watch`.

    With `seeded`, everything is followed by its derivative along a change of the parameters that each lane has of its
    own. `machine` counts only by its structure; where its set point is a `RecordedInterval`, every sample has its own.

    Raises:
        Untranslatable: the machine uses an operation that has no machine code here.
    """

    def __init__(self, machine: Rig, varied: Sequence[str], watch: Sequence[str], seeded: bool, dtype):
        self._dtype, self._watch = np.dtype(dtype), tuple(watch)
        names, stretch = dict.fromkeys(varied, 0.0), _fed(machine)
        self._start = {n: 0.0 for n in machine.initial_state()}
        cache, keyed = runtime.cache_folder(), functools.partial(key_of, machine, varied, watch, seeded, self._dtype)

        def twice(table):
            return (table, table) if seeded else (table,)

        def along(f, primals, tangents):
            return jax.jvp(f, primals, tangents) if seeded else (f(*primals),)

        def rest(n, carry, lane, uniform):
            (values, *seeds), (base, _) = lane, uniform

            def one(values):
                zero = jnp.zeros((), self._dtype)
                return {n: zero + v for n, v in set_parameters(base, values).initial_state().items()}

            return along(one, (values,), (*seeds,))

        def go(n, carry, lane, uniform, fed=None):
            (values, *seeds), (y, *dy), (base, h) = lane, carry, uniform

            def one(values, y):
                return step(set_parameters(_with(base, fed), values), y, n * h, h)[0]

            return along(one, (values, y), (*seeds, *dy))

        def see(n, carry, lane, uniform):
            (values, *seeds), (y, *dy), t, fed = lane
            base, h = uniform

            def one(values, y):
                seen = evaluate_signals(set_parameters(_with(base, fed), values), y, t, h)
                return {s: seen[s] for s in self._watch}

            return along(one, (values, y), (*seeds, *dy))

        state, signals, given = twice(self._start), twice(dict.fromkeys(self._watch, 0.0)), (machine, 0.0)
        lane = twice(names), state, 0.0, stretch
        self._rest = Loop(rest, dtype, state, twice(names), given, cache, keyed("rest"))
        self._go = Loop(go, dtype, state, twice(names), given, cache, keyed("go"), fed=stretch)
        self._see = Loop(see, dtype, signals, lane, given, cache, keyed("see"))

    def march(
        self, machine: Rig, lanes: tuple[dict[str, np.ndarray], ...], step_size: float, per_sample: int,
        lengths: np.ndarray,
    ) -> tuple[dict[str, np.ndarray], ...]:  # fmt: skip
        """Signals (samples, lanes), and with seeds their derivatives; NaN beyond the `lengths` of the lanes.

        `lanes` are the parameters and, if seeded, their changes, each (lanes,).
        """
        out = tuple({s: np.full((lengths.max(), len(lengths)), np.nan) for s in self._watch} for _ in lanes)
        stretches = None
        if isinstance(machine.reference, Recorded):
            stretches = RecordedInterval.split(machine.reference, int(lengths.max()))
            machine = structs.replace(machine, reference=_FIRST)
        # long runs first, and runs of one length together
        order = np.argsort(-lengths, kind="stable")
        blocks = [order[first : first + self._go.lanes] for first in range(0, len(order), self._go.lanes)]

        def work(rows: np.ndarray) -> None:
            here = tuple({n: v[rows] for n, v in part.items()} for part in lanes)
            samples = int(lengths[rows].max())
            uniform, empty = (machine, step_size), tuple({n: np.zeros(len(rows)) for n in self._start} for _ in lanes)
            begin = self._rest(empty, here, uniform, 0, 1)
            fed = jax.tree.map(lambda leaf: np.broadcast_to(leaf, lengths.max())[:samples], stretches)
            kept = self._go.march(begin, here, uniform, 0, per_sample, samples, fed=fed).kept
            flat = jax.tree.map(np.ravel, kept)
            wide = tuple({n: np.tile(v, samples) for n, v in part.items()} for part in here)
            time = np.repeat(np.arange(samples) * (per_sample * step_size), len(rows))
            fed = jax.tree.map(lambda leaf: np.repeat(leaf, len(rows)), fed)
            empty = tuple({s: np.zeros(len(time)) for s in self._watch} for _ in lanes)
            for whole, part in zip(out, self._see(empty, (wide, flat, time, fed), uniform, 0, 1), strict=True):
                for s, column in part.items():
                    whole[s][:samples, rows] = column.reshape(samples, len(rows))

        each(work, blocks, runtime.cores())
        for column in (column for part in out for column in part.values()):
            column[np.arange(len(column))[:, None] >= lengths] = np.nan
        return out


_FIRST = RecordedInterval(interval=1.0, index=0.0, value=0.0, slope=0.0, quadratic=0.0, cubic=0.0)


def _fed(machine: Rig) -> RecordedInterval | None:
    return machine.reference if isinstance(machine.reference, RecordedInterval) else None


def _with(machine: Rig, stretch: RecordedInterval | None) -> Rig:
    return machine if stretch is None else structs.replace(machine, reference=stretch)


def march_loop(
    machine: Rig, varied: Sequence[str], watch: Sequence[str], seeded: bool, dtype, interval: float
) -> MarchLoop | None:
    """The loop for machines of this structure, made once; None where XLA has to do it.

    A recorded set point is followed where its samples are as far apart as those of the march, `interval` [s].
    """
    recorded = machine.reference
    if isinstance(recorded, Recorded):
        if float(recorded.start) != 0.0 or abs(float(recorded.interval) / interval - 1.0) > 1e-9:
            return None
        machine = structs.replace(machine, reference=_FIRST)
    if any(np.ndim(leaf) for leaf in jax.tree.leaves(machine)):
        return None
    return loop_of(MarchLoop, machine, tuple(varied), tuple(watch), seeded, np.dtype(dtype), dtype=dtype)
