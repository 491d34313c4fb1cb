"""Measure the noise of the sensors in the records themselves, without a model, and compare it with what is stated.

In runs that repeat their cycles the differences between cycles give the level and the correlation of the noise. In
other runs only its fast part can be told from the signal, by short local polynomials. Whether the noise is white there
shows in the quietest parts of the records, from which longer polynomials remove the signal too: white noise leaves the
same level in both. Where it is less there, the rest of the fast part is signal. Where it is more, the fast part is a
lower bound, and an autoregressive model of first order gives an upper one; where that cannot explain it, the signal is
nowhere quiet, its own content is in the fast part, and nothing is known of the noise. The rounding of the recorder is
part of the noise.

The noise of a signal is the mean over the runs near the median, so that single disturbed runs do not matter.

A fit refutes a noise that is larger than all that it leaves of the signal (`without_refuted_noise`).
"""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from edhas_jax.core.remark import Remark, Severity
from edhas_jax.core.units import from_si
from edhas_jax.measurements.campaign import BenchRun, Campaign, SignalsByRun
from edhas_jax.measurements.checks import noise_records as records
from edhas_jax.measurements.checks.noise_correlation import Autocovariance, autocorrelation_of, autoregression

MAX_NOISE_DEVIATION = 0.2  # relative; a measured noise that deviates more is said
MAX_STATED_DEVIATION, MAX_STANDARD_ERRORS = 0.05, 5.0  # a measured noise that deviates by more than both is used
MIN_SAMPLES = 200  # of all runs together, for an estimate with an error of a few per cent
MIN_NOISE_OVER_SIGNAL = 1e-5  # standard deviations; a smaller scatter is that of computed or smoothed data
MAX_RUN_DEVIATION = 0.2  # of the noise of a run from the median over the runs, for a share in the mean
MAX_CYCLES_OVER_LOCAL = 1.3  # noise between cycles over its local upper bound; above it the cycles do not repeat
QUIET_SHARE = 0.2  # of the blocks, the quietest
QUIET_MEAN_SQUARE = 0.78  # largest mean square of those of white noise over that of all, from simulated noise
MIN_WHITE_RATIO, MAX_WHITE_RATIO = 0.7, 1.12  # mean square of slow over fast deviations of white noise, with scatter
FAST, SLOW = records.FAST_HALF_WIDTH, records.SLOW_HALF_WIDTH  # samples on either side of the local polynomials
STANDARD_ERROR_LAGS = 200  # sample intervals of correlation that count in the standard error of a measured noise
FIRST_ORDER = np.linspace(0.0, 0.95, 96)  # coefficients of an autoregressive model of first order
MIN_VALUES = 8  # different values of a record; fewer do not show a regular step
SMALLEST_GAPS = 0.5  # share of the gaps between neighbouring values, the smallest, that are mostly one step
MAX_MISS = 0.1  # of a value from a whole number of steps, in steps
MIN_SHARE_ON_STEPS = 0.95  # of the values
MIN_REPEATS = 4.0  # samples of each value on average, from which uneven steps between values are those of a recorder


class MeasuredNoise(NamedTuple):
    """The noise of a signal: bounds of its standard deviation (SI), equal where it was measured in full.

    `fast` is the standard deviation of white noise with the same fast part, `correlation` as in `Channel`, `samples`
    the number of independent samples that the estimate is from.
    """

    low: float
    high: float
    fast: float
    correlation: tuple[float, ...]
    samples: float

    def nearest(self, stated: float | None) -> float:
        """The standard deviation within the bounds that is nearest to the stated one; the upper bound without any."""
        return self.high if stated is None else min(max(stated, self.low), self.high)

    def correlation_at(self, level: float) -> tuple[float, ...]:
        """The correlation of noise of this level; within bounds, that of first order which has the fast part."""
        if self.low == self.high or not math.isfinite(self.high):
            return self.correlation
        ratios = np.array([_mean_square_ratio(a, FAST) for a in FIRST_ORDER])
        coefficient = float(np.interp(-((self.fast / level) ** 2), -ratios, FIRST_ORDER))
        return (coefficient,) if coefficient > 0.0 else ()


