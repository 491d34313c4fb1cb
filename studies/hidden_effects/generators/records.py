"""From a true machine to the records of a campaign: trajectories by RK4, then the generator's own sensor chain."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from edhas_jax.machine.parameters import get_parameter
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign
from studies.hidden_effects.generators.chains import DrawnLink, Place
from studies.rk4_reference import LARGEST_RK4_STEP, trajectories

GRID_REFINEMENT = 5  # grid intervals per sample interval
MARGIN = 20  # samples that are simulated beyond the end of the longest record, for clocks that run fast or late
CONVERTER_BITS, CONVERTER_HEADROOM = 16, 1.25


def recorded(
    plan: Campaign, truth: Rig, rng: np.random.Generator, chain: Sequence[DrawnLink] = (),
    of_runs: Mapping[str, np.ndarray] | None = None, largest_step: float = LARGEST_RK4_STEP,
) -> Campaign:  # fmt: skip
    """The campaign with signals, and with the noise that its engineer states.

    Args:
        plan: gives time stamps, conditions and the true noise.
        truth: the machine that is measured.
        rng: the random generator.
        chain: links of the sensor chain.
        of_runs: factors of parameters by run, each (runs,), which the campaign does not know.
        largest_step: of the integrator [s].
    """
    interval = plan.runs[0].interval
    lengths = [len(run.time) for run in plan.runs]
    machines = [plan.machine_of(run, truth) for run in plan.runs]
    names = dict.fromkeys([n for run in plan.runs for n in run.conditions] + list(of_runs or {}))
    values = {n: np.array([float(get_parameter(m, n)) for m in machines]) for n in names}
    values = {n: v * (of_runs or {}).get(n, 1.0) for n, v in values.items()}
    step = interval / GRID_REFINEMENT
    samples = GRID_REFINEMENT * (max(lengths) - 1 + MARGIN) + 1
    traces = trajectories(truth, values, step, samples, tuple(plan.channels), largest_step)
    by_place = {place: [link for link in chain if link.link.place is place] for place in Place}
    signals: list[dict] = [{} for _ in plan.runs]
    channels = {}
    for name, channel in plan.channels.items():
        own = {place: [link for link in links if name in link.signals] for place, links in by_place.items()}
        rows = []
        for r, run in enumerate(plan.runs):
            trace, times = traces[name][:, r], run.time
            for link in own[Place.SIGNAL]:
                trace = link.link.act(step, trace, link.value)
            for link in own[Place.CLOCK]:
                times = link.link.act(times, link.value)
            spline = CubicSpline(step * np.arange(len(trace)), trace)
            row = spline(np.maximum(times, 0.0))
            noise = rng.standard_normal(len(row))
            for link in own[Place.NOISE]:
                noise = link.link.act(rng, len(row), link.value)
            rows.append(row + channel.noise * noise)
        resolution = 2.0 * CONVERTER_HEADROOM * max(np.abs(row).max() for row in rows) / 2**CONVERTER_BITS
        rows = [resolution * np.round(row / resolution) for row in rows]
        for link in own[Place.SAMPLES]:
            rows = [link.link.act(rng, row, channel.noise, link.value) for row in rows]
        stated = channel.noise
        for link in own[Place.STATEMENT]:
            stated = channel.noise * link.link.act(rng, link.value)
        channels[name] = dataclasses.replace(channel, noise=stated)
        for of_run, row in zip(signals, rows, strict=True):
            of_run[name] = row
    runs = tuple(dataclasses.replace(run, signals=of_run) for run, of_run in zip(plan.runs, signals, strict=True))
    return dataclasses.replace(plan, runs=runs, channels=channels)
