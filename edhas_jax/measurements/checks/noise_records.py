"""Parts of a record that hold its noise but not its signal: differences between cycles, deviations from polynomials.

A run with a sine set point repeats its cycles: the difference of two samples whole cycles apart is noise, white or not,
plus slow changes from cycle to cycle, which a moving average removes. Where the cycle is no whole number of samples the
later one is interpolated; the variance that this removes is known. Elsewhere a local polynomial takes the signal out.

A residual still holds the signal where that is sharp. Therefore it is divided into blocks, and those whose mean square
exceeds that of the others by more than chance are left out, spikes before.

Source: Pintelon, Schoukens, System Identification, 2nd ed. (2012), ch. 4, for the noise from repeated cycles.
"""

import functools
import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import median_filter

from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import BenchRun
from edhas_jax.measurements.checks.noise_correlation import LAGS, Autocovariance, lagged_products, restore
from edhas_jax.measurements.checks.time_axis_checks import GAP_IN_INTERVALS, MAX_JITTER, jitter

DRIFT_HALF_WIDTH = 20  # samples on either side of a moving average; slower differences between cycles are not noise
FAST_HALF_WIDTH, SLOW_HALF_WIDTH, DEGREE = 3, 12, 4  # of the local polynomials
MAX_SHIFT_ERROR = 0.02  # samples by which whole cycles may miss a whole number of samples
MAX_CYCLES_APART = 6
MIN_SAMPLES_PER_CYCLE = 4.0  # fewer do not show the signal between them
BLOCK = 32  # samples that are judged together
BLOCK_FREEDOM = 0.6  # of the samples of a block that count as independent
MAX_BLOCK_DEVIATION = 3.5  # standard deviations of the mean square of a block above that of the others
MIN_BLOCKS = 3
MAX_SQUARE_RATIO = 1.1  # of the mean squares of two residuals of a record, beyond their scatter
SPIKE_WINDOW, MAX_NOISE_DEVIATION = 9, 5.0  # samples of a running median, standard deviations from it


