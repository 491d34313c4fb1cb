"""Check the time axis of a run: gaps, jitter, and too few samples per cycle of the set point."""

from collections.abc import Iterator

import numpy as np

from edhas_jax.core.remark import Remark
from edhas_jax.core.units import format_quantity
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import BenchRun

GAP_IN_INTERVALS = 1.5  # sample intervals between two time stamps above which samples are missing
MAX_JITTER = 0.02  # rms deviation of the time steps, in sample intervals
MAX_LISTED_GAPS = 5  # gaps of one run that are reported one by one
MIN_SAMPLES_PER_CYCLE = 20


def check_time_axis(run: BenchRun, machine: Rig) -> Iterator[Remark]:
    """Check the time stamps of a run.

    Args:
        run: the run.
        machine: the machine under the conditions of the run.

    Yields:
        Warnings, each with the line of the sample that it refers to.
    """
    steps, interval = np.diff(run.time), run.interval
    interval_text = format_quantity(interval, "s")

    gaps = np.flatnonzero(steps > GAP_IN_INTERVALS * interval)
    for k in gaps[:MAX_LISTED_GAPS]:
        gap, missing = format_quantity(steps[k], "s"), round(steps[k] / interval) - 1
        sentence = f"followed by a gap of {gap}: {missing} samples are missing (sample interval {interval_text})"
        yield run.warning(sentence, k)
    if len(gaps) > MAX_LISTED_GAPS:
        more = f"and {len(gaps) - MAX_LISTED_GAPS} more gaps, the longest {format_quantity(steps.max(), 's')}"
        yield run.warning(more, gaps[MAX_LISTED_GAPS])
    if (scatter := jitter(run)) > MAX_JITTER:
        k = int(np.argmax(np.where(steps <= GAP_IN_INTERVALS * interval, np.abs(steps - interval), 0.0)))
        deviation = f"steps deviate from {interval_text} by {scatter:.0%} rms; the worst one is"
        yield run.warning(f"time stamps jitter: {deviation} {format_quantity(steps[k], 's')}", k)
    if machine.cycle is not None:
        period, length = 1.0 / float(machine.reference.frequency), run.time[-1] - run.time[0]
        if period / interval < MIN_SAMPLES_PER_CYCLE:
            found = f"sampled too slowly: {period / interval:.1f} samples per cycle of the set point"
            yield run.warning(f"{found}, at least {MIN_SAMPLES_PER_CYCLE} are needed; is the unit of time right?", 0)
        if length < period:
            lengths = f"the run lasts {format_quantity(length, 's')}, a cycle {format_quantity(period, 's')}"
            yield run.warning(f"{lengths}: less than one cycle; is the unit of time right?", 0)


def jitter(run: BenchRun) -> float:
    """Rms deviation of the time steps from the sample interval, in sample intervals; gaps are not counted."""
    steps = np.diff(run.time) / run.interval
    return float(np.sqrt(np.mean((steps[steps <= GAP_IN_INTERVALS] - 1.0) ** 2)))
