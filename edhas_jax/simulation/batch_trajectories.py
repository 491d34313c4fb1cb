"""Many runs side by side, each a lane: their signals at the samples, and derivatives along one direction per lane."""

import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from queue import SimpleQueue
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.core import runtime
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.integrator import evaluate_signals
from edhas_jax.simulation.integrator import step as step_of
from edhas_jax.simulation.native_trajectories import march_loop
from edhas_jax.simulation.run import Precision

WIDTH = 16  # lanes of one program: the last block of a call is filled up to it, so fewer waste less
STRETCH = 256  # samples of one program; a longer run calls it again, and compiles nothing


class Traces(NamedTuple):
    """Signals at the samples and their derivatives along the seeds, (samples, lanes) in SI by signal name.

    Beyond the end of a lane, and after it has left the range of finite numbers, the entries are NaN.
    """

    values: dict[str, np.ndarray]
    slopes: dict[str, np.ndarray] | None


class _Block(NamedTuple):
    """Lanes that are marched together: where they stand in the call, their parameters, seeds and samples."""

    lanes: np.ndarray
    values: dict[str, np.ndarray]
    seeds: dict[str, np.ndarray] | None
    samples: int


def march_lanes(
    machine: Rig,
    values: Mapping[str, np.ndarray],
    seeds: Mapping[str, np.ndarray] | None,
    step: float,
    per_sample: int,
    samples: int | np.ndarray,
    watch: Sequence[str],
    precision: Precision = Precision.FLOAT64,
) -> Traces:
    """March every lane from rest and sample the signals of `watch` after each `per_sample` steps of `step` [s].

    `values` are parameters in SI by name, each (lanes,); the others are those of `machine`. With `seeds`, a change of
    the same parameters for each lane, `slopes` holds d(signal)/dε of values + ε·seeds. `samples` may differ from lane
    to lane. Changing any number compiles nothing anew; another set of names in `values` or `watch` does.
    """
    dtype = np.dtype(precision.value)
    count = len(next(iter(values.values())))
    lengths = np.broadcast_to(np.asarray(samples, int), (count,))
    numbers = jax.tree.map(lambda leaf: np.asarray(leaf, dtype), machine)
    columns = {n: np.asarray(v, dtype) for n, v in values.items()}
    along = None if seeds is None else {n: np.asarray(seeds.get(n, np.zeros(count)), dtype) for n in columns}
    loop = march_loop(numbers, tuple(columns), watch, seeds is not None, dtype, per_sample * step)
    if loop is not None:
        signals = loop.march(numbers, (columns,) if along is None else (columns, along), step, per_sample, lengths)
        return Traces(*signals, *[None] * (seeds is None))
    shape = lengths.max(), count
    out = {n: np.full(shape, np.nan) for n in watch}
    slopes = None if seeds is None else {n: np.full(shape, np.nan) for n in watch}

    blocks: SimpleQueue = SimpleQueue()
    order = np.argsort(-lengths, kind="stable")
    for first in range(0, count, WIDTH):
        lanes = order[first : first + WIDTH]
        filled = np.resize(lanes, WIDTH)
        seeded = None if along is None else {n: v[filled] for n, v in along.items()}
        blocks.put(_Block(lanes, {n: v[filled] for n, v in columns.items()}, seeded, int(lengths[lanes].max())))

    grid = dtype.type(step), int(per_sample), tuple(watch)
    stop = threading.Event()

    def work(device):
        # placed by hand: a default device would be traced anew for each
        placed = jax.device_put(numbers, device)
        while not blocks.empty() and not stop.is_set():
            block = blocks.get()
            inputs = placed, *jax.device_put((block.values, block.seeds), device)
            _march_block(inputs, block, grid, out, slopes, stop)

    devices = jax.local_devices()[: min(runtime.cores(), blocks.qsize())]
    with ThreadPoolExecutor(len(devices)) as pool:
        try:
            for done in [pool.submit(work, device) for device in devices]:
                done.result()
        finally:
            stop.set()
    for column in (*out.values(), *(slopes or {}).values()):
        column[np.arange(len(column))[:, None] >= lengths] = np.nan
    return Traces(out, slopes)


def _march_block(inputs, block: _Block, grid, out, slopes, stop) -> None:
    """March one block, stretch by stretch, and put its samples into `out` and `slopes`."""
    h, per_sample, watch = grid
    here = _start(*inputs)
    for first in range(0, block.samples, STRETCH):
        if stop.is_set():
            return
        here, rows = _stretch(*inputs, here, first * per_sample, h, per_sample, watch)
        rows, slope_rows = jax.device_get(rows)
        last = min(first + STRETCH, block.samples)
        for n in watch:
            out[n][first:last, block.lanes] = rows[n][: last - first, : len(block.lanes)]
            if slopes is not None:
                slopes[n][first:last, block.lanes] = slope_rows[n][: last - first, : len(block.lanes)]


@jax.jit
def _start(machine: Rig, values, seeds):
    """State and its tangent of every lane at rest."""

    def one(values):
        m = set_parameters(machine, values)
        dtype = jnp.result_type(next(iter(values.values())))
        return {n: jnp.asarray(v, dtype) for n, v in m.initial_state().items()}

    if seeds is None:
        return jax.vmap(one)(values), None
    return jax.vmap(lambda v, s: jax.jvp(one, (v,), (s,)))(values, seeds)


@partial(jax.jit, static_argnames="watch")
def _stretch(machine: Rig, values, seeds, here, first_step, h, per_sample, watch: tuple[str, ...]):
    """`STRETCH` samples of every lane from state `here`; the first is taken where the lanes stand."""

    def one(values: dict[str, Any], y: dict[str, Any]):
        m = set_parameters(machine, values)

        def sample(carry, _):
            y, number = carry
            seen = evaluate_signals(m, y, number.astype(h.dtype) * h, h)

            def go(k, y):
                return step_of(m, y, (number + k).astype(h.dtype) * h, h)[0]

            y = jax.lax.fori_loop(0, per_sample, go, y)
            return (y, number + per_sample), {n: seen[n] for n in watch}

        (y, _), rows = jax.lax.scan(sample, (y, jnp.asarray(first_step)), length=STRETCH)
        return y, rows

    y, dy = here
    if seeds is None:
        y, rows = jax.vmap(one, out_axes=(0, 1))(values, y)
        return (y, None), (rows, None)

    def both(values, y, seeds, dy):
        return jax.jvp(one, (values, y), (seeds, dy))

    (y, rows), (dy, slopes) = jax.vmap(both, out_axes=((0, 1), (0, 1)))(values, y, seeds, dy)
    return (y, dy), (rows, slopes)
