"""What can be wrong with the time axis of a run: gaps, jitter, a late start, a sampling too slow for the drive."""

from collections.abc import Iterator

import numpy as np

from edhas_jax.core.units import format_quantity
from edhas_jax.machine.components.set_points import Sine
from edhas_jax.machine.rigs import ActuatorSystem, Rig
from edhas_jax.measurements.campaign import BenchRun, Remark, Severity

GAP_IN_INTERVALS = 1.5  # steps, in usual intervals, above which samples are missing
MAX_JITTER = 0.02  # rms of the steps about the usual interval, as a share of it
MOST = 5  # gaps of a run that are told one by one
PER_CYCLE = 20  # samples that a cycle of the set point needs


def check_time_axis(run: BenchRun, machine: Rig) -> Iterator[Remark]:
    """What is wrong with the time of a run; `machine` is the one under its conditions."""
    steps, usual = np.diff(run.time), run.interval
    told = format_quantity(usual, "s")

    def warn(at: int, sentence: str) -> Remark:
        return Remark(Severity.WARNING, run.file, int(run.lines[at]), sentence)

    if abs(run.time[0]) > GAP_IN_INTERVALS * usual:
        start = format_quantity(run.time[0], "s")
        yield warn(0, f"the first sample is at {start}; time must count from the start of the run, at rest")
    gaps = np.flatnonzero(steps > GAP_IN_INTERVALS * usual)
    for at in gaps[:MOST]:
        missing, gap = round(steps[at] / usual) - 1, format_quantity(steps[at], "s")
        yield warn(at, f"a gap of {gap} follows: {missing} samples are missing ({told} apart)")
    if len(gaps) > MOST:
        longest = format_quantity(steps.max(), "s")
        yield warn(gaps[MOST], f"and {len(gaps) - MOST} more gaps from here on, the longest {longest}")
    scatter = jitter(run)
    if scatter > MAX_JITTER:
        at = int(np.argmax(np.where(steps <= GAP_IN_INTERVALS * usual, np.abs(steps - usual), 0.0)))
        worst = format_quantity(steps[at], "s")
        yield warn(at, f"time stamps jitter: steps are off {told} by {scatter:.0%} rms, here one of {worst} follows")
    if isinstance(machine.reference, Sine) and not isinstance(machine, ActuatorSystem):
        period = 1.0 / float(machine.reference.frequency)
        if period / usual < PER_CYCLE:
            yield warn(0, f"sampled too slowly: {period / usual:.1f} samples per cycle of the set point, at least "
                           f"{PER_CYCLE} are needed; is the unit of time right?")  # fmt: skip
        if (length := run.time[-1] - run.time[0]) < period:
            span = f"the run lasts {format_quantity(length, 's')}, a cycle {format_quantity(period, 's')}"
            yield warn(0, f"{span}: not one whole cycle; is the unit of time right?")


def jitter(run: BenchRun) -> float:
    """How much the steps from sample to sample scatter, rms, as a share of the usual one; gaps aside."""
    steps = np.diff(run.time) / run.interval
    return float(np.sqrt(np.mean((steps[steps <= GAP_IN_INTERVALS] - 1.0) ** 2)))
