"""Designs of a rig of one's own: a whole run of each, with the metrics of its signals and their derivatives."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.machine.parameters import replace_values
from edhas_jax.machine.rig_base import Rig
from edhas_jax.simulation.batch_trajectories import simulate_batch
from edhas_jax.simulation.metrics import metric_slopes, run_metrics, signals_of
from edhas_jax.simulation.validity import STEP_SENSITIVITY, Status, valid_ranges

MOST_NUMBERS = 20_000_000  # of the signals that are held at a time
STEP_KINDS = ("mean", "final")  # metrics by which a design is checked for its sensitivity to the step


class RunGrid(NamedTuple):
    """Steps and samples of a run: time step [s], steps from sample to sample, number of samples."""

    step: float
    steps_per_sample: int
    samples: int

    @property
    def time(self) -> np.ndarray:
        """Times of the samples [s], (samples,)."""
        return self.step * self.steps_per_sample * np.arange(self.samples)


def run_own_designs(
    machine: Rig, columns: Mapping[str, np.ndarray], grid: RunGrid, on_gpu: bool = False
) -> dict[str, np.ndarray]:
    """Run designs with the step of a grid and with half of it.

    Args:
        machine: what the designs have in common.
        columns: parameters that differ, by name in SI, each (designs,).
        grid: steps and samples.
        on_gpu: whether the designs are part of a table with so many that a GPU is faster.

    Returns:
        By metric its value with half the step, (designs,), with `status`, `cycles` (0) and `residual`: the largest
        change of a mean or last value with the step, as a share of the range of its signal.
    """
    names = tuple(n for n in machine.signals if n != "time")
    ranges = {n: limits for n, limits in valid_ranges(machine).items() if n in names}
    count, part = len(next(iter(columns.values()))), max(1, MOST_NUMBERS // (2 * grid.samples * len(names)))
    table: dict[str, list[np.ndarray]] = {}
    for first in range(0, count, part):
        some = {n: np.asarray(v)[first : first + part] for n, v in columns.items()}
        coarse, fine = (
            simulate_batch(
                machine, some, None, grid.step / k, k * grid.steps_per_sample, grid.samples, names, on_gpu=on_gpu
            ).values
            for k in (1, 2)
        )
        machines = replace_values(machine, some)
        found, before = (run_metrics(machines, {"time": grid.time, **signals}) for signals in (fine, coarse))
        residual = np.max([_change(n, found, before) for n in names], axis=0)
        finite = np.all([np.isfinite(v) for v in found.values()], axis=0)
        beyond = np.zeros(len(residual), bool)
        for n, (low, high) in ranges.items():
            beyond |= (found[f"smallest_{n}"] < float(low)) | (found[f"largest_{n}"] > float(high))
        status = np.select(
            [~finite, beyond, ~(residual <= STEP_SENSITIVITY)],
            [Status.NOT_FINITE, Status.OUT_OF_RANGE, Status.STEP_TOO_LARGE], Status.OK,
        )  # fmt: skip
        rows = found | {"status": status, "cycles": np.zeros(len(residual)), "residual": residual}
        for name, values in rows.items():
            table.setdefault(name, []).append(np.asarray(values, float))
    return {name: np.concatenate(parts) for name, parts in table.items()}


def own_slopes(
    machine: Rig, columns: Mapping[str, np.ndarray], parameters: Sequence[str], metrics: Sequence[str], grid: RunGrid
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], np.ndarray]:
    """Metrics of runs and their derivatives by parameters.

    Returns:
        Values by metric, (designs,); slopes by metric, (designs, parameters); status, (designs,).
    """
    count, width = len(next(iter(columns.values()))), len(parameters)
    declared = {name: machine.metrics[name] for name in metrics}
    names = tuple(name for name in signals_of(machine, declared) if name != "time")
    wide = {n: np.repeat(np.asarray(v, float), width) for n, v in columns.items()}
    seeds = {n: np.tile([float(n == other) for other in parameters], count) for n in parameters}
    traces = simulate_batch(machine, wide, seeds, grid.step, grid.steps_per_sample, grid.samples, names)
    signals = {"time": grid.time, **traces.values}
    found, change = metric_slopes(machine, wide, seeds, declared, signals, traces.slopes)
    values = {m: found[m][::width] for m in metrics}
    slopes = {m: change[m].reshape(count, width) for m in metrics}
    finite = np.all([np.isfinite(v) for v in values.values()], axis=0)
    return values, slopes, np.where(finite, float(Status.OK), float(Status.NOT_FINITE))


def _change(signal: str, new: Mapping[str, np.ndarray], old: Mapping[str, np.ndarray]) -> np.ndarray:
    span = new[f"largest_{signal}"] - new[f"smallest_{signal}"]
    size = np.maximum(span, 1e-9 * np.abs(new[f"rms_{signal}"]) + 1e-300)
    return np.max([np.abs(new[f"{k}_{signal}"] - old[f"{k}_{signal}"]) / size for k in STEP_KINDS], axis=0)
