"""Campaigns of a bench that is known: what its sensors would have read, by an integrator that no fit uses.

The trajectories come from `edhas_jax.simulation.rk4_reference`, on a grid finer than the sampling. What a sensor's
front end does to its signal is followed on that grid; then come sampling, the faults of what records it, noise and a
converter.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import jax
import numpy as np

from edhas_jax.machine.parameters import get_parameter, set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import BenchRun, Campaign, CampaignError, Channel, Use
from edhas_jax.measurements.sensor_models import SensorModel, record
from edhas_jax.simulation.rk4_reference import trajectories

FINER = 5  # instants at which a front end is followed for one that is sampled
BITS = 16  # of the converter
HEADROOM = 1.25  # its range over the largest value in any run
CLIP = 2.0  # standard deviations beyond which no parameter is drawn
EVEN = 1e-6  # share of the interval by which time stamps may be off


@dataclasses.dataclass(frozen=True)
class PlannedRun:
    """A run that is to be made: how long [s], for what, under which conditions (SI)."""

    use: Use
    duration: float
    conditions: Mapping[str, float]


def planned_campaign(
    name: str, machine: Rig, uncertain: Mapping[str, float], channels: Mapping[str, Channel],
    runs: Sequence[PlannedRun], interval: float,
) -> Campaign:  # fmt: skip
    """A campaign whose runs have a time, sampled every `interval` [s], but no signals yet."""
    made = []
    for k, run in enumerate(runs):
        time = interval * np.arange(round(run.duration / interval) + 1)
        file = f"run{k + 1}.csv"
        made.append(
            BenchRun(Path(file).stem, Path(file), run.use, dict(run.conditions), time, {}, np.arange(len(time)) + 2)
        )
    return Campaign(name, Path(name), machine, dict(uncertain), dict(channels), tuple(made), ())


def draw_parameters(campaign: Campaign, machine: Rig, rng: np.random.Generator) -> Rig:
    """`machine` with every uncertain parameter that it has drawn: known · exp(σ n), n normal, within ±2."""
    spreads = campaign.uncertain_in(machine)
    n = np.clip(rng.standard_normal(len(spreads)), -CLIP, CLIP)
    values = {
        name: float(get_parameter(machine, name)) * float(np.exp(spread * size))
        for (name, spread), size in zip(spreads.items(), n, strict=True)
    }
    return set_parameters(machine, values)


def synthesise(
    campaign: Campaign,
    truth: Rig,
    rng: np.random.Generator,
    faults: Mapping[str, tuple[SensorModel, ...]] | None = None,
    front_ends: Mapping[str, tuple[SensorModel, ...]] | None = None,
) -> Campaign:
    """The campaign as it would have been measured on the machine `truth`.

    Times, conditions and noise are those of the campaign; its signals, if it has any, are not looked at. By signal,
    `front_ends` are links that act before it is sampled, `faults` those that act on what was recorded.

    Raises:
        CampaignError: runs with a recorded set point, sampled unevenly or at different rates.
        Unstable: see `edhas_jax.simulation.rk4_reference`.
    """
    interval, values = _common(campaign, truth)
    samples = FINER * (max(len(run.time) for run in campaign.runs) - 1) + 1
    fine = interval / FINER
    exact = trajectories(truth, values, fine, samples, tuple(campaign.channels))
    exact = _through(front_ends or {}, fine, exact)
    seen = _through(faults or {}, interval, {n: v[::FINER] for n, v in exact.items()})
    signals: list[dict[str, np.ndarray]] = [{} for _ in campaign.runs]
    for name, channel in campaign.channels.items():
        rows = [seen[name][: len(run.time), r] for r, run in enumerate(campaign.runs)]
        rows = [row + channel.noise * rng.standard_normal(len(row)) for row in rows]
        bit = 2.0 * HEADROOM * max(np.abs(row).max() for row in rows) / 2**BITS
        for found, row in zip(signals, rows, strict=True):
            found[name] = bit * np.round(row / bit)
    runs = tuple(dataclasses.replace(run, signals=found) for run, found in zip(campaign.runs, signals, strict=True))
    return dataclasses.replace(campaign, runs=runs)


def _through(
    chains: Mapping[str, tuple[SensorModel, ...]], interval: float, traces: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """The traces (samples, runs) after the chains of their signals."""
    out = dict(traces)
    for signal, chain in chains.items():
        time = interval * np.arange(len(out[signal]))
        out[signal] = np.asarray(jax.jit(record)(jax.tree.map(np.asarray, chain), time, out[signal]))
    return out


def _common(campaign: Campaign, truth: Rig) -> tuple[float, dict[str, np.ndarray]]:
    """The time from sample to sample, and the parameters that runs set, each (runs,)."""
    intervals = [run.interval for run in campaign.runs]
    for run in campaign.runs:
        off = np.abs(run.time - intervals[0] * np.arange(len(run.time))).max()
        if off > EVEN * intervals[0]:
            raise CampaignError(f"{run.file}: only runs that are sampled evenly, all at one rate, can be synthesised")
        if run.reference is not None:
            raise CampaignError(f"{run.file}: a run with a recorded set point cannot be synthesised")
    machines = [campaign.machine_of(run, truth) for run in campaign.runs]
    names = dict.fromkeys(name for run in campaign.runs for name in run.conditions)
    return intervals[0], {n: np.array([float(get_parameter(m, n)) for m in machines]) for n in names}
