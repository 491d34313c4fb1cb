"""Links of sensor chains, for judging."""

import numpy as np
from scipy.signal import bilinear, lfilter

from studies.hidden_effects.generators.chains import Link, Place

TRANSDUCER_DAMPING = 0.25  # damping ratio of a pressure transducer with its line
SWITCHING = 0.02  # probability per sample that telegraph noise changes its sign
FULL_SCALE = 1000.0  # of a sensor, over its noise


def _underdamped_transducer(interval, trace, natural_frequency):
    """A lightly damped low-pass filter of second order, as a pressure transducer with its line; steady at the start."""
    omega = 2.0 * np.pi * natural_frequency
    b, a = bilinear([omega**2], [1.0, 2.0 * TRANSDUCER_DAMPING * omega, omega**2], 1.0 / interval)
    return trace[0] + lfilter(b, a, trace - trace[0])


def _decimation_filter(interval, trace, window):
    """The decimation filter of a sigma-delta converter: three moving averages over `window` seconds in series."""
    n = max(1, round(window / interval))
    for _ in range(3):
        trace = np.convolve(np.concatenate([np.full(n - 1, trace[0]), trace]), np.full(n, 1.0 / n), mode="valid")
    return trace


def _clock_that_warms_up(times, drift):
    """A sampling clock whose rate error grows in proportion to time as it warms up."""
    return times + 0.5 * drift * times**2


def _interleaved_converters(times, skew):
    """Two interleaved converters, which sample in turn; the second one is late by `skew` [s]."""
    return times + skew * (np.arange(len(times)) % 2)


def _differenced_noise(rng, count, weight):
    """White noise as n_k − w n_{k−1}, scaled to unit standard deviation: more power at high frequencies."""
    white = rng.standard_normal(count + 1)
    return (white[1:] - weight * white[:-1]) / np.sqrt(1.0 + weight**2)


def _telegraph_noise(rng, count, share):
    """White noise plus random telegraph noise, which jumps between two values and has a `share` of the variance."""
    level = rng.choice([-1.0, 1.0]) * np.cumprod(np.where(rng.uniform(size=count) < SWITCHING, -1.0, 1.0))
    return np.sqrt(share) * level + np.sqrt(1.0 - share) * rng.standard_normal(count)


def _ringing_glitches(rng, samples, noise, rate):
    """Impulses of 8 … 30 times the noise that ring: eight samples of alternating sign, each 0.6 times the last."""
    out = samples.copy()
    ringing = (-0.6) ** np.arange(8)
    for start in np.flatnonzero(rng.uniform(size=len(samples)) < rate):
        part = out[start : start + 8]
        part += noise * rng.uniform(8.0, 30.0) * rng.choice([-1.0, 1.0]) * ringing[: len(part)]
    return out


def _lost_stretch(rng, samples, noise, share):
    """A gap in every record, of a `share` of its samples."""
    out, length = samples.copy(), max(1, round(share * len(samples)))
    start = rng.integers(len(samples) - length + 1)
    out[start : start + length] = np.nan
    return out


def _gain_ranging_converter(rng, samples, noise, steps):
    """A converter that selects its range for each sample, a power of two, and divides it into `steps` steps."""
    ends = np.exp2(np.ceil(np.log2(np.maximum(np.abs(samples), noise))))
    return ends / steps * np.round(samples * steps / ends)


def _curved_characteristic(rng, samples, noise, error):
    """A sensor with a quadratic nonlinearity of `error` times full scale at full scale."""
    full_scale = FULL_SCALE * noise
    return samples + error * full_scale * np.square(samples / full_scale)


def _peak_to_peak(rng, factor):
    """Noise that is stated from peak to peak, as a multiple of its standard deviation."""
    return factor


LINKS = (
    Link("underdamped_transducer", Place.SIGNAL, _underdamped_transducer, (400.0, 1500.0), everywhere=False),
    Link("decimation_filter", Place.SIGNAL, _decimation_filter, (0.1e-3, 0.4e-3)),
    Link("clock_warms_up", Place.CLOCK, _clock_that_warms_up, (5e-4, 4e-3)),
    Link("interleaved_converters", Place.CLOCK, _interleaved_converters, (8e-6, 6e-5)),
    Link("differenced_noise", Place.NOISE, _differenced_noise, (0.3, 0.8)),
    Link("telegraph_noise", Place.NOISE, _telegraph_noise, (0.1, 0.4)),
    Link("ringing_glitches", Place.SAMPLES, _ringing_glitches, (2e-4, 1.5e-3), everywhere=False),
    Link("lost_stretch", Place.SAMPLES, _lost_stretch, (0.01, 0.06), everywhere=False),
    Link("gain_ranging_converter", Place.SAMPLES, _gain_ranging_converter, (500.0, 3000.0)),
    Link("curved_characteristic", Place.SAMPLES, _curved_characteristic, (1e-3, 5e-3), everywhere=False),
    Link("noise_stated_peak_to_peak", Place.STATEMENT, _peak_to_peak, (3.0, 6.6), everywhere=False),
)
