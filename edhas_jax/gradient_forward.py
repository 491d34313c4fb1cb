"""Forward mode: each pair of a design and a parameter is a lane that carries its tangent along, cycle by cycle."""

from collections.abc import Callable, Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax import backend
from edhas_jax.cycle import cycle_step, empty_sums, measured, verdict
from edhas_jax.gradient_blocks import forward_blocks
from edhas_jax.gradient_plan import Derivatives, GradientSettings, settled
from edhas_jax.loop_cache import loop_of
from edhas_jax.native import Loop
from edhas_jax.parameters import set_parameters
from edhas_jax.system import Rig


def forward(
    machine: Rig,
    columns: Mapping[str, np.ndarray],
    names: Sequence[str],
    metrics: Sequence[str],
    settings: GradientSettings,
    on_cycle: Callable[[float], None] | None = None,
) -> Derivatives:
    """Metrics of designs and their derivatives by the parameters `names`, all of which are among the `columns` (SI).

    `on_cycle(share)` is called with the share of the work that is done.
    """
    columns = {n: np.asarray(column, float) for n, column in columns.items()}
    base = jax.tree.map(lambda leaf: np.asarray(leaf, float), machine)
    count = len(next(iter(columns.values())))
    loop = loop_of(TangentLoop, base, tuple(columns))
    if loop is None:
        return forward_blocks(machine, columns, names, metrics, settings, on_cycle)
    values = {n: np.repeat(column, len(names)) for n, column in columns.items()}
    seeds = {n: np.tile([float(n == other) for other in names], count) for n in columns}
    scales = np.abs(np.stack([columns[n] for n in names], axis=1)).ravel()
    found = loop.run(base, values, seeds, metrics, scales, settings, on_cycle)
    kept, slopes, done, cycles = found
    first = slice(None, None, len(names))
    out = jax.device_get(
        _verdict(base, columns, {n: v[first] for n, v in kept.items()}, done.reshape(count, -1).all(axis=1))
    )
    slopes = {n: slopes[n].reshape(count, len(names)) for n in metrics}
    return Derivatives({n: kept[n][first] for n in metrics}, slopes, out["status"].astype(float), cycles)


class TangentLoop:
    """Whole cycles of many designs with a tangent each, as machine code.

    Raises:
        Untranslatable: the machine uses an operation that has no machine code here.
    """

    def __init__(self, machine: Rig, varied: Sequence[str]):
        def body(n, carry, lane, uniform):
            (state, moved), (values, seeds), (base, steps, ramp) = carry, lane, uniform

            def step(values, state):
                return cycle_step(set_parameters(base, values), *state, n, steps, ramp > 0.5)

            return jax.jvp(step, (values, state), (seeds, moved))

        self._sums = {n: np.asarray(v, float) for n, v in empty_sums(machine, float).items()}
        state = dict.fromkeys(machine.start(), 0.0), dict.fromkeys(self._sums, 0.0)
        lane = (dict.fromkeys(varied, 0.0),) * 2
        self._loop = Loop(body, float, (state, state), lane, (machine, 0.0, 0.0), backend.cache_folder())

    def run(self, machine: Rig, values, seeds, metrics, scales, settings: GradientSettings, on_cycle):
        """(metrics, their slopes, settled, cycles) of lanes, each until it has settled."""
        count = len(scales)
        y, moved_y = jax.device_get(_start(machine, values, seeds))
        kept, slopes, done = {}, {}, np.zeros(count, bool)
        for number in range(settings.max_cycles):
            rows = np.flatnonzero(~done)
            state = _at(y, rows), {n: np.full(len(rows), v) for n, v in self._sums.items()}
            moved = _at(moved_y, rows), {n: np.zeros(len(rows)) for n in self._sums}
            lane = _at(values, rows), _at(seeds, rows)
            uniform = machine, float(settings.steps_per_cycle), float(number == 0)
            (end, sums), moved = self._loop((state, moved), lane, uniform, 0, settings.steps_per_cycle, backend.cores())
            new, slope = jax.device_get(_measured(machine, *lane, sums, moved[1], 1.0 / settings.steps_per_cycle))
            before = (_at(kept, rows), _at(slopes, rows)) if number else None
            now = {n: new[n] for n in metrics}, {n: slope[n] for n in metrics}
            still = ~settled(*now, before, scales[rows], settings.tolerance) | (number + 1 < settings.min_cycles)
            finite = np.isfinite(new["mean_electrical_power"])
            for table, part in ((kept, new), (slopes, slope), (y, end), (moved_y, moved[0])):
                for n, column in part.items():
                    table.setdefault(n, np.full(count, np.nan))
                    table[n] = _put(table[n], rows, column)
            done[rows] = ~still | ~finite
            if on_cycle is not None:
                on_cycle(1.0 if done.all() else (number + 1) / settings.max_cycles)
            if done.all():
                break
        return kept | {"residual": np.where(done, 0.0, 1.0)}, slopes, done, number + 1


def _at(columns: dict[str, np.ndarray], rows: np.ndarray) -> dict[str, np.ndarray]:
    return {n: column[rows] for n, column in columns.items()}


def _put(column: np.ndarray, rows: np.ndarray, part: np.ndarray) -> np.ndarray:
    column = np.array(column, float)
    column[rows] = part
    return column


@jax.jit
def _start(machine, values, seeds):
    """The states at rest and their tangents."""

    def one(values, seeds):
        def start(values):
            return {n: jnp.asarray(v, float) for n, v in set_parameters(machine, values).start().items()}

        return jax.jvp(start, (values,), (seeds,))

    return jax.vmap(one)(values, seeds)


@jax.jit
def _measured(machine, values, seeds, sums, moved, share):
    """The metrics of a cycle and their tangents."""

    def one(values, seeds, sums, moved):
        def metrics(values, sums):
            return measured(set_parameters(machine, values), sums, share)

        return jax.jvp(metrics, (values, sums), (seeds, moved))

    return jax.vmap(one)(values, seeds, sums, moved)


_verdict = jax.jit(verdict)
