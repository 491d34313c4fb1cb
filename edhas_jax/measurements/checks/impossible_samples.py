"""Find the samples of a signal that cannot be right: spikes and drop-outs, a stuck sensor, a sensor at its limit."""

import math
from collections.abc import Mapping

import numpy as np

from edhas_jax.core.units import format_quantity
from edhas_jax.measurements.campaign import BenchRun, Campaign, Remark, Severity
from edhas_jax.measurements.checks.held_values import find_held_values
from edhas_jax.measurements.checks.noise_records import cycle_length, even_index
from edhas_jax.measurements.checks.outlier_search import Record, find_outliers
from edhas_jax.measurements.checks.signal_checks import (
    is_clipped_at,
    is_sensor_limit,
    is_supply_limit,
    stuck_intervals,
    true_intervals,
)
from edhas_jax.measurements.checks.spike_detection import find_spikes

MIN_MODEL_MOTION = 10.0  # motion of the model, in standard deviations of the noise, while a sensor is stuck
MIN_MODEL_ERRORS = 3.0  # the same, in standard deviations of what the model may leave
MIN_MODEL_STEPS = 3.0  # the same, in steps of the sensor's resolution
MIN_DRIVE_MOTION = 0.02  # of the range of a recorded drive, from which it moves
MAX_LISTED = 5  # spikes of a signal whose times are listed

Models = Mapping[str, Mapping[str, np.ndarray]]


def find_signal_outliers(campaign: Campaign, name: str, models: Models) -> dict[str, np.ndarray]:
    """Find the single samples of a signal that deviate moderately from their neighbours, in all runs together.

    Args:
        campaign: gives the runs and the noise.
        name: name of the signal.
        models: signals of the model (samples,) at the time stamps, by run and signal, SI.

    Returns:
        A mask (samples,) by run; without those that are sampled unevenly.
    """
    channel, places, records = campaign.channels[name], {}, []
    for run in campaign.runs:
        if name not in run.signals or (index := even_index(run)) is None:
            continue
        values, model = np.full(index[-1] + 1, np.nan), None
        values[index] = run.signals[name]
        if run.name in models:
            model = np.interp(np.arange(len(values)), index, models[run.name][name])
        machine = campaign.machine_of(run)
        period = cycle_length(machine)
        begin = 0.0 if period is None else (float(machine.reference.ramp_time) - run.time[0]) / run.interval
        records.append(Record(values, model, run.interval, period, max(0, math.ceil(begin))))
        places[run.name] = index
    masks = find_outliers(records, channel.noise, channel.correlation)
    return {run: mask[index] for (run, index), mask in zip(places.items(), masks, strict=True)}


