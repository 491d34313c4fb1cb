"""Links of sensor chains for varied cases, none of which is among those for judging."""

import numpy as np
from scipy.signal import bessel, cheby1, lfilter

from studies.hidden_effects.generators.chains import Link, Place

RIPPLE = 1.0  # dB, of the Chebyshev filter in its pass band
WAVERING = 3.0  # Hz, at which the rate of a clock varies


def _from_rest(trace, b, a):
    """The trace behind a digital filter (b, a) that is in steady state at the first sample."""
    return (trace[0] * b.sum() / a.sum()) + lfilter(b, a, trace - trace[0])


def _fourth_order_bessel(interval, trace, cutoff):
    """Bessel low-pass of fourth order: a delay without overshoot."""
    return _from_rest(trace, *bessel(4, cutoff, fs=1.0 / interval))


def _third_order_chebyshev(interval, trace, cutoff):
    """Chebyshev low-pass of third order, whose gain varies within its pass band."""
    return _from_rest(trace, *cheby1(3, RIPPLE, cutoff, fs=1.0 / interval))


def _wavering_clock(times, size):
    """A clock whose error goes up and down."""
    return times + size * np.sin(2.0 * np.pi * WAVERING * times)


def _moving_average_noise(rng, count, weight):
    """n_k + w n_{k−1} + w² n_{k−2}, scaled to unit standard deviation."""
    white = rng.standard_normal(count + 2)
    noise = white[2:] + weight * white[1:-1] + weight**2 * white[:-2]
    return noise / np.sqrt(1.0 + weight**2 + weight**4)


def _ringing_noise(rng, count, radius):
    """Noise with a resonance at a fifth of the sampling rate, scaled to unit standard deviation."""
    first, second = 2.0 * radius * np.cos(2.0 * np.pi / 5.0), -(radius**2)
    variance = (1.0 - second) / ((1.0 + second) * ((1.0 - second) ** 2 - first**2))
    noise = lfilter([1.0], [1.0, -first, -second], rng.standard_normal(count + 300))[300:]
    return noise / np.sqrt(variance)


def _slow_noise(rng, count, share):
    """White noise and a first-order process with a correlation of 0.88, which has a `share` of the variance."""
    slow = lfilter([1.0], [1.0, -0.88], np.sqrt(1.0 - 0.88**2) * rng.standard_normal(count + 200))[200:]
    return np.sqrt(share) * slow + np.sqrt(1.0 - share) * rng.standard_normal(count)


def _held_values(rng, samples, noise, share):
    """Data transmission that drops out: the last value is repeated, 2 … 12 equal samples in a row."""
    out = samples.copy()
    for start in np.flatnonzero(rng.uniform(size=len(samples)) < share / 7.0):
        out[start : start + int(rng.integers(2, 13))] = out[start]
    return out


def _coarse_converter(rng, samples, noise, steps):
    """A converter whose steps are a few times the noise."""
    return steps * noise * np.round(samples / (steps * noise))


LINKS = (
    Link("fourth_order_bessel", Place.SIGNAL, _fourth_order_bessel, (600.0, 2000.0)),
    Link("third_order_chebyshev", Place.SIGNAL, _third_order_chebyshev, (600.0, 1800.0), everywhere=False),
    Link("wavering_clock", Place.CLOCK, _wavering_clock, (2e-5, 2e-4)),
    Link("moving_average_noise", Place.NOISE, _moving_average_noise, (0.3, 0.9)),
    Link("ringing_noise", Place.NOISE, _ringing_noise, (0.3, 0.8)),
    Link("slow_noise", Place.NOISE, _slow_noise, (0.1, 0.4)),
    Link("held_values", Place.SAMPLES, _held_values, (2e-3, 2e-2), everywhere=False),
    Link("coarse_converter", Place.SAMPLES, _coarse_converter, (1.0, 6.0)),
)
