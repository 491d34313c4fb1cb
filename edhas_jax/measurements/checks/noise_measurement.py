"""Measure the noise of the sensors in the records themselves, without a model, and compare it with what is stated.

Runs with a sine set point repeat their cycles: the difference of two samples a whole number of cycles apart is noise,
white or not, plus slow changes from cycle to cycle, which a moving average removes. Where no number of cycles is a
whole number of samples, the later cycle is interpolated, and the error of that makes it an upper bound. Without
repeated cycles only the fast part of the noise can be told from the signal, by fourth differences: a lower bound. All
estimates leave the largest tenth of their samples out, which holds spikes and events that differ from cycle to cycle,
and include the error of rounding to the resolution of the recorder. The noise of a signal is the median over its runs;
of the fast part it is the smallest, because fast changes of the signal itself add to it.

Source: Pintelon, Schoukens, System Identification, 2nd ed. (2012), ch. 4, for the noise from repeated cycles.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from edhas_jax.core.units import from_si
from edhas_jax.machine.components.set_points import Sine
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.rigs import ActuatorSystem, Rig
from edhas_jax.measurements.campaign import BenchRun, Campaign, Channel
from edhas_jax.measurements.checks.time_axis_checks import GAP_IN_INTERVALS, MAX_JITTER, jitter

MAX_NOISE_DEVIATION = 0.2  # relative; a measured noise that deviates more is said and, from repeated cycles, used
MIN_SAMPLES = 200  # of all runs together, for an estimate with an error of a few per cent
MIN_RUN_SAMPLES = 40  # of one run
DRIFT_WINDOW = 41  # samples; slower differences between cycles are not noise
MAX_SHIFT_ERROR = 0.02  # samples by which whole cycles may miss a whole number of samples
MAX_CYCLES_APART = 6
MIN_SAMPLES_PER_CYCLE = 4.0  # fewer do not show the signal between them
TRIMMED_SHARE = 0.1  # of the samples, the largest, which are left out
MIN_NOISE_OVER_SIGNAL = 1e-5  # standard deviations; a smaller scatter is that of computed or smoothed data
# standard deviation of the samples that remain after trimming a standard normal distribution
_LIMIT = 1.6448536269514722
TRIMMED_STD = math.sqrt(
    1.0 - 2.0 * _LIMIT * math.exp(-0.5 * _LIMIT**2) / math.sqrt(2.0 * math.pi) / (1.0 - TRIMMED_SHARE)
)
FOURTH_DIFFERENCE_GAIN = math.sqrt(70.0)  # of white noise: 1² + 4² + 6² + 4² + 1² = 70


class MeasuredNoise(NamedTuple):
    """Bounds of the standard deviation of the noise of a signal (SI); equal where it was measured between cycles."""

    low: float
    high: float

    def nearest(self, stated: float) -> float:
        """The standard deviation within the bounds that is nearest to the stated one."""
        return min(max(stated, self.low), self.high)


def with_measured_noise(campaign: Campaign) -> Campaign:
    """Replace the stated noise by the measured one where the two differ.

    The measured noise is used where it deviates by more than `MAX_NOISE_DEVIATION`. Of a bound only the side that
    contradicts the stated noise counts.

    Args:
        campaign: measurements, from which impossible signals are left out.

    Returns:
        The campaign with `Channel.noise` as used, and the stated and the measured noise beside it.
    """
    channels = {}
    for name, channel in campaign.channels.items():
        stated = channel.noise if channel.stated_noise is None else channel.stated_noise
        measured = measure_noise(campaign, name)
        if measured is None:
            channels[name] = dataclasses.replace(channel, stated_noise=stated)
            continue
        nearest = measured.nearest(stated)
        is_used = abs(nearest / stated - 1.0) > MAX_NOISE_DEVIATION and not _is_too_small(campaign, name, nearest)
        # a lower bound alone is shown, though it does not contradict a larger stated noise
        shown = nearest if math.isfinite(measured.high) else measured.low
        channels[name] = Channel(channel.unit, nearest if is_used else stated, stated, shown)
    return dataclasses.replace(campaign, channels=channels)


def measure_noise(campaign: Campaign, name: str) -> MeasuredNoise | None:
    """Measure the noise of a signal; None where its records are too short."""
    exact = _scatter_of_runs(campaign, name, cycle_scatter, np.median)
    if exact is not None:
        return MeasuredNoise(exact, exact)
    low = _scatter_of_runs(campaign, name, fast_scatter, np.min)
    high = _scatter_of_runs(campaign, name, interpolated_cycle_scatter, np.median)
    if low is None:
        return None if high is None else MeasuredNoise(0.0, high)
    return MeasuredNoise(low, math.inf) if high is None else MeasuredNoise(min(low, high), high)


def _scatter_of_runs(campaign: Campaign, name: str, scatter: Callable, of_runs: Callable) -> float | None:
    """The median or smallest standard deviation of a scatter in the runs; None where there are too few samples."""
    parts = [scatter(run, name, campaign.machine_of(run)) for run in campaign.runs if name in run.signals]
    parts = [part for part in parts if len(part) >= MIN_RUN_SAMPLES]
    return float(of_runs([trimmed_std(part) for part in parts])) if sum(map(len, parts)) >= MIN_SAMPLES else None


def cycle_scatter(run: BenchRun, name: str, machine: Rig) -> np.ndarray:
    """Differences of samples whole cycles apart (samples,), scaled to the standard deviation of white noise.

    Empty where no number of cycles is a whole number of samples.
    """
    values, lags = _settled_cycles(run, name, machine)
    misses = np.abs(lags - np.round(lags))
    if not len(lags) or misses.min() >= MAX_SHIFT_ERROR:
        return np.zeros(0)
    shift = round(lags[np.argmax(misses < MAX_SHIFT_ERROR)])
    return _without_slow_changes(values[:-shift] - values[shift:]) / math.sqrt(2.0)


def interpolated_cycle_scatter(run: BenchRun, name: str, machine: Rig) -> np.ndarray:
    """As `cycle_scatter`, but the later cycle is interpolated by cubics, whose error adds to the noise."""
    values, lags = _settled_cycles(run, name, machine)
    if not len(lags):
        return np.zeros(0)
    shift = math.floor(lags[0])
    weights = _cubic_weights(lags[0] - shift)
    later = np.convolve(values[shift - 1 :], weights[::-1], "valid")
    return _without_slow_changes(values[: len(later)] - later) / math.sqrt(1.0 + float(weights @ weights))


def _settled_cycles(run: BenchRun, name: str, machine: Rig) -> tuple[np.ndarray, np.ndarray]:
    """A signal after the ramp of its set point, and the whole cycles, in samples, over which it can be compared."""
    period = cycle_length(machine)
    if period is None:
        return np.zeros(0), np.zeros(0)
    values, first = on_even_grid(run, name), float(machine.reference.ramp_time) - run.time[0]
    values = values[max(0, math.ceil(first / run.interval)) :]
    if period < MIN_SAMPLES_PER_CYCLE * run.interval:
        return np.zeros(0), np.zeros(0)
    lags = period / run.interval * np.arange(1, MAX_CYCLES_APART + 1)
    return values, lags[lags < len(values) - 0.5 * period / run.interval]


def _without_slow_changes(difference: np.ndarray) -> np.ndarray:
    """Differences between cycles without their moving average (samples,), scaled so that white noise keeps its size."""
    if len(difference) < DRIFT_WINDOW:
        return np.zeros(0)
    used, window = np.isfinite(difference), np.ones(DRIFT_WINDOW)
    in_window = np.convolve(used, window, "same")
    slow = np.convolve(np.where(used, difference, 0.0), window, "same") / np.maximum(in_window, 1.0)
    used &= in_window == DRIFT_WINDOW
    return (difference - slow)[used] / math.sqrt(1.0 - 1.0 / DRIFT_WINDOW)


def fast_scatter(run: BenchRun, name: str, machine: Rig | None = None) -> np.ndarray:
    """Fourth differences (samples,) scaled to the standard deviation of white noise; constant stretches left out."""
    if jitter(run) > MAX_JITTER:
        return np.zeros(0)
    values = on_even_grid(run, name)
    fourth = np.diff(values, 4) / FOURTH_DIFFERENCE_GAIN
    moving = np.convolve(np.diff(values) == 0.0, np.ones(4), "valid") < 3.5
    return fourth[moving & np.isfinite(fourth)]


def trimmed_std(values: np.ndarray) -> float:
    """Standard deviation of normally distributed values (samples,) about 0, from all but the largest tenth."""
    size = np.sort(np.abs(values))[: max(1, int((1.0 - TRIMMED_SHARE) * len(values)))]
    return float(np.sqrt(np.mean(size**2))) / TRIMMED_STD


def cycle_length(machine: Rig) -> float | None:
    """The period of a sine set point [s]; None for any other."""
    if not isinstance(machine.reference, Sine) or isinstance(machine, ActuatorSystem):
        return None
    return 1.0 / float(machine.reference.frequency)


def on_even_grid(run: BenchRun, name: str) -> np.ndarray:
    """The samples of a signal on a grid at the sample interval; NaN in gaps. Uneven samples as they are."""
    values, steps = run.signals[name], np.diff(run.time)
    if not (steps > GAP_IN_INTERVALS * run.interval).any() or jitter(run) > MAX_JITTER:
        return values
    index = np.round((run.time - run.time[0]) / run.interval).astype(int)
    grid = np.full(index[-1] + 1, np.nan)
    grid[index] = values
    return grid


def _cubic_weights(fraction: float) -> np.ndarray:
    """Weights of the samples at −1, 0, 1, 2 whose cubic has its value at a fraction of the interval from 0 to 1."""
    f = fraction
    return np.array([
        -f * (f - 1.0) * (f - 2.0) / 6.0, (f + 1.0) * (f - 1.0) * (f - 2.0) / 2.0,
        -(f + 1.0) * f * (f - 2.0) / 2.0, (f + 1.0) * f * (f - 1.0) / 6.0,
    ])  # fmt: skip


def _is_too_small(campaign: Campaign, name: str, noise: float) -> bool:
    """Whether a scatter is so small that the data are computed or smoothed rather than measured."""
    extents = [np.nanstd(run.signals[name]) for run in campaign.runs if name in run.signals]
    return noise < MIN_NOISE_OVER_SIGNAL * float(max(extents))


def noise_sentence(campaign: Campaign) -> str | None:
    """Where stated and measured noise differ, as one sentence for the beginning of every result; None if nowhere."""
    used, kept = [], []
    for name, channel in campaign.channels.items():
        stated, measured = channel.stated_noise, channel.measured_noise
        if stated is None or measured is None or abs(measured / stated - 1.0) <= MAX_NOISE_DEVIATION:
            continue
        size = from_si(1.0, SIGNALS[name].unit, channel.unit) - from_si(0.0, SIGNALS[name].unit, channel.unit)
        text = f"{name} {size * stated:.3g} {channel.unit} stated, {size * measured:.3g} {channel.unit} measured"
        (used if channel.noise == measured else kept).append(text)
    if not used and not kept:
        return None
    endings = []
    if used:
        endings.append("The measured noise is used" + (f" for {_names(used)}." if kept else "."))
    if kept:
        reason = "without repeated cycles only the fast part of the noise can be measured"
        endings.append("The stated noise is used" + (f" for {_names(kept)}" if used else "") + f": {reason}.")
    return f"Stated and measured noise differ: {'; '.join(used + kept)}. " + " ".join(endings)


def _names(texts: list[str]) -> str:
    return ", ".join(text.partition(" ")[0] for text in texts)


def noise_as_json(campaign: Campaign) -> dict[str, dict[str, Any]]:
    """Stated, measured and used noise of every signal (SI)."""
    return {
        name: {
            "stated": channel.noise if channel.stated_noise is None else channel.stated_noise,
            "measured": channel.measured_noise, "used": channel.noise, "unit": SIGNALS[name].unit,
        }
        for name, channel in campaign.channels.items()
    }  # fmt: skip