def find_impossible_samples(
    campaign: Campaign, run: BenchRun, name: str, models: Models, outliers: np.ndarray | None = None
) -> tuple[np.ndarray, list[Remark]]:
    """Find the samples of a signal that are left out.

    Args:
        campaign: gives the machine and the noise.
        run: the run.
        name: name of the signal.
        models: signals of the model (samples,) at the time stamps, by run and signal, SI.
        outliers: samples that deviate moderately from their neighbours (samples,); see `find_signal_outliers`.

    Returns:
        A mask (samples,), and a remark for each kind with the run, the times and the reason.
    """
    channel, unit = campaign.channels[name], campaign.machine.signals[name].unit
    values, noise = run.signals[name], channel.noise
    model = models[run.name][name] if run.name in models else None
    machine = campaign.machine_of(run)
    smallest_motion = max(MIN_MODEL_MOTION * noise, MIN_MODEL_ERRORS * channel.model_error)
    smallest_motion = max(smallest_motion, MIN_MODEL_STEPS * _resolution(values))
    found, remarks = np.zeros(len(values), bool), []

    def remark(severity: Severity, mask: np.ndarray, sentence: str) -> None:
        remarks.append(Remark(severity, run.file, int(run.lines[int(np.argmax(mask))]), f"{name}: {sentence}"))

    def judge(mask: np.ndarray, sentence: str) -> None:
        """Leave samples of one value out if the model moves meanwhile; without a model, only say so."""
        sentence = sentence.format(count=int(mask.sum()))
        if model is None:
            remark(Severity.WARNING, mask, sentence)
        elif np.ptp(model[mask]) > smallest_motion and _is_driven(run, mask):
            found[mask] = True
            remark(Severity.ERROR, mask, f"{sentence}, while the model moves; left out")

    if not np.isfinite(values).any():
        return found, remarks
    low, high = np.nanmin(values), np.nanmax(values)
    limits = [v for v in (low, high) if low < high and is_clipped_at(values, v)]
    for limit in limits:
        if is_sensor_limit(campaign, name, limit) or name == "voltage" and is_supply_limit(campaign, run, limit):
            continue
        beyond = "below" if limit == low else "above"
        text = format_quantity(limit, unit)
        judge(values == limit, f"clipped: {{count}} samples are exactly {text}, none is {beyond}")
    for first, last in [(0, len(values) - 1)] if low == high else stuck_intervals(values):
        if values[first] in limits:
            continue
        mask = np.zeros(len(values), bool)
        mask[first : last + 1] = True
        value, duration = format_quantity(values[first], unit), format_quantity(run.time[last] - run.time[first], "s")
        start = format_quantity(run.time[first], "s")
        is_all = "; is the sensor connected?" if low == high else ""
        judge(mask, f"stuck at {value} for {{count}} samples ({duration} from {start}){is_all}")
    period = cycle_length(machine)
    ramp_time = float(machine.reference.ramp_time) if period is not None else math.inf
    if low < high:
        held = find_held_values(values, noise, channel.resolution) & ~found
        if held.any():
            found |= held
            remark(Severity.ERROR, held, f"{_held_text(run, held)}; left out")
        spikes = find_spikes(run, name, noise, model, period, ramp_time)
        spikes = (spikes if outliers is None else spikes | outliers) & ~found
        if spikes.any():
            found |= spikes
            remark(Severity.ERROR, spikes, f"{_spike_text(run, values, spikes, unit)}; left out")
    return found, remarks


def _is_driven(run: BenchRun, mask: np.ndarray) -> bool:
    """Whether a recorded drive moves during some samples, true without any; else a model may swing, a machine rest."""
    times = run.time[mask]
    for record in run.drives.values():
        if np.ptp(record.sampled(times)) > MIN_DRIVE_MOTION * np.ptp(record.sampled(run.time)):
            return True
    return not run.drives


def _resolution(values: np.ndarray) -> float:
    """The smallest step from one sample to the next; 0 for a constant signal."""
    steps = np.abs(np.diff(values))
    return float(np.min(steps[steps > 0.0], initial=np.inf)) if (steps > 0.0).any() else 0.0


def _held_text(run: BenchRun, held: np.ndarray) -> str:
    """How many samples repeat the one before, and when."""
    intervals = true_intervals(held)
    times = [format_quantity(run.time[first], "s") for first, _ in intervals[:MAX_LISTED]]
    more = f" and {len(intervals) - MAX_LISTED} more" if len(intervals) > MAX_LISTED else ""
    places = "1 place" if len(intervals) == 1 else f"{len(intervals)} places"
    what = f"{held.sum()} samples in {places} repeat the one before, a drop-out of the recorder"
    return f"{what}: {', '.join(times)}{more}"


def _spike_text(run: BenchRun, values: np.ndarray, spikes: np.ndarray, unit: str) -> str:
    """How many spikes and drop-outs there are, when, and their size."""
    intervals = true_intervals(spikes)
    regular = values[~spikes & np.isfinite(values)]

    def extreme(first: int, last: int) -> float:
        part = values[first : last + 1]
        return float(part[np.argmax(np.abs(part - np.median(regular)))])

    def text(first: int, last: int) -> str:
        return f"{format_quantity(extreme(first, last), unit)} at {format_quantity(run.time[first], 's')}"

    listed = [text(*interval) for interval in intervals[:MAX_LISTED]]
    if len(intervals) == 1:
        count = int(spikes.sum())
        samples = "1 sample" if count == 1 else f"{count} samples"
        return f"an isolated outlier of {listed[0]} ({samples}), far from its neighbours and from other cycles"
    more = f" and {len(intervals) - MAX_LISTED} more" if len(intervals) > MAX_LISTED else ""
    count = f"{len(intervals)} isolated outliers ({spikes.sum()} samples)"
    return f"{count}, far from their neighbours and from other cycles: {', '.join(listed)}{more}"
