"""Find the samples of a signal that cannot be right: spikes and drop-outs, a stuck sensor, a sensor at its limit."""

import math

import numpy as np

from edhas_jax.core.remark import Remark, Severity
from edhas_jax.core.units import format_quantity
from edhas_jax.core.wording import counted, listed
from edhas_jax.machine.components.controllers import Supply
from edhas_jax.measurements.campaign import BenchRun, Campaign, Channel, Removal, SignalsByRun
from edhas_jax.measurements.checks.noise_records import cycle_length, even_index
from edhas_jax.measurements.checks.outlier_search import Record, find_excursions, find_outliers
from edhas_jax.measurements.checks.repeated_values import (
    find_held_values,
    is_clipped_at,
    stuck_intervals,
    true_intervals,
)

MIN_MOTION = 10.0  # of another signal, or of the model, in standard deviations of its noise while a sensor is stuck
MIN_MODEL_ERRORS = 3.0  # the same of the model, in standard deviations of what the model may leave
MIN_MODEL_STEPS = 3.0  # the same of the model, in steps of the sensor's resolution
MIN_DRIVE_MOTION = 0.02  # of the range of a recorded drive, from which it moves
MIN_NOISE_OVER_RESOLUTION = 1.0  # of a sensor that cannot repeat a value by chance for long
MAX_STUCK = 2  # intervals at which a sensor is stuck; a recorder that writes changes only leaves more
MAX_LISTED = 5  # spikes of a signal whose times are listed


def find_signal_outliers(
    campaign: Campaign, name: str, models: SignalsByRun, with_excursions: bool = True
) -> dict[str, np.ndarray]:
    """Find the spikes and drop-outs of a signal, in all runs together.

    Args:
        campaign: gives the runs and the noise.
        name: name of the signal.
        models: signals of the model (samples,) at the time stamps, by run and signal, SI.
        with_excursions: whether large ones count too, besides single wrong samples of moderate size.

    Returns:
        A mask (samples,) by run. In runs that are sampled unevenly, or mostly missing, only large excursions are found.
    """
    channel, places, records, found = campaign.channels[name], {}, [], {}
    noise = max(channel.noise, channel.stated_noise or 0.0)  # a smaller scatter is no fault by the user's own words
    for run in campaign.runs:
        if name not in run.signals:
            continue
        index, model = even_index(run), None if run.name not in models else models[run.name][name]
        if index is None or index[-1] > 2 * len(index):
            record = Record(run.signals[name], model, run.interval, None, 0)
            found[run.name] = find_excursions(record, noise) if with_excursions else np.zeros(len(run.time), bool)
            continue
        values = np.full(index[-1] + 1, np.nan)
        values[index] = run.signals[name]
        if model is not None:
            model = np.interp(np.arange(len(values)), index, model)
        machine = campaign.machine_of(run)
        period = cycle_length(machine)
        begin = 0.0 if period is None else (float(machine.reference.ramp_time) - run.time[0]) / run.interval
        records.append(Record(values, model, run.interval, period, max(0, math.ceil(begin))))
        places[run.name] = index
    masks = find_outliers(records, noise, channel.correlation, with_excursions)
    return found | {run: mask[index] for (run, index), mask in zip(places.items(), masks, strict=True)}


def find_impossible_samples(
    campaign: Campaign, run: BenchRun, name: str, models: SignalsByRun, outliers: np.ndarray, noise_ratio: float
) -> tuple[np.ndarray, list[Remark]]:
    """Find the samples of a signal that are left out, because the records alone prove that they are wrong.

    The model proves nothing: where a sensor seems to be stuck or clipped, but the records do not show the noise that it
    should have, a remark is all.

    Args:
        campaign: gives the machine and the noise.
        run: the run.
        name: name of the signal.
        models: signals of the model (samples,) at the time stamps, by run and signal, SI.
        outliers: spikes and drop-outs (samples,); see `find_signal_outliers`.
        noise_ratio: fast part of the noise over the noise of the signal in most runs; see `noise_ratios`.

    Returns:
        A mask (samples,), and a remark for each kind with the run, the times, the reason and the share. For a signal
        that the run keeps the mask is false everywhere.
    """
    channel, unit = campaign.channels[name], campaign.machine.signals[name].unit
    values = run.signals[name]
    resolution = max(channel.resolution, _resolution(values))
    is_noisy = channel.is_noise_seen and noise_ratio * channel.noise >= MIN_NOISE_OVER_RESOLUTION * resolution
    found, remarks, unproven = np.zeros(len(values), bool), [], []

    def leave_out(mask: np.ndarray, sentence: str) -> None:
        nonlocal found
        found = found | mask
        remarks.append(left_out_remark(run, name, mask, sentence))

    def judge(mask: np.ndarray, sentence: str, is_proven: bool) -> None:
        """Leave samples of one value out where that is proven; else say so, unless the model rests meanwhile too."""
        sentence = sentence.format(count=int(mask.sum()))
        if is_proven:
            leave_out(mask, sentence)
        elif run.name not in models or _model_moves(channel, run, mask, models[run.name][name], resolution):
            unproven.append((int(np.argmax(mask)), sentence))

    if not np.isfinite(values).any():
        return found, remarks
    low, high = np.nanmin(values), np.nanmax(values)
    limits = [v for v in (low, high) if low < high and is_clipped_at(values, v)]
    for limit in limits:
        if _is_sensor_limit(campaign, name, limit) or name == "voltage" and _is_supply_limit(campaign, run, limit):
            continue
        beyond = "below" if limit == low else "above"
        text = format_quantity(limit, unit)
        sentence = f"clipped: {{count}} samples are exactly {text}, none is {beyond}"
        judge(values == limit, sentence, is_noisy and limit != 0.0)
    equal = [(0, len(values) - 1)] if low == high else stuck_intervals(values)
    ends = [value for value in {values[first] for first, _ in equal} if _is_sensor_limit(campaign, name, value)]
    stuck = [(first, last) for first, last in equal if values[first] not in (*limits, *ends)]
    for first, last in stuck:
        mask = np.zeros(len(values), bool)
        mask[first : last + 1] = True
        value, duration = format_quantity(values[first], unit), format_quantity(run.time[last] - run.time[first], "s")
        start = format_quantity(run.time[first], "s")
        is_all = "; is the sensor connected?" if low == high else ""
        # sensors of speed and flow show exactly zero at rest, without noise
        may_prove = is_noisy and values[first] != 0.0 and len(stuck) <= MAX_STUCK
        sentence = f"stuck at {value} for {{count}} samples ({duration} from {start}){is_all}"
        judge(mask, sentence, may_prove and _others_move(campaign, run, name, mask))
    if low < high:
        held = find_held_values(values, channel.noise, channel.resolution) & ~found & channel.is_noise_seen
        if held.any():
            leave_out(held, _held_text(run, held))
        spikes = outliers & ~found
        if spikes.any():
            has_cycles = cycle_length(campaign.machine_of(run)) is not None
            leave_out(spikes, _spike_text(run, values, spikes, unit, has_cycles))
    if unproven:
        more = f", and {len(unproven) - 1} more such places" if len(unproven) > 1 else ""
        first, sentence = unproven[0]
        remarks.append(run.warning(f"{name}: {sentence}{more}; used, as the records prove no fault", first))
    return (np.zeros(len(values), bool) if name in run.keep else found), remarks


