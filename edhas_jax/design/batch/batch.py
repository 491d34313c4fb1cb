"""Batches: many designs of one machine, each run to its periodic state, with metrics computed in the time loop."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from edhas_jax.compiler.engines import many_lanes, serving_engine
from edhas_jax.core import runtime
from edhas_jax.design.batch.cycle_metrics import cycle_change
from edhas_jax.design.batch.periodic_solver import (
    GPU_TABLE,
    LONG_TABLE,
    BatchState,
    cycle_loop,
    metrics_with_status,
    run_to_periodic,
)
from edhas_jax.design.batch.run_metrics import RunGrid, run_own_designs
from edhas_jax.machine.parameters import get_parameter
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.integrator import DEFAULT_STEP
from edhas_jax.simulation.run_settings import Precision, Simulation
from edhas_jax.simulation.validity import STEP_SENSITIVITY, Status

SLOW_CYCLES = 8  # a design that takes more is checked for its sensitivity to the step
CHECK_CYCLES = 2  # run with the longer step of that check


@dataclasses.dataclass(frozen=True)
class BatchSettings:
    """How a batch is run.

    A design is periodic when flow, electrical power and stroke change by less than `tolerance` from one cycle to the
    next, twice in a row. One that takes more than eight cycles is flagged if results change by more than 1 % with a √2
    longer step.

    Attributes:
        step: largest time step [s]; each design takes equal steps per cycle, as many as keep below it.
        tolerance: relative change from cycle to cycle below which a design is periodic.
        max_cycles: most cycles of a design.
        soft_start: whether the first cycle is a ramp, whatever ramp the machine has; else the set point starts at once.
        precision: of all numbers.
        duration: length of a run of a rig of one's own [s]; None is what the rig usually has.
        sample_rate: samples per second of such a run [Hz]; None is what the rig usually has.
    """

    step: float = DEFAULT_STEP
    tolerance: float = 1e-4
    max_cycles: int = 16
    soft_start: bool = True
    precision: Precision = Precision.FLOAT64
    duration: float | None = None
    sample_rate: float | None = None

    def run_grid(self, machine: Rig) -> RunGrid:
        """Steps and samples of the runs of a rig of one's own; what is None is as the rig usually has it."""
        interval = 10.0 * machine.time_step if self.sample_rate is None else 1.0 / self.sample_rate
        step = self.step if self.step >= 0.01 * machine.time_step else machine.time_step
        steps = max(1, math.ceil(interval / step - 1e-9))
        samples = math.floor((machine.duration if self.duration is None else self.duration) / interval + 1e-9) + 1
        return RunGrid(interval / steps, steps, samples)


def settings_of_batch(machine: Rig, simulation: Simulation) -> dict[str, Any]:
    """The fields of `BatchSettings` that follow from the settings of a run.

    These are step and precision, and where no sine drives the machine also duration and sample rate.
    """
    found: dict[str, Any] = {"precision": simulation.precision}
    found |= {"step": simulation.step} if simulation.step else {}
    if machine.cycle is not None:
        return found
    usual = {"step": machine.time_step, "duration": simulation.length(machine), "sample_rate": simulation.rate(machine)}
    return usual | found


@dataclasses.dataclass(frozen=True)
class Chunk:
    """The designs that are run together.

    Attributes:
        rows: of the designs in the table.
        steps_per_cycle: that each takes.
        many_lanes: whether the table has so many designs that a GPU is faster (`engines.many_lanes`).
    """

    rows: np.ndarray
    steps_per_cycle: int
    many_lanes: bool = False


class BatchError(ValueError):
    """These designs cannot be run as a batch."""


def runs_designs(machine: Rig) -> bool:
    """Whether designs of a machine are run: to the periodic state that a sine gives, or whole runs."""
    return machine.cycle is not None or machine.runs_whole


