"""Alignment of records that were made by several recorders whose clocks differ by a constant in each run.

What a further recorder has written, measured signals and recorded drives, is shifted in time until model and
measurements fit best. The model need not be calibrated: gain and offset of every signal are free at every shift, so
that only the shapes count. With 1 − ρ² the share of the variance of a signal of N samples that is left, the cost of a
shift is Σ ½ N ln(1 − ρ²).
"""

import dataclasses
from collections.abc import Callable

import numpy as np

from edhas_jax.core.remark import Severity
from edhas_jax.core.structs import replace
from edhas_jax.core.units import format_quantity
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.measurements.accuracy import RecorderClock
from edhas_jax.measurements.campaign import BenchRun, Campaign
from edhas_jax.measurements.measurement_model import MeasurementModel

SIGMAS = 3.0  # standard deviations of a shift within which it is sought
SHIFTS_PER_SCAN = 31
FINEST = 0.1  # of a sample interval, to which a shift is found
SWEEPS = 2  # over the clocks, each aligned with the others as they are
MIN_SAMPLES = 10  # of a signal that counts
MIN_FALL = 10.0  # of the cost, from which a shift counts as found

Parts = tuple[BenchRun, ...]  # of one run, one for each time axis
Cost = Callable[[Parts], float]


def with_aligned_clocks(campaign: Campaign, steps_per_sample: int) -> Campaign:
    """A campaign whose records are shifted to one clock, with a remark on every shift that was found.

    Args:
        campaign: its stated accuracy names the clocks.
        steps_per_sample: time steps per sample of the simulations.

    Returns:
        The campaign; itself where it names no clock.
    """
    clocks = campaign.stated_accuracy.clocks
    if not clocks:
        return campaign
    parts, runs, remarks = {}, {}, []
    for run in campaign.runs:
        parts.setdefault(run.whole, []).append(run)
    for of_run in map(tuple, parts.values()):
        measured = any(run.signals for run in of_run)
        shifts = find_clock_shifts(campaign, of_run, steps_per_sample) if measured else {}
        for name, shift in shifts.items():
            recorded, size = ", ".join(clocks[name].names), format_quantity(abs(shift), "s")
            late = "late" if shift > 0.0 else "early"
            sentence = f"the clock of {name} ({recorded}) is {size} {late} in this run; corrected"
            remarks.append(of_run[0].remark(Severity.NOTE, sentence))
            of_run = shifted(of_run, clocks[name], shift)
        runs |= {run.name: run for run in of_run}
    aligned = tuple(runs[run.name] for run in campaign.runs)
    return dataclasses.replace(campaign, runs=aligned, remarks=(*campaign.remarks, *remarks))


def find_clock_shifts(campaign: Campaign, parts: Parts, steps_per_sample: int) -> dict[str, float]:
    """The time [s] by which each clock of a campaign is late in a run; without the clocks that agree.

    Args:
        campaign: its stated accuracy names the clocks; its machine is simulated.
        parts: the parts of the run, one for each time axis.
        steps_per_sample: time steps per sample of the simulations.
    """
    clocks = campaign.stated_accuracy.clocks
    found: dict[str, float] = dict.fromkeys(clocks, 0.0)
    for _ in range(SWEEPS if len(clocks) > 1 else 1):
        for name, clock in clocks.items():
            moved = parts
            for other in (o for o in clocks if o != name):
                moved = shifted(moved, clocks[other], found[other])
            found[name] = _best_shift(moved, clock, lambda parts: _misfit(campaign, parts, steps_per_sample))
    return {name: shift for name, shift in found.items() if shift}


def shifted(parts: Parts, clock: RecorderClock, late: float) -> Parts:
    """A run with what a recorder has written earlier by the time `late` [s]; what it has not recorded is missing (NaN).

    Recorded drives, which all parts of a run have, keep their first or last value there.
    """
    if not late:
        return parts
    recorded = parts[0].drives
    drives = {n: _shifted_record(record, late) if n in clock.names else record for n, record in recorded.items()}
    return tuple(
        dataclasses.replace(run, drives=drives, signals={
            n: np.interp(run.time + late, run.time, v, left=np.nan, right=np.nan) if n in clock.names else v
            for n, v in run.signals.items()
        })
        for run in parts
    )  # fmt: skip


def _shifted_record(record: Recorded, late: float) -> Recorded:
    """A recorded drive earlier by the time `late` [s], at the same times."""
    values = np.asarray(record.values, float)
    index = np.arange(len(values))
    steps = None if record.steps is None else replace(record.steps, times=np.asarray(record.steps.times) - late)
    return replace(record, values=np.interp(index + late / float(record.interval), index, values), steps=steps)


def _best_shift(parts: Parts, clock: RecorderClock, cost: Cost) -> float:
    """The shift [s] of one clock with the smallest cost; 0 where that is hardly smaller."""
    at_zero = cost(parts)
    best, centre, half = at_zero, 0.0, SIGMAS * clock.shift
    while half > FINEST * min(run.interval for run in parts):
        shifts = centre + np.linspace(-half, half, SHIFTS_PER_SCAN)
        costs = [cost(shifted(parts, clock, float(shift))) for shift in shifts]
        if min(costs) < best:
            best, centre = min(costs), float(shifts[int(np.argmin(costs))])
        half *= 2.0 / (SHIFTS_PER_SCAN - 1)
    return centre if at_zero - best > MIN_FALL else 0.0


def _misfit(campaign: Campaign, parts: Parts, steps_per_sample: int) -> float:
    """Σ ½ N ln(1 − ρ²) over the signals of a run; infinite where the model fails."""
    found = MeasurementModel(campaign, campaign.machine, (), parts).predict_all_runs(np.zeros(0), steps_per_sample)
    total = 0.0
    for r, name, measured in ((r, *signal) for r, run in enumerate(parts) for signal in run.signals.items()):
        used = np.isfinite(measured)
        x, y = found[r].values[name][used], measured[used]
        if not np.isfinite(x).all():
            return np.inf
        if len(x) < MIN_SAMPLES or not np.ptp(x) > 0.0 or not np.ptp(y) > 0.0:
            continue
        x, y = x - x.mean(), y - y.mean()
        left = max(1.0 - np.square(x @ y) / ((x @ x) * (y @ y)), np.square(campaign.channels[name].noise) / np.var(y))
        total += 0.5 * len(measured) * np.log(left)
    return float(total)
