"""Synthesise the measurements of a campaign from a known machine, with an integrator that the fit does not use.

The trajectories come from `studies.rk4_reference`, on a time grid finer than the sampling. The front ends
of the sensors act on that grid; then follow sampling, faults of the recording electronics, noise and the converter.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import jax
import numpy as np

from edhas_jax.core import runtime
from edhas_jax.machine.parameters import get_parameter, list_parameters, set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import BenchRun, Campaign, CampaignError, Channel, Spread, Use
from edhas_jax.measurements.sensor_models import SensorModel, record
from edhas_jax.measurements.unknown_parameters import uncertain_unknowns
from studies.rk4_reference import trajectories

GRID_REFINEMENT = 5  # grid intervals per sample interval, on which the front ends act
CONVERTER_BITS = 16
CONVERTER_HEADROOM = 1.25  # range of the converter over the largest value in any run
MAX_DEVIATION = 2.0  # standard deviations at which drawn parameters are clipped
MAX_TIMESTAMP_ERROR = 1e-6  # in sample intervals; time stamps further off the regular grid are refused


@dataclasses.dataclass(frozen=True)
class PlannedRun:
    """A run to be made: its use, its duration [s], and its conditions by parameter (SI)."""

    use: Use
    duration: float
    conditions: Mapping[str, float]


def planned_campaign(
    name: str, machine: Rig, uncertain: Mapping[str, Spread | float], channels: Mapping[str, Channel],
    runs: Sequence[PlannedRun], interval: float,
) -> Campaign:  # fmt: skip
    """A campaign whose runs have time stamps but no signals yet.

    Args:
        name: name of the campaign.
        machine: the engineer's model.
        uncertain: how well parameters are known, by name; a number is a relative standard deviation.
        channels: the signals to be measured.
        runs: the runs to be made.
        interval: sample interval [s].
    """
    bench_runs = []
    for k, run in enumerate(runs):
        time = interval * np.arange(round(run.duration / interval) + 1)
        file = Path(f"run{k + 1}.csv")
        lines = np.arange(len(time)) + 2
        bench_runs.append(BenchRun(file.stem, file, run.use, dict(run.conditions), time, {}, lines))
    return Campaign(name, Path(name), machine, dict(uncertain), dict(channels), tuple(bench_runs), ())


def draw_parameters(campaign: Campaign, machine: Rig, rng: np.random.Generator) -> Rig:
    """Draw the uncertain parameters of a machine from their priors, clipped to ±2 standard deviations.

    Friction at break-away, for example, is at least that while sliding: a value drawn below such a limit takes it.

    Args:
        campaign: says how well they are known.
        machine: gives the known values.
        rng: the random generator.

    Returns:
        The machine with the drawn values.
    """
    unknowns = [u for u in uncertain_unknowns(campaign, machine) if not u.run]
    n = np.clip(rng.standard_normal(len(unknowns)), -MAX_DEVIATION, MAX_DEVIATION)
    values = {u.name: float(u.value(deviation)) for u, deviation in zip(unknowns, n, strict=True)}
    return set_parameters(machine, _in_order(machine, values))


def _in_order(machine: Rig, values: dict[str, float]) -> dict[str, float]:
    """The values of some parameters by name, moved to their limit where a law of the machine excludes their order."""
    for p, present, path in list_parameters(machine):
        if p.at_least:
            names = {n: next((m for m in (n, f"{path}.{n}") if m in values), None) for n in (p.name, p.at_least)}
            drawn, limit = names[p.name], names[p.at_least]
            if drawn is not None:
                smallest = values[limit] if limit else float(get_parameter(machine, f"{path}.{p.at_least}"))
                values[drawn] = max(values[drawn], smallest)
            elif limit is not None:
                values[limit] = min(values[limit], float(present))
    return values


def synthesise(
    campaign: Campaign,
    truth: Rig,
    rng: np.random.Generator,
    faults: Mapping[str, tuple[SensorModel, ...]] | None = None,
    front_ends: Mapping[str, tuple[SensorModel, ...]] | None = None,
) -> Campaign:
    """Synthesise the measurements of a campaign.

    Args:
        campaign: gives time stamps, conditions and noise; signals that it has already are ignored.
        truth: the machine that is measured.
        rng: the random generator of the noise.
        faults: sensor models by signal that act on the sampled values.
        front_ends: sensor models by signal that act before sampling.

    Returns:
        The campaign with signals.

    Raises:
        CampaignError: a run has a recorded set point or uneven time stamps, or the runs differ in sample interval.
        Unstable: see `studies.rk4_reference`.
    """
    interval, conditions = _common_grid(campaign, truth)
    samples = GRID_REFINEMENT * (max(len(run.time) for run in campaign.runs) - 1) + 1
    grid_interval = interval / GRID_REFINEMENT
    traces = trajectories(truth, conditions, grid_interval, samples, tuple(campaign.channels))
    traces = _recorded(front_ends or {}, grid_interval, traces)
    sampled = _recorded(faults or {}, interval, {n: v[::GRID_REFINEMENT] for n, v in traces.items()})
    signals: list[dict[str, np.ndarray]] = [{} for _ in campaign.runs]
    for name, channel in campaign.channels.items():
        rows = [sampled[name][: len(run.time), r] for r, run in enumerate(campaign.runs)]
        rows = [row + channel.noise * rng.standard_normal(len(row)) for row in rows]
        resolution = 2.0 * CONVERTER_HEADROOM * max(np.abs(row).max() for row in rows) / 2**CONVERTER_BITS
        for of_run, row in zip(signals, rows, strict=True):
            of_run[name] = resolution * np.round(row / resolution)
    runs = tuple(dataclasses.replace(run, signals=of_run) for run, of_run in zip(campaign.runs, signals, strict=True))
    return dataclasses.replace(campaign, runs=runs)


def _recorded(
    chains: Mapping[str, tuple[SensorModel, ...]], interval: float, traces: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """The traces (samples, runs) by signal after their measurement chains."""
    recorded = dict(traces)
    for signal, chain in chains.items():
        time = interval * np.arange(len(recorded[signal]))
        recorded[signal] = np.asarray(runtime.jit(record)(jax.tree.map(np.asarray, chain), time, recorded[signal]))
    return recorded


def _common_grid(campaign: Campaign, truth: Rig) -> tuple[float, dict[str, np.ndarray]]:
    """The sample interval [s] of all runs, and the parameters that they set, each (runs,)."""
    intervals = [run.interval for run in campaign.runs]
    for run in campaign.runs:
        error = np.abs(run.time - intervals[0] * np.arange(len(run.time))).max()
        if error > MAX_TIMESTAMP_ERROR * intervals[0]:
            raise CampaignError(f"{run.file}: only runs that are sampled evenly, all at one rate, can be synthesised")
        if run.recordings:
            raise CampaignError(f"{run.file}: a run with a recorded set point cannot be synthesised")
    machines = [campaign.machine_of(run, truth) for run in campaign.runs]
    names = dict.fromkeys(name for run in campaign.runs for name in run.conditions)
    return intervals[0], {n: np.array([float(get_parameter(m, n)) for m in machines]) for n in names}
