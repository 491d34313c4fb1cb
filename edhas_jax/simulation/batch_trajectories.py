"""Trajectories of many runs side by side: signals at the samples, and derivatives along one direction per run.

Each run is a lane of the loop engine. One loop goes through the time steps and keeps the state at every sample, another
evaluates the signals from the states that were kept.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.compiler.engines import compile_loop, many_lanes
from edhas_jax.compiler.loop_engine import LoopBody
from edhas_jax.compiler.threads import run_threaded
from edhas_jax.core import runtime, structs
from edhas_jax.machine.components.set_points import Recorded, RecordedInterval
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.machine.rigs import Rig, State
from edhas_jax.simulation.integrator import evaluate_signals, step
from edhas_jax.simulation.loop_cache import cached_loop, key_of
from edhas_jax.simulation.run_settings import Precision

BLOCK_BYTES = 2**28  # of the states at all samples of the runs that go through a loop together,
LEAST_BLOCK = 64  # unless these runs are as few as that

Observe = Callable[[Rig, State, Any, Any], dict[str, Any]]  # (machine, state, time, step) → signals by name


class Traces(NamedTuple):
    """Signals at the samples and their derivatives along the seeds, (samples, runs) in SI by signal name.

    Beyond the end of a run, and after it has left the range of finite numbers, the entries are NaN.
    """

    values: dict[str, np.ndarray]
    slopes: dict[str, np.ndarray] | None


class NamedSignals(NamedTuple):
    """The signals of `names`, as `integrator.evaluate_signals` gives them."""

    names: tuple[str, ...]

    def __call__(self, machine: Rig, y: State, t, h) -> dict[str, Any]:
        """The signals of one instant."""
        found = evaluate_signals(machine, y, t, h)
        return {n: found[n] for n in self.names}

    def key(self) -> str:
        """A text for what is observed; programs of equal texts are the same."""
        return str(self)


def simulate_batch(
    machine: Rig,
    values: Mapping[str, np.ndarray],
    seeds: Mapping[str, np.ndarray] | None,
    step_size: float,
    steps_per_sample: int,
    samples: int | np.ndarray,
    signals: Sequence[str] | Observe,
    precision: Precision = Precision.FLOAT64,
    on_gpu: bool | None = None,
) -> Traces:
    """Simulate runs from rest and sample their signals. Changing any number compiles nothing.

    Args:
        machine: what the runs have in common.
        values: parameters that differ from run to run, by name in SI, each (runs,).
        seeds: by the same names a change of each parameter, (runs,); missing ones are zero. With seeds the slopes are
            d(signal)/dε of values + ε·seeds.
        step_size: time step [s].
        steps_per_sample: time steps between two samples.
        samples: number of samples, one for all runs or (runs,); the first is the initial state.
        signals: names of signals, or a function of (machine, state, time, step) that returns scalars by name; it has to
            compare equal to what it is to share compiled code with. If it has a method `key`, whose text stands for all
            that it computes, its machine code is kept on disk.
        precision: of all numbers.
        on_gpu: whether the runs are part of a task with so many that a GPU is faster (`engines.many_lanes`); None:
            these runs are the whole task.
    """
    dtype = np.dtype(precision.value)
    count = len(next(iter(values.values())))
    lengths = np.broadcast_to(np.asarray(samples, int), (count,))
    numbers = jax.tree.map(lambda leaf: np.asarray(leaf, dtype), machine)
    columns = {n: np.asarray(v, dtype) for n, v in values.items()}
    lanes = [columns]
    if seeds is not None:
        lanes.append({n: np.asarray(seeds.get(n, np.zeros(count)), dtype) for n in columns})
    intervals = {}
    for drive in (n for n in _drives_with_intervals(machine) if isinstance(getattr(machine, n), Recorded)):
        found = RecordedInterval.split(getattr(machine, drive), steps_per_sample * step_size, int(lengths.max()))
        if found is not None:
            intervals[drive] = found
            numbers = structs.replace(numbers, **{drive: jax.tree.map(lambda _: dtype.type(1.0), found)})
    observer = signals if callable(signals) else NamedSignals(tuple(signals))
    on_gpu = many_lanes(count, dtype) if on_gpu is None else on_gpu
    choices = tuple(columns), observer, seeds is not None, dtype, on_gpu
    loop = cached_loop(TrajectoryLoop, numbers, *choices, dtype=dtype)
    found = loop.run(numbers, lanes, intervals or None, step_size, steps_per_sample, lengths)
    return Traces(*found, *[None] * (seeds is None))


class TrajectoryLoop:
    """Time steps of runs, and the signals of the states that they pass through.

    With `seeded`, everything is followed by its derivative along a change of the parameters that each run has of its
    own. `machine` counts only by its structure; where a drive is a `RecordedInterval`, every sample has its own.
    """

    def __init__(self, machine: Rig, varied: Sequence[str], observer: Observe, seeded: bool, dtype, many_lanes=False):
        self._dtype = np.dtype(dtype)
        names, interval = dict.fromkeys(varied, 0.0), _intervals_of(machine)
        self._state = {n: 0.0 for n in machine.initial_state()}
        observer_key = observer.key() if hasattr(observer, "key") else None

        def key(what: str) -> str | None:
            return None if observer_key is None else key_of(machine, "trajectory", what, varied, observer_key, seeded)

        def doubled(table):
            return (table, table) if seeded else (table,)

        def with_tangent(f, primals, tangents):
            return jax.jvp(f, primals, tangents) if seeded else (f(*primals),)

        def start(n, carry, lane, uniform):
            (values, *seeds), (base, _) = lane, uniform

            def one(values):
                zero = jnp.zeros((), self._dtype)
                return {n: zero + v for n, v in set_parameters(base, values).initial_state().items()}

            return with_tangent(one, (values,), (*seeds,))

        def advance(n, carry, lane, uniform, here=None):
            (values, *seeds), (y, *dy), (base, h) = lane, carry, uniform

            def one(values, y):
                return step(set_parameters(_with_intervals(base, here), values), y, n * h, h)[0]

            return with_tangent(one, (values, y), (*seeds, *dy))

        def evaluate(n, carry, lane, uniform):
            (values, *seeds), (y, *dy), t, here = lane
            base, h = uniform

            def one(values, y):
                found = observer(set_parameters(_with_intervals(base, here), values), y, t, h)
                return {n: jnp.asarray(v, self._dtype) for n, v in found.items()}

            return with_tangent(one, (values, y), (*seeds, *dy))

        if isinstance(observer, NamedSignals):
            shown = observer.names
        else:
            shown = runtime.eval_shape(lambda m: observer(m, m.initial_state(), 0.0, 1.0), machine)
        self._signals = dict.fromkeys(shown, 0.0)
        state, signals, given = doubled(self._state), doubled(self._signals), (machine, 0.0)
        lane = doubled(names), state, 0.0, interval
        options = {"many_lanes": many_lanes}
        # both take one step only: one vector compiles fastest
        self._start = compile_loop(
            LoopBody(start, dtype, state, doubled(names), given, key=key("start"), vectors=1, **options)
        )
        self._advance = compile_loop(
            LoopBody(advance, dtype, state, doubled(names), given, interval, key=key("advance"), **options)
        )
        self._evaluate = compile_loop(
            LoopBody(evaluate, dtype, signals, lane, given, key=key("evaluate"), vectors=1, **options)
        )

    def run(
        self, machine: Rig, lanes: Sequence[dict[str, np.ndarray]], intervals: Mapping[str, RecordedInterval] | None,
        step_size: float, steps_per_sample: int, lengths: np.ndarray,
    ) -> tuple[dict[str, np.ndarray], ...]:  # fmt: skip
        """Signals (samples, runs), and with seeds their derivatives; NaN beyond the `lengths` of the runs.

        `lanes` are the parameters and, if seeded, their changes, each (runs,); `intervals` the drives that are taken
        interval by interval, as `RecordedInterval.split` gives them.
        """
        most = lengths.max()
        out = tuple({s: np.empty((most, len(lengths))) for s in self._signals} for _ in lanes)
        # long runs first, and runs of one length together
        order = np.argsort(-lengths, kind="stable")
        # a GPU takes so many lanes at a time that their samples might not fit into the memory of this machine
        sample_bytes = int(most) * len(lanes) * len(self._state) * self._dtype.itemsize
        width = min(self._advance.lanes, max(LEAST_BLOCK, BLOCK_BYTES // sample_bytes))
        # columns of one table are copied at once
        tables = [(tuple(part), np.stack(list(part.values()))) for part in lanes]
        blocks = [_as_slice(order[first : first + width]) for first in range(0, len(order), width)]

        def work(rows: np.ndarray | slice) -> None:
            here = tuple(dict(zip(names, table[:, rows], strict=True)) for names, table in tables)
            samples, uniform = int(lengths[rows].max()), (machine, step_size)
            count = len(lengths[rows])
            empty = tuple({n: np.zeros(count) for n in self._state} for _ in lanes)
            begin = self._start(empty, here, uniform, 0, 1)
            given = jax.tree.map(lambda leaf: np.broadcast_to(leaf, most)[:samples], intervals)
            kept = self._advance.run(begin, here, uniform, 0, steps_per_sample, samples, sample_inputs=given).samples
            time = np.arange(samples)[:, None] * (steps_per_sample * step_size)
            given = jax.tree.map(lambda leaf: leaf[:, None], given)
            empty = tuple(dict.fromkeys(self._signals, 0.0) for _ in lanes)
            found = self._evaluate.at_samples(empty, (here, kept, time, given), uniform, (samples, count))
            for whole, part in zip(out, found, strict=True):
                for s, column in part.items():
                    whole[s][:samples, rows] = column

        run_threaded(work, blocks, runtime.cores())
        if lengths.min() < most:
            is_beyond = np.arange(most)[:, None] >= lengths
            for column in (column for part in out for column in part.values()):
                np.copyto(column, np.nan, where=is_beyond)
        return out


def _as_slice(indices: np.ndarray) -> np.ndarray | slice:
    """Consecutive indices as a slice, which copies nothing; others as they are."""
    first, count = int(indices[0]), len(indices)
    return slice(first, first + count) if np.array_equal(indices, np.arange(first, first + count)) else indices


def _drives_with_intervals(machine: Rig) -> list[str]:
    """The drives that a time loop takes interval by interval where they are recorded."""
    return [n for n in dict.fromkeys((*machine.drives, "reference")) if hasattr(machine, n)]


def _intervals_of(machine: Rig) -> dict[str, RecordedInterval] | None:
    drives = {n: getattr(machine, n) for n in _drives_with_intervals(machine)}
    return {n: drive for n, drive in drives.items() if isinstance(drive, RecordedInterval)} or None


def _with_intervals(machine: Rig, intervals: Mapping[str, RecordedInterval] | None) -> Rig:
    return structs.replace(machine, **intervals) if intervals else machine
