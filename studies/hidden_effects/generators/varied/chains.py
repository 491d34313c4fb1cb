"""Links of sensor chains for varied cases: filters, clocks, noise, converters and statements of other kinds."""

import numpy as np
from scipy.signal import bessel, butter, lfilter

from studies.hidden_effects.generators.chains import Link, Place


def _filtered(interval, trace, design, order, cutoff):
    b, a = design(order, cutoff, fs=1.0 / interval)
    return trace[0] + lfilter(b, a, trace - trace[0])


def _first_order(interval, trace, cutoff):
    """Low-pass of first order."""
    return _filtered(interval, trace, butter, 1, cutoff)


def _fourth_order_bessel(interval, trace, cutoff):
    """Bessel low-pass of fourth order: a delay without overshoot."""
    return _filtered(interval, trace, bessel, 4, cutoff)


def _mean_of_samples(interval, trace, window):
    """The mean over a window that ends at the sample."""
    width = max(round(window / interval), 1)
    padded = np.concatenate([np.full(width - 1, trace[0]), trace])
    return np.convolve(padded, np.full(width, 1.0 / width), mode="valid")


def _late(times, lag):
    """The recorder starts after the machine."""
    return times + lag


def _fast_clock(times, share):
    """A clock that runs fast."""
    return times * (1.0 - share)


def _moving_average_noise(rng, count, weight):
    """n_k + w n_{k−1} + w² n_{k−2}, scaled to unit standard deviation."""
    white = rng.standard_normal(count + 2)
    noise = white[2:] + weight * white[1:-1] + weight**2 * white[:-2]
    return noise / np.sqrt(1.0 + weight**2 + weight**4)


def _wandering_noise(rng, count, share):
    """White noise and a slow part with a share of its variance, correlated over 60 samples."""
    slow = lfilter([np.sqrt(1.0 - 0.9835**2)], [1.0, -0.9835], rng.standard_normal(count + 500))[500:]
    return np.sqrt(1.0 - share) * rng.standard_normal(count) + np.sqrt(share) * slow


def _bursts(rng, samples, noise, share):
    """Short bursts of 3 … 8 samples with 5 … 15 times the noise."""
    out = samples.copy()
    for start in np.flatnonzero(rng.uniform(size=len(samples)) < share / 5.0):
        length = int(rng.integers(3, 9))
        part = out[start : start + length]
        part += noise * rng.uniform(5.0, 15.0) * rng.standard_normal(len(part))
    return out


def _held_values(rng, samples, noise, share):
    """A transmission that fails now and then: the last value is repeated for 2 … 12 samples."""
    out = samples.copy()
    for start in np.flatnonzero(rng.uniform(size=len(samples)) < share / 7.0):
        out[start : start + int(rng.integers(2, 13))] = out[start]
    return out


def _coarse_converter(rng, samples, noise, steps):
    """A converter whose steps are a few times the noise."""
    return steps * noise * np.round(samples / (steps * noise))


def _each_by_itself(rng, spread):
    """Each signal's stated noise is off by a factor of its own."""
    return float(np.exp(rng.uniform(-1.0, 1.0) * np.log(spread)))


LINKS = (
    Link("first_order", Place.SIGNAL, _first_order, (400.0, 2000.0)),
    Link("fourth_order_bessel", Place.SIGNAL, _fourth_order_bessel, (600.0, 2000.0)),
    Link("mean_of_samples", Place.SIGNAL, _mean_of_samples, (0.2e-3, 1e-3), everywhere=False),
    Link("late_trigger", Place.CLOCK, _late, (0.05e-3, 0.5e-3)),
    Link("fast_clock", Place.CLOCK, _fast_clock, (1e-4, 1e-3)),
    Link("moving_average_noise", Place.NOISE, _moving_average_noise, (0.3, 0.9)),
    Link("wandering_noise", Place.NOISE, _wandering_noise, (0.05, 0.5)),
    Link("bursts", Place.SAMPLES, _bursts, (1e-3, 1e-2), everywhere=False),
    Link("held_values", Place.SAMPLES, _held_values, (2e-3, 2e-2), everywhere=False),
    Link("coarse_converter", Place.SAMPLES, _coarse_converter, (1.0, 6.0)),
    Link("each_noise_stated_wrong", Place.STATEMENT, _each_by_itself, (1.5, 4.0)),
)
