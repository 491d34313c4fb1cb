"""Links of sensor chains, for the earlier judging set."""

import numpy as np
from scipy.signal import lfilter

from studies.hidden_effects.generators.chains import Link, Place


def _first_order(interval, trace, time):
    """A first-order low-pass filter, in steady state at the start."""
    decay = np.exp(-interval / time)
    return trace[0] + lfilter([1.0 - decay], [1.0, -decay], trace - trace[0])


def _moving_average(interval, trace, window):
    """The mean over the last `window` seconds."""
    n = max(1, round(window / interval))
    return np.convolve(np.concatenate([np.full(n - 1, trace[0]), trace]), np.full(n, 1.0 / n), mode="valid")


def _late(times, delay):
    """The recorder starts after the machine."""
    return times + delay


def _fast_clock(times, error):
    """A recorder whose clock runs fast."""
    return times / (1.0 + error)


def _flicker_noise(rng, count, share):
    """White noise and flicker noise, whose power falls with the frequency and which has a `share` of the variance.

    The flicker noise is a sum of processes of first order, of equal variance, with times of 4 to 256 samples.
    """
    flicker = np.zeros(count)
    for time in (4.0, 16.0, 64.0, 256.0):
        decay = np.exp(-1.0 / time)
        flicker += lfilter([1.0], [1.0, -decay], np.sqrt(1.0 - decay**2) * rng.standard_normal(count + 1500))[1500:]
    return np.sqrt(share / 4.0) * flicker + np.sqrt(1.0 - share) * rng.standard_normal(count)


def _bursts(rng, samples, noise, rate):
    """Two to four samples in a row that are off by the same 8 … 25 times the noise."""
    out = samples.copy()
    for start in np.flatnonzero(rng.uniform(size=len(samples)) < rate):
        out[start : start + rng.integers(2, 5)] += noise * rng.uniform(8.0, 25.0) * rng.choice([-1.0, 1.0])
    return out


def _missing(rng, samples, noise, rate):
    """Gaps of 1 … 8 samples."""
    out = samples.copy()
    for start in np.flatnonzero(rng.uniform(size=len(samples)) < rate):
        out[start : start + rng.integers(1, 9)] = np.nan
    return out


def _own_factor(rng, spread):
    """Noise that is stated wrongly, by another factor for each signal."""
    return float(np.exp(rng.uniform(-np.log(spread), np.log(spread))))


LINKS = (
    Link("first_order_filter", Place.SIGNAL, _first_order, (0.1e-3, 0.3e-3)),
    Link("moving_average", Place.SIGNAL, _moving_average, (0.2e-3, 0.8e-3)),
    Link("trigger_late", Place.CLOCK, _late, (0.05e-3, 0.4e-3)),
    Link("clock_fast", Place.CLOCK, _fast_clock, (1e-4, 1e-3)),
    Link("flicker_noise", Place.NOISE, _flicker_noise, (0.05, 0.3)),
    Link("bursts", Place.SAMPLES, _bursts, (2e-4, 1.5e-3), everywhere=False),
    Link("missing_samples", Place.SAMPLES, _missing, (5e-4, 5e-3), everywhere=False),
    Link("noise_stated_wrong_by_signal", Place.STATEMENT, _own_factor, (1.6, 2.5)),
)