def with_measured_noise(campaign: Campaign) -> Campaign:
    """Measure the noise of every signal, and use it where it differs from the stated one or none is stated.

    A measured noise is used where it deviates from the stated one by more than `MAX_STATED_DEVIATION` and by more than
    its own standard error explains. Within bounds the stated noise is used.

    Args:
        campaign: measurements, from which impossible signals are left out.

    Returns:
        The campaign with `Channel.noise` as used, the stated and the measured noise beside it, correlation and
        resolution. Where noise is neither stated nor measured it is NaN.
    """
    channels = {}
    for name, channel in campaign.channels.items():
        stated = channel.noise if channel.stated_noise is None else channel.stated_noise
        stated = stated if math.isfinite(stated) else None
        measured = measure_noise(campaign, name)
        resolution = recorder_resolution([run.signals[name] for run in campaign.runs if name in run.signals])
        if measured is None:
            used, shown, correlation = stated or math.nan, None, ()
        else:
            used = _used_noise(campaign, name, measured, stated)
            shown = measured.nearest(stated)
            if not math.isfinite(measured.high):  # white noise is not above the fast part, which may be signal
                shown = measured.low if stated is not None and stated > measured.low else None
            is_measured = abs(used / measured.nearest(stated) - 1.0) < MAX_NOISE_DEVIATION
            correlation = measured.correlation_at(used) if is_measured else ()
        channels[name] = dataclasses.replace(
            channel, noise=used, sensor_noise=used, stated_noise=stated, measured_noise=shown, correlation=correlation,
            resolution=resolution, is_noise_seen=measured is not None and measured.low == measured.high,
        )  # fmt: skip
    return dataclasses.replace(campaign, channels=channels)


def _used_noise(campaign: Campaign, name: str, measured: MeasuredNoise, stated: float | None) -> float:
    """The standard deviation that weighs a signal (SI)."""
    nearest = measured.nearest(stated)
    smallest = MIN_NOISE_OVER_SIGNAL * max(np.nanstd(run.signals[name]) for run in campaign.runs if name in run.signals)
    if stated is None:
        return max(nearest, float(smallest))
    if not math.isfinite(measured.high) or measured.low < measured.high < stated:
        return stated  # a fit may still refute it
    standard_error = _standard_error(measured.correlation, measured.samples)
    tolerance = max(MAX_STATED_DEVIATION, MAX_STANDARD_ERRORS * standard_error)
    is_used = abs(nearest / stated - 1.0) > tolerance and nearest > smallest
    return nearest if is_used else stated


def _standard_error(coefficients: Sequence[float], samples: float) -> float:
    """The relative standard error of a standard deviation; `coefficients` are those of the noise."""
    correlation = autocorrelation_of(coefficients, STANDARD_ERROR_LAGS)[1:]
    # Bartlett: the variance of a sum of squares grows with the squares of the correlation
    return math.sqrt((1.0 + 2.0 * float(np.sum(np.square(correlation)))) / (2.0 * samples))


def without_refuted_noise(campaign: Campaign, residuals: SignalsByRun, fitted: int) -> Campaign:
    """Lower the noise of the signals of which a fit leaves less than their noise.

    Args:
        campaign: the checked measurements.
        residuals: (measured − model)/noise (samples,) of the fitted runs, by run and signal.
        fitted: how many numbers were fitted to them.

    Returns:
        The campaign with `Channel.fitted_noise`, and the noise in the remarks; the given one where nothing is refuted.
    """
    runs = [run for run in campaign.runs if run.name in residuals]
    left = {name: [] for name in campaign.channels}
    for run in runs:
        for name, row in residuals[run.name].items():
            inside = ~np.isin(run.signals[name], campaign.channels[name].limits)  # beyond them nothing is left
            left[name].append(row[inside & np.isfinite(row)])
    left = {name: np.concatenate(rows) for name, rows in left.items() if rows}
    total = sum(map(len, left.values()))
    channels = dict(campaign.channels)
    for name, row in left.items():
        channel = channels[name]
        if channel.sensor_noise is None or len(row) < MIN_SAMPLES or total < 2 * fitted:
            continue
        level = channel.noise * math.sqrt(float(np.mean(np.square(row))) * total / (total - fitted))
        fall = max(MAX_NOISE_DEVIATION, MAX_STANDARD_ERRORS * _standard_error(channel.correlation, len(row)))
        if 0.0 < level < (1.0 - fall) * channel.sensor_noise:
            noise = math.sqrt(channel.noise**2 - channel.sensor_noise**2 + level**2)
            channels[name] = dataclasses.replace(channel, noise=noise, sensor_noise=level, fitted_noise=level)
    if channels == campaign.channels:
        return campaign
    lowered = dataclasses.replace(campaign, channels=channels)
    before = noise_sentence(campaign)
    others = (remark for remark in campaign.remarks if remark.sentence != before)
    return dataclasses.replace(lowered, remarks=(*noise_remarks(lowered), *others))