def plan_chunks(machine: Rig, values: Mapping[str, np.ndarray], settings: BatchSettings) -> list[Chunk]:
    """Cut a table of designs into chunks, the same for the same table wherever the same engine runs it.

    Designs that take the same number of steps per cycle go together, so that a slow frequency keeps no other waiting.

    Raises:
        BatchError: the machine is not driven by a sine on a bench.
    """
    if not runs_designs(machine):
        raise BatchError(f"a batch needs a bench that is driven by a sine; this is {machine.name}")
    count = len(next(iter(values.values())))
    if machine.cycle is None:
        steps, on_gpu, length = np.zeros(count, int), many_lanes(count, float), LONG_TABLE
    else:
        varied = [values[n] for n in ("frequency", "reference.frequency") if n in values]
        frequency = np.asarray(varied[0] if varied else get_parameter(machine, "reference.frequency"), float)
        steps = steps_per_cycle(np.broadcast_to(frequency, (count,)), settings.step)
        on_gpu = many_lanes(count, settings.precision.value)
        length = GPU_TABLE if on_gpu else LONG_TABLE
    chunks = []
    for n in np.unique(steps):
        rows = np.flatnonzero(steps == n)
        chunks += [Chunk(rows[i : i + length], int(n), on_gpu) for i in range(0, len(rows), length)]
    return chunks


def steps_per_cycle(frequency, step: float) -> np.ndarray:
    """Steps of at most `step` [s] in a cycle, rounded up on a ladder of √2 so that designs share their count."""
    least = np.maximum(1.0 / (np.asarray(frequency) * step), 64.0)
    return np.rint(64 * 2.0 ** (np.ceil(2 * np.log2(least / 64.0) - 1e-9) / 2)).astype(int)


def engine_of_designs(machine: Rig, values: Mapping[str, np.ndarray], precision: Precision, on_gpu: bool) -> str:
    """The name of the engine that runs a table of designs.

    Of a rig of one's own it is the engine that is asked first; a warning says so if this one cannot run the rig.

    Args:
        machine: what the designs have in common.
        values: parameters that differ.
        precision: of all numbers.
        on_gpu: whether the table has so many designs that a GPU is faster (`Chunk.many_lanes`).
    """
    if machine.cycle is None:
        return serving_engine(on_gpu).name
    dtype = np.dtype(precision.value)
    base = jax.tree.map(lambda leaf: np.asarray(leaf, dtype), machine)
    return cycle_loop(base, values, dtype, on_gpu).engine


def run_chunk(
    machine: Rig, values: Mapping[str, np.ndarray], chunk: Chunk, settings: BatchSettings
) -> dict[str, np.ndarray]:
    """Run the designs of one chunk: every metric in SI, `status`, `cycles` and `residual`, one value per row.

    The result depends on the designs and settings alone, not on the number of cores or on the neighbours.
    """
    if machine.cycle is None:
        columns = {n: np.asarray(v)[chunk.rows] for n, v in values.items()}
        return run_own_designs(machine, columns, settings.run_grid(machine), chunk.many_lanes)
    dtype = np.dtype(settings.precision.value)
    base = jax.tree.map(lambda leaf: np.asarray(leaf, dtype), machine)
    columns = {n: np.asarray(v)[chunk.rows].astype(dtype) for n, v in values.items()}
    options = dtype.type(settings.tolerance), settings.max_cycles, settings.soft_start
    state = run_to_periodic(base, columns, chunk.steps_per_cycle, *options, many_lanes=chunk.many_lanes)
    out = metrics_with_status(base, columns, state.metrics, state.done) | {"cycles": state.cycles}
    out = {n: np.asarray(v, float) for n, v in out.items()}
    slow = np.flatnonzero((out["cycles"] > SLOW_CYCLES) & (out["status"] == Status.OK))
    if len(slow):
        state, columns = jax.tree.map(lambda leaf: leaf[slow], (state, columns))
        sensitive = _step_sensitive(base, columns, state, chunk, dtype)
        out["status"][slow[sensitive]] = Status.STEP_TOO_LARGE
    return out


def _step_sensitive(base: Rig, columns: dict[str, np.ndarray], state: BatchState, chunk: Chunk, dtype) -> np.ndarray:
    """Which designs (designs,) change by more than `STEP_SENSITIVITY` when they go on with a √2 longer step.

    Designs that take long to become periodic are near to losing their period, where the step matters most.
    """
    coarser = int(round(chunk.steps_per_cycle / math.sqrt(2.0)))
    # a tolerance below zero: none of these cycles is the last one
    after = run_to_periodic(base, columns, coarser, dtype.type(-1.0), CHECK_CYCLES, False, state, chunk.many_lanes)
    return ~(np.asarray(_change_of(after.metrics, state.metrics)) <= STEP_SENSITIVITY)


_change_of = runtime.jit(cycle_change)


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