class Residual(NamedTuple):
    """A part of a record without its signal: values (samples,), NaN where unusable, and what noise became in it.

    `gain` is the autocorrelation of the coefficients through which the noise went, lag 0 in the middle.
    """

    values: np.ndarray
    gain: np.ndarray

    @property
    def white_gain(self) -> float:
        """Mean square of the residual of white noise over that of the noise."""
        return float(self.gain[len(self.gain) // 2])


def cycle_length(machine: Rig) -> float | None:
    """The period of a sine set point [s]; None for any other."""
    if machine.cycle is None:
        return None
    return 1.0 / float(machine.reference.frequency)


def even_index(run: BenchRun) -> np.ndarray | None:
    """The place of each sample (samples,) on a grid at the sample interval; None for uneven samples."""
    if jitter(run) > MAX_JITTER:
        return None
    if not (np.diff(run.time) > GAP_IN_INTERVALS * run.interval).any():
        return np.arange(len(run.time))
    return np.round((run.time - run.time[0]) / run.interval).astype(int)


def on_even_grid(run: BenchRun, name: str) -> np.ndarray:
    """The samples of a signal on a grid at the sample interval; NaN in gaps. Uneven samples as they are."""
    values, index = run.signals[name], even_index(run)
    if index is None or index[-1] + 1 == len(values):
        return values
    grid = np.full(index[-1] + 1, np.nan)
    grid[index] = values
    return grid


def cycle_residuals(run: BenchRun, name: str, machine: Rig) -> list[Residual]:
    """Differences of samples 1, 2, … cycles apart, without slow changes; empty for a run without repeated cycles."""
    period = cycle_length(machine)
    if period is None or period < MIN_SAMPLES_PER_CYCLE * run.interval or jitter(run) > MAX_JITTER:
        return []
    values, begin = on_even_grid(run, name), float(machine.reference.ramp_time) - run.time[0]
    values = values[max(0, math.ceil(begin / run.interval)) :]
    per_cycle, width = period / run.interval, 2 * DRIFT_HALF_WIDTH + 1
    residuals = []
    for cycles in range(1, MAX_CYCLES_APART + 1):
        shift, weights = _interpolation(cycles * per_cycle)
        if len(values) - shift - len(weights) < width + MIN_BLOCKS * BLOCK:
            break
        later = np.convolve(values[shift:], weights[::-1], "valid")
        both = np.correlate(weights, weights, "full")
        both[len(weights) - 1] += 1.0
        residuals.append(_filtered(values[: len(later)] - later, _deviation_from_polynomial(DRIFT_HALF_WIDTH, 0), both))
    return residuals


def local_residual(run: BenchRun, name: str, half_width: int) -> Residual | None:
    """Deviations of a signal from polynomials through the samples around each; None for uneven or short records.

    Where all of these samples are equal, at rest or from a stuck sensor, there is nothing to see: NaN.
    """
    values = on_even_grid(run, name)
    if jitter(run) > MAX_JITTER or len(values) < 2 * half_width + MIN_BLOCKS * BLOCK:
        return None
    coefficients = _deviation_from_polynomial(half_width, DEGREE)
    found = np.convolve(values, coefficients, "valid")
    found[sliding_window_view(np.diff(values) == 0.0, 2 * half_width).all(axis=1)] = np.nan
    return Residual(found, polynomial_gain(half_width))


@functools.lru_cache
def polynomial_gain(half_width: int) -> np.ndarray:
    """The `gain` of a local residual."""
    coefficients = _deviation_from_polynomial(half_width, DEGREE)
    return np.correlate(coefficients, coefficients, "full")


def fast_noise(run: BenchRun, name: str) -> float:
    """Standard deviation of white noise with the fast part of a signal in one run (SI); NaN where it cannot be seen."""
    residual = local_residual(run, name, FAST_HALF_WIDTH)
    used = np.zeros(0) if residual is None else without_signal(residual.values)
    return math.sqrt(float(np.nanmean(used**2)) / residual.white_gain) if np.isfinite(used).any() else math.nan


def autocovariance_of(residuals: Iterable[Residual]) -> Autocovariance | None:
    """The autocovariance of the noise in residuals of one record; None where too little of them is free of signal."""
    parts = [(residual, *lagged_products(without_signal(residual.values))) for residual in residuals]
    parts = [part for part in parts if part[2][-1] > 0.5 * MIN_BLOCKS * BLOCK]
    if not parts:
        return None
    squares = [products[0] / numbers[0] / residual.white_gain for residual, products, numbers in parts]
    sums, gain, samples = np.zeros(LAGS + 1), np.zeros(1), 0.0
    for square, (residual, products, numbers) in zip(squares, parts, strict=True):
        # cycles some numbers apart may repeat less than others, where the supply hums for example
        if square <= min(squares) * (MAX_SQUARE_RATIO + MAX_BLOCK_DEVIATION * math.sqrt(2.0 / numbers[0])):
            sums = sums + numbers[0] * products / numbers
            gain = _sum_about_middle(gain, numbers[0] * residual.gain)
            samples = max(samples, numbers[0])  # all residuals of a record hold the same noise
    return Autocovariance(restore(sums, gain), samples)


def _interpolation(shift: float) -> tuple[int, np.ndarray]:
    """The first sample and the weights by which a record is read at a shift in samples; cubic between samples."""
    if abs(shift - round(shift)) < MAX_SHIFT_ERROR:
        return round(shift), np.ones(1)
    first = math.floor(shift)
    f = shift - first
    return first - 1, np.array([
        -f * (f - 1.0) * (f - 2.0) / 6.0, (f + 1.0) * (f - 1.0) * (f - 2.0) / 2.0,
        -(f + 1.0) * f * (f - 2.0) / 2.0, (f + 1.0) * f * (f - 1.0) / 6.0,
    ])  # fmt: skip


def _deviation_from_polynomial(half_width: int, degree: int) -> np.ndarray:
    """Coefficients (2 · half width + 1,) of the deviation of a sample from the polynomial fitted to those around it."""
    powers = np.vander(np.arange(-half_width, half_width + 1) / half_width, degree + 1)
    coefficients = -np.linalg.lstsq(powers, np.eye(len(powers)), rcond=None)[0][-1]
    coefficients[half_width] += 1.0
    return coefficients


def _filtered(values: np.ndarray, coefficients: np.ndarray, noise: np.ndarray) -> Residual:
    """The residual of values after a symmetric filter; `noise` is the autocorrelation by which noise is in them."""
    missing = ~np.isfinite(values)
    bridged = values
    if missing.any() and not missing.all():
        bridged = np.interp(np.arange(len(values)), np.flatnonzero(~missing), values[~missing])
    middle = median_filter(bridged, SPIKE_WINDOW, mode="nearest")
    deviation = bridged - middle
    missing |= np.abs(deviation) > MAX_NOISE_DEVIATION * _scale(deviation)
    half = len(coefficients) // 2
    found = np.convolve(np.where(missing, middle, values), coefficients, "valid")
    found[missing[half : len(missing) - half]] = np.nan
    return Residual(found, np.convolve(np.correlate(coefficients, coefficients, "full"), noise))


def _scale(values: np.ndarray) -> float:
    """A standard deviation that a few large values, or many equal ones, do not change much."""
    median, outer = np.nanpercentile(np.abs(values), [50.0, 90.0])
    return max(median / 0.6745, outer / 1.6449)


def block_mean_squares(values: np.ndarray) -> np.ndarray:
    """Mean square of every block of a residual (samples,); infinite where too few of its samples can be used."""
    count = len(values) // BLOCK
    blocks = values[: count * BLOCK].reshape(count, BLOCK)
    numbers = np.isfinite(blocks).sum(axis=1)
    return np.where(numbers > BLOCK / 2, np.nansum(blocks**2, axis=1) / np.maximum(numbers, 1), np.inf)


def without_signal(values: np.ndarray) -> np.ndarray:
    """A residual (samples,) with NaN in the blocks where it still holds the signal."""
    squares = block_mean_squares(values)
    limit = 1.0 + MAX_BLOCK_DEVIATION * math.sqrt(2.0 / (BLOCK_FREEDOM * BLOCK))
    kept = np.isfinite(squares) & (squares <= np.median(squares))
    while kept.any():
        level = float(np.mean(squares[kept]))
        grown = squares <= limit * level if level > 0.0 else np.isfinite(squares)
        if not (grown & ~kept).any():
            break
        kept |= grown
    found = np.where(np.repeat(kept, BLOCK), values[: len(kept) * BLOCK], np.nan)
    return np.append(found, np.full(len(values) - len(found), np.nan))


def _sum_about_middle(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The sum of two symmetric arrays of odd length, the middles on each other."""
    length = max(len(one), len(other))
    return sum(np.pad(part, (length - len(part)) // 2) for part in (one, other))
