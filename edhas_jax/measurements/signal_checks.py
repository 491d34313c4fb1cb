"""What can be wrong with one measured signal, judged by itself and beside the same signal in the other runs."""

from collections.abc import Iterator

import numpy as np

from edhas_jax.core.units import format_quantity, to_si
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.measurements.campaign import BenchRun, Campaign, Remark, Severity
from edhas_jax.measurements.time_axis_checks import GAP_IN_INTERVALS, MAX_JITTER, jitter

STUCK = 10  # equal samples in a row below which nothing is called stuck
OFTEN = 5  # how much more often a clipped signal has its extreme value than any other
OUTLIER = (30.0, 0.2)  # a lone sample is off by more: in deviations of the noise, as a share of the range
SLOW = (1.5, 0.05)  # all samples are off by more, rms: in deviations of the noise, as a share of the signal's
NOISY = 2.0  # noise over what the campaign states
CUBIC_NOISE = np.sqrt(1.0 + 2.0 * (9.0**2 + 1.0) / 16.0**2)  # what `_misfit` makes of white noise of size 1


def check_sensor(campaign: Campaign, run: BenchRun, name: str) -> Iterator[Remark]:
    """Whether the sensor of a signal was stuck or clipped."""
    values, unit = run.signals[name], SIGNALS[name].unit
    if not np.isfinite(values).any():
        return
    low, high = np.nanmin(values), np.nanmax(values)
    if low == high:
        what = f"is {format_quantity(low, unit)} throughout; the sensor is stuck or not connected"
        yield _warning(run, name, 0, what)
        return
    limits = {end for end in (low, high) if _clips(values, end)}
    for first, last in _frozen(values):
        if values[first] not in limits:
            span, value = run.time[last] - run.time[first], format_quantity(values[first], unit)
            what = f"stuck at {value} for {last - first + 1} samples ({format_quantity(span, 's')})"
            yield _warning(run, name, first, what)
    for end in sorted(limits):
        if name == "voltage" and _at_supply(campaign, run, end):
            continue
        at, count = int(np.flatnonzero(values == end)[0]), int((values == end).sum())
        beyond = "below" if end == low else "above"
        what = f"clipped: {count} samples stand at exactly {format_quantity(end, unit)}, none {beyond}"
        yield _warning(run, name, at, what)


def check_quality(campaign: Campaign, run: BenchRun, name: str) -> Iterator[Remark]:
    """Outliers, sampling too slow, noise: how well a sample agrees with the curve through its neighbours."""
    values, channel, unit = run.signals[name], campaign.channels[name], SIGNALS[name].unit
    off = _misfit(run, values)
    if jitter(run) > MAX_JITTER or np.isfinite(off).sum() < 2 * STUCK:
        return
    extent, strength = float(np.subtract(*np.nanpercentile(values, [99, 1]))), float(np.nanstd(values))
    ratio = noise_ratio(campaign, run, name)
    least = max(OUTLIER[0] * CUBIC_NOISE * channel.noise * max(1.0, ratio), OUTLIER[1] * extent)
    size = np.nan_to_num(np.abs(off))
    lone = [k for k in np.flatnonzero(size > least) if size[k] >= size[max(k - 3, 0) : k + 4].max()]
    for k in lone:
        what = f"a lone sample of {format_quantity(values[k + 3], unit)}, far from those around it"
        yield _warning(run, name, k + 3, what)
    if lone:
        return
    # three standard deviations of a mean square are allowed for chance
    chance = 1.0 + 3.0 * np.sqrt(3.0 / np.isfinite(off).sum())
    excess = np.sqrt(max(float(np.nanmean(off**2)) - chance * (CUBIC_NOISE * channel.noise) ** 2, 0.0))
    others = [noise_ratio(campaign, r, name) for r in campaign.runs if r is not run and name in r.signals]
    others = [other for other in others if other > 0.0]
    alike = bool(others) and abs(np.log(np.median(others) / ratio)) < np.log(1.5)
    if excess > max(SLOW[0] * channel.noise, SLOW[1] * strength) and not (ratio > NOISY and alike):
        shares = f"{excess / strength:.0%} of the signal, {excess / channel.noise:.1f} times the noise"
        what = "sampled too slowly for what is in it, or noisier than stated: samples are off the curve through"
        yield _warning(run, name, 0, f"{what} their neighbours by {shares}")
    elif ratio > NOISY:
        size = to_si(f"1 {channel.unit}", unit) - to_si(f"0 {channel.unit}", unit)
        found, stated = (f"{noise / size:.3g} {channel.unit}" for noise in (ratio * channel.noise, channel.noise))
        what = f"its noise is {found}, {ratio:.1f} times the {stated} that the campaign states"
        yield _warning(run, name, 0, what)