def measure_noise(campaign: Campaign, name: str) -> MeasuredNoise | None:
    """Measure the noise of a signal; None where its records are too short or uneven."""
    runs = [run for run in campaign.runs if name in run.signals]
    between_cycles = (records.cycle_residuals(run, name, campaign.machine_of(run)) for run in runs)
    whole = _pooled([found for residuals in between_cycles if (found := records.autocovariance_of(residuals))])
    local = _local_noise(runs, name)
    resolution = recorder_resolution([run.signals[name] for run in runs])
    rounding = resolution / math.sqrt(12.0)
    if whole is not None and (local is None or whole.level <= MAX_CYCLES_OVER_LOCAL * max(local.high, rounding)):
        level = max(whole.level, rounding)
        return MeasuredNoise(level, level, level, autoregression(whole), whole.samples)
    if local is None:
        return None
    low, high, fast = (max(level, rounding) for level in local[:3])
    return MeasuredNoise(low, high, fast, local.correlation, local.samples)


def _pooled(found: list[Autocovariance]) -> Autocovariance | None:
    """The noise of several runs: the mean of those near their median level; None where they are too short."""
    found = [one for one in found if one.level > 0.0]
    samples = sum(one.samples for one in found)
    if samples < MIN_SAMPLES:
        return None
    median = _weighted_median([one.level for one in found], [one.samples for one in found])
    near = [one for one in found if abs(one.level / median - 1.0) < MAX_RUN_DEVIATION] or found
    used = sum(one.samples for one in near)
    level = math.sqrt(sum(one.samples * one.level**2 for one in near) / used)
    correlation = sum(one.samples * one.values / one.values[0] for one in near) / used
    return Autocovariance(level**2 * correlation, samples)


def _weighted_median(values: list[float], weights: list[float]) -> float:
    """The median of values, each as often as its weight; the lower one of two."""
    order = np.argsort(values)
    share = np.cumsum(np.array(weights)[order])
    return float(np.array(values)[order][np.searchsorted(share, 0.5 * share[-1])])


def _local_noise(runs: list[BenchRun], name: str) -> MeasuredNoise | None:
    """The noise of a signal from local polynomials; None where its records are too short or uneven."""
    levels, samples, quiet = [], [], []
    for run in runs:
        level, fast, slow = records.fast_noise(run, name), *(records.local_residual(run, name, w) for w in (FAST, SLOW))
        if slow is None or not level > 0.0:
            continue
        margin = SLOW - FAST
        used = records.without_signal(fast.values)[margin : len(fast.values) - margin]
        levels.append(level)
        samples.append(float(np.isfinite(used).sum()))
        squares = records.block_mean_squares(np.where(np.isfinite(used), slow.values, np.nan))
        ratios = squares / slow.white_gain / level**2
        quiet.append(ratios[np.isfinite(ratios)])
    if sum(samples) < MIN_SAMPLES:
        return None
    level = _weighted_median(levels, samples)
    quiet = np.concatenate(quiet)
    ratio = float(np.quantile(quiet, QUIET_SHARE)) / QUIET_MEAN_SQUARE if len(quiet) else 1.0
    low, high, correlation = level, level, ()
    if ratio < MIN_WHITE_RATIO:
        low = math.sqrt(ratio) * level
    elif ratio >= MAX_WHITE_RATIO:
        ratios = [_mean_square_ratio(a, SLOW) / _mean_square_ratio(a, FAST) for a in FIRST_ORDER]
        high = math.inf  # the signal is nowhere quiet
        if ratio <= ratios[-1]:
            correlation = (float(np.interp(ratio, ratios, FIRST_ORDER)),)
            high = level / math.sqrt(_mean_square_ratio(*correlation, FAST))
    return MeasuredNoise(low, high, level, correlation, sum(samples))


def _mean_square_ratio(coefficient: float, half_width: int) -> float:
    """Mean square of the deviations of noise of first order from local polynomials, over that of white noise."""
    gain = records.polynomial_gain(half_width)
    middle = len(gain) // 2
    correlation = autocorrelation_of((coefficient,), middle)
    return float(gain[middle] + 2.0 * gain[middle + 1 :] @ correlation[1:]) / float(gain[middle])