def left_out_remark(run: BenchRun, name: str, mask: np.ndarray, sentence: str) -> Remark:
    """The remark on samples (mask) of a signal that are left out, or kept where the campaign says so."""
    share = f"{100.0 * np.count_nonzero(mask) / len(mask):.2g} % of the record"
    if name in run.keep:
        return run.warning(f"{name}: {sentence}; {share}, kept as the campaign says", int(np.argmax(mask)))
    return run.remark(Severity.ERROR, f"{name}: {sentence}; {share}; left out", int(np.argmax(mask)))


def removal_of(run: BenchRun, name: str, mask: np.ndarray) -> Removal:
    """How many samples (mask) of a signal are left out."""
    count = int(np.count_nonzero(mask))
    return Removal(run.name, name, count, count / len(mask))


def _is_sensor_limit(campaign: Campaign, name: str, value: float) -> bool:
    """Whether a value is an end of the range that the campaign states for the sensor."""
    limits = [limit for limit in campaign.channels[name].limits if np.isfinite(limit)]
    return any(abs(value - limit) <= 1e-6 * abs(limit) + 1e-12 for limit in limits)


def _is_supply_limit(campaign: Campaign, run: BenchRun, value: float) -> bool:
    """Whether a command stands at the supply voltage, where the controller itself limits it."""
    supply = getattr(campaign.machine_of(run), "supply", None)
    return isinstance(supply, Supply) and abs(abs(value) / float(supply.supply_voltage) - 1.0) < 0.01


def _others_move(campaign: Campaign, run: BenchRun, name: str, mask: np.ndarray) -> bool:
    """Whether the other measured signals and the recorded drives, some of each where there are any, move meanwhile."""
    others = [n for n in run.signals if n != name]
    moving = [_range(run.signals[n][mask]) > MIN_MOTION * campaign.channels[n].noise for n in others]
    return bool(run.drives or others) and _is_driven(run, mask) and (any(moving) or not others)


def _range(values: np.ndarray) -> float:
    values = values[np.isfinite(values)]
    return float(np.ptp(values)) if len(values) else 0.0


def _model_moves(channel: Channel, run: BenchRun, mask: np.ndarray, model: np.ndarray, resolution: float) -> bool:
    smallest = max(MIN_MOTION * channel.noise, MIN_MODEL_ERRORS * channel.model_error, MIN_MODEL_STEPS * resolution)
    return np.ptp(model[mask]) > smallest and _is_driven(run, mask)


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
    times = listed([format_quantity(run.time[first], "s") for first, _ in intervals], MAX_LISTED)
    places = counted(len(intervals), "place")
    return f"{held.sum()} samples in {places} repeat the one before, a drop-out of the recorder: {times}"


def _spike_text(run: BenchRun, values: np.ndarray, spikes: np.ndarray, unit: str, has_cycles: bool) -> str:
    """How many spikes and drop-outs there are, when, and their size."""
    intervals = true_intervals(spikes)
    regular = values[~spikes & np.isfinite(values)]

    def text(first: int, last: int) -> str:
        part = values[first : last + 1]
        extreme = float(part[np.argmax(np.abs(part - np.median(regular)))])
        return f"{format_quantity(extreme, unit)} at {format_quantity(run.time[first], 's')}"

    places = [text(*interval) for interval in intervals]
    cycles = " and from other cycles" if has_cycles else ""
    if len(intervals) == 1:
        samples = counted(int(spikes.sum()), "sample")
        return f"an isolated outlier of {places[0]} ({samples}), far from its neighbours{cycles}"
    count = f"{len(intervals)} isolated outliers ({spikes.sum()} samples)"
    return f"{count}, far from their neighbours{cycles}: {listed(places, MAX_LISTED)}"