def _warning(run: BenchRun, name: str, at: int, what: str) -> Remark:
    return Remark(Severity.WARNING, run.file, int(run.lines[at]), f"{name}: {what}")


def noise_ratio(campaign: Campaign, run: BenchRun, name: str) -> float:
    """The noise of a signal, from its fourth differences (median, so that events do not count), over what is stated."""
    values = run.signals[name]
    fourth = np.abs(np.diff(values, 4))
    moving = np.convolve(np.diff(values) == 0.0, np.ones(4), "valid") == 0.0
    good = fourth[moving & np.isfinite(fourth)]
    if len(good) < STUCK:
        return np.nan
    return float(np.median(good) / 0.6745 / np.sqrt(70.0) / campaign.channels[name].noise)


def _misfit(run: BenchRun, values: np.ndarray) -> np.ndarray:
    """How far samples 3 … n−4 are off the cubic through every other sample around them; NaN beside gaps."""
    v = values
    off = v[3:-3] - (9.0 * (v[2:-4] + v[4:-2]) - v[:-6] - v[6:]) / 16.0
    even = np.diff(run.time) <= GAP_IN_INTERVALS * run.interval
    return np.where(np.convolve(even, np.ones(6), "valid") > 5.5, off, np.nan)


def true_intervals(mask: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of every row of true entries."""
    edges = np.diff(np.concatenate([[0], mask.astype(int), [0]]))
    return list(zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1, strict=True))


def _rows(values: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of every row of equal samples."""
    return [(first, last + 1) for first, last in true_intervals(np.diff(values) == 0.0)]


def _frozen(values: np.ndarray) -> list[tuple[int, int]]:
    """Rows of equal samples too long for a sensor whose last digit moves with its noise."""
    steps = np.abs(np.diff(values))
    steps = steps[np.isfinite(steps)]
    # the last digit is coarser than the noise when a good part of all steps is none: then rows are natural
    long = [(first, last) for first, last in _rows(values) if last - first + 1 >= STUCK]
    inside = sum(last - first for first, last in long)
    if np.sum(steps == 0.0) - inside > 0.2 * max(len(steps) - inside, 1):
        return []
    return long


def _clips(values: np.ndarray, end: float) -> bool:
    """Whether a signal stops at a value: it comes back to exactly that one far more often than to any other."""
    if len(true_intervals(values == end)) < 2:
        return False
    moving = np.isfinite(values)
    for first, last in _rows(values):
        moving[first : last + 1] &= values[first] == end or last - first + 1 < STUCK
    found, counts = np.unique(values[moving], return_counts=True)
    others = counts[found != end]
    return bool((found == end).any()) and counts[found == end][0] >= OFTEN * max(others.max(initial=1), 1)


def _at_supply(campaign: Campaign, run: BenchRun, value: float) -> bool:
    """Whether a command stands at the limit of the supply, where the controller itself stops it."""
    limit = float(campaign.machine_of(run).supply.supply_voltage)
    return abs(abs(value) / limit - 1.0) < 0.01