def noise_sentence(campaign: Campaign) -> str | None:
    """Where stated and measured noise differ, as one sentence for the beginning of every result; None if nowhere."""
    used, kept, refuted = [], [], []
    for name, channel in campaign.channels.items():
        stated, measured, fitted = channel.stated_noise, channel.measured_noise, channel.fitted_noise
        unit = campaign.machine.signals[name].unit
        size = from_si(1.0, unit, channel.unit) - from_si(0.0, unit, channel.unit)
        levels = ((level, word) for level, word in ((stated, "stated"), (measured, "measured")) if level)
        told = ", ".join(f"{size * level:.3g} {channel.unit} {word}" for level, word in levels)
        if fitted is not None:
            refuted.append(f"{size * fitted:.3g} {channel.unit} of {name} ({told})")
        elif stated is not None and measured is not None and abs(measured / stated - 1.0) > MAX_NOISE_DEVIATION:
            (used if channel.sensor_noise == measured else kept).append(f"{name} {told}")
    sentences = [f"Stated and measured noise differ: {'; '.join(used + kept)}."] if used or kept else []
    several = sum(map(bool, (used, kept, refuted))) > 1
    reason = ": without repeated cycles only the fast part of the noise can be measured"
    for texts, what, why in ((used, "measured", ""), (kept, "stated", reason)):
        names = f" for {', '.join(text.partition(' ')[0] for text in texts)}" if several else ""
        sentences += [f"The {what} noise is used{names}{why}."] if texts else []
    if refuted:
        sentences.append(f"The fit leaves only {', '.join(refuted)}: the noise cannot be larger, and that is used.")
    return " ".join(sentences) or None


def noise_remarks(campaign: Campaign) -> list[Remark]:
    """The `noise_sentence` as a remark on the campaign's file; empty where there is none."""
    sentence = noise_sentence(campaign)
    return [] if sentence is None else [campaign.remark(Severity.WARNING, sentence)]


def noise_as_json(campaign: Campaign) -> dict[str, dict[str, Any]]:
    """Stated, measured, fitted and used noise of every signal of a checked campaign (SI); None where there is none."""
    return {
        name: {
            "stated": channel.stated_noise, "measured": channel.measured_noise,
            "fitted": channel.fitted_noise, "used": channel.noise,
            "unit": campaign.machine.signals[name].unit,
        }
        for name, channel in campaign.channels.items()
    }  # fmt: skip


def recorder_resolution(rows: Iterable[np.ndarray]) -> float:
    """The step between neighbouring values of a recorder.

    Args:
        rows: the values of a signal (samples,) in each run (SI).

    Returns:
        The largest step of any run (SI); 0 if the values are continuous, or the step is too fine to be seen. Of steps
        that grow with the value, as of numbers with three digits, the root mean square over the samples.
    """
    found = [values[np.isfinite(values)] for values in rows]
    return max(map(_step, found), default=0.0) or _mean_step(np.concatenate([np.zeros(0), *found]))


def _mean_step(values: np.ndarray) -> float:
    """The root mean square of uneven steps between neighbouring values; 0 where values hardly repeat."""
    levels, counts = np.unique(values, return_counts=True)
    if len(levels) < MIN_VALUES or len(values) < MIN_REPEATS * len(levels):
        return 0.0
    return math.sqrt(float(np.average(np.square(np.gradient(levels)), weights=counts)))


def _step(values: np.ndarray) -> float:
    levels = np.unique(values)
    if len(levels) < MIN_VALUES:
        return 0.0
    gaps = np.diff(levels)
    step = float(np.median(np.sort(gaps)[: max(1, int(SMALLEST_GAPS * len(gaps)))]))
    # from gap to gap first: over the whole range the error of one gap would add up
    steps, used = np.concatenate([[0.0], np.cumsum(np.round(gaps / step))]), np.ones(len(levels), bool)
    for _ in range(2):
        if np.ptp(steps[used]) == 0.0:
            return 0.0
        step, first = (float(c) for c in np.polyfit(steps[used], levels[used], 1))
        if not step > 0.0:
            return 0.0
        steps = np.round((levels - first) / step)
        misses = np.abs((levels - first) / step - steps)
        used = misses < MAX_MISS
        if used.mean() < MIN_SHARE_ON_STEPS:
            return 0.0
    return step
