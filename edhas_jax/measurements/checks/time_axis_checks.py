"""Check the time axis of a run: gaps, jitter, and too few samples per cycle of the set point."""

from collections.abc import Iterator

import numpy as np

from edhas_jax.core.units import format_quantity
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import BenchRun, Remark, Severity

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

    def warn(sample: int, sentence: str) -> Remark:
        return Remark(Severity.WARNING, run.file, int(run.lines[sample]), sentence)

    gaps = np.flatnonzero(steps > GAP_IN_INTERVALS * interval)
    for k in gaps[:MAX_LISTED_GAPS]:
        missing, gap = round(steps[k] / interval) - 1, format_quantity(steps[k], "s")
        yield warn(k, f"followed by a gap of {gap}: {missing} samples are missing (sample interval {interval_text})")
    if len(gaps) > MAX_LISTED_GAPS:
        longest = format_quantity(steps.max(), "s")
        yield warn(gaps[MAX_LISTED_GAPS], f"and {len(gaps) - MAX_LISTED_GAPS} more gaps, the longest {longest}")
    scatter = jitter(run)
    if scatter > MAX_JITTER:
        k = int(np.argmax(np.where(steps <= GAP_IN_INTERVALS * interval, np.abs(steps - interval), 0.0)))
        worst = format_quantity(steps[k], "s")
        yield warn(
            k, f"time stamps jitter: steps deviate from {interval_text} by {scatter:.0%} rms; the worst one is {worst}"
        )
    if machine.cycle is not None:
        period = 1.0 / float(machine.reference.frequency)
        if period / interval < MIN_SAMPLES_PER_CYCLE:
            yield warn(0, f"sampled too slowly: {period / interval:.1f} samples per cycle of the set point, at least "
                           f"{MIN_SAMPLES_PER_CYCLE} are needed; is the unit of time right?")  # fmt: skip
        if (length := run.time[-1] - run.time[0]) < period:
            lengths = f"the run lasts {format_quantity(length, 's')}, a cycle {format_quantity(period, 's')}"
            yield warn(0, f"{lengths}: less than one cycle; is the unit of time right?")


def jitter(run: BenchRun) -> float:
    """Rms deviation of the time steps from the sample interval, in sample intervals; gaps are not counted."""
    steps = np.diff(run.time) / run.interval
    return float(np.sqrt(np.mean((steps[steps <= GAP_IN_INTERVALS] - 1.0) ** 2)))
