"""Forward mode: each pair of a design and a parameter is a lane that carries its tangent through the periodic cycle."""

from collections.abc import Callable, Mapping, Sequence

import jax
import numpy as np

from edhas_jax import backend
from edhas_jax.cycle import cycle_step, empty_sums, measured
from edhas_jax.gradient_blocks import forward_blocks
from edhas_jax.gradient_plan import Derivatives, GradientSettings, periodic, settled, status
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
    lanes = periodic(base, columns, settings)
    loop = loop_of(TangentLoop, base, tuple(columns))
    if loop is None:
        return forward_blocks(base, columns, lanes, names, metrics, settings, on_cycle)
    values, y = ({n: np.repeat(v, len(names)) for n, v in table.items()} for table in (columns, lanes.y))
    seeds = {n: np.tile([float(n == other) for other in names], count) for n in columns}
    scales = np.abs(np.stack([columns[n] for n in names], axis=1)).ravel()
    kept, slopes, done, terms = loop.run(base, values, seeds, y, metrics, scales, settings, on_cycle)
    still = done.reshape(count, -1).all(axis=1)
    return Derivatives(
        {n: kept[n][:: len(names)] for n in metrics}, {n: slopes[n].reshape(count, -1) for n in metrics},
        status(base, columns, lanes, settings, still), lanes.cycles, terms,
    )  # fmt: skip


class TangentLoop:
    """A cycle of many designs with a tangent each, as machine code.

    Raises:
        Untranslatable: the machine uses an operation that has no machine code here.
    """

    def __init__(self, machine: Rig, varied: Sequence[str]):
        def body(n, carry, lane, uniform):
            (state, moved), (values, seeds), (base, steps) = carry, lane, uniform

            def step(values, state):
                return cycle_step(set_parameters(base, values), *state, n, steps, False)

            return jax.jvp(step, (values, state), (seeds, moved))

        self._sums = {n: np.asarray(v, float) for n, v in empty_sums(machine, float).items()}
        state = dict.fromkeys(machine.start(), 0.0), dict.fromkeys(self._sums, 0.0)
        lane = (dict.fromkeys(varied, 0.0),) * 2
        self._loop = Loop(body, float, (state, state), lane, (machine, 0.0), backend.cache_folder())

    def run(self, machine: Rig, values, seeds, y, metrics, scales, settings: GradientSettings, on_cycle):
        """(metrics, their slopes, settled, terms) of lanes that begin the cycle at the states `y`."""
        steps, done = settings.steps_per_cycle, np.zeros(len(scales), bool)
        moved_y = {n: np.zeros(len(scales)) for n in y}
        kept, slopes = ({n: np.full(len(scales), np.nan) for n in metrics} for _ in range(2))
        for number in range(settings.max_cycles):
            rows = np.flatnonzero(~done)
            state = _at(y, rows), {n: np.full(len(rows), v) for n, v in self._sums.items()}
            moved = _at(moved_y, rows), {n: np.zeros(len(rows)) for n in self._sums}
            lane = _at(values, rows), _at(seeds, rows)
            (_, sums), moved = self._loop((state, moved), lane, (machine, float(steps)), 0, steps, backend.cores())
            new, slope = jax.device_get(_measured(machine, *lane, sums, moved[1], 1.0 / steps))
            new, slope = ({n: table[n] for n in metrics} for table in (new, slope))
            terms = {n: slope[n] - slopes[n][rows] for n in metrics}
            done[rows] = settled(new, slope, terms, scales[rows], settings.tolerance)
            for table, part in ((kept, new), (slopes, slope), (moved_y, moved[0])):
                for n, column in part.items():
                    table[n][rows] = column
            if on_cycle is not None:
                on_cycle(1.0 if done.all() else (number + 1) / settings.max_cycles)
            if done.all():
                break
        return kept, slopes, done, number + 1


def _at(columns: dict[str, np.ndarray], rows: np.ndarray) -> dict[str, np.ndarray]:
    return {n: column[rows] for n, column in columns.items()}


@jax.jit
def _measured(machine, values, seeds, sums, moved, share):
    """The metrics of a cycle and their tangents."""

    def one(values, seeds, sums, moved):
        def metrics(values, sums):
            return measured(set_parameters(machine, values), sums, share)

        return jax.jvp(metrics, (values, sums), (seeds, moved))

    return jax.vmap(one)(values, seeds, sums, moved)
