"""Links of sensor chains, for tuning."""

import numpy as np
from scipy.signal import butter, lfilter

from studies.hidden_effects.generators.chains import Link, Place


def _second_order(interval, trace, cutoff):
    """Butterworth low-pass of second order, in steady state at the start."""
    b, a = butter(2, cutoff, fs=1.0 / interval)
    return trace[0] + lfilter(b, a, trace - trace[0])


def _early(times, lead):
    """The recorder starts before the machine."""
    return times - lead


def _first_order_noise(rng, count, correlation):
    """e_k = a e_{k−1} + √(1 − a²) n_k."""
    innovation = np.sqrt(1.0 - correlation**2) * rng.standard_normal(count + 200)
    return lfilter([1.0], [1.0, -correlation], innovation)[200:]


def _spikes(rng, samples, noise, share):
    """Single samples that are off by 10 … 40 times the noise."""
    hit = rng.uniform(size=len(samples)) < share
    return samples + hit * noise * rng.uniform(10.0, 40.0, len(samples)) * rng.choice([-1.0, 1.0], len(samples))


def _twelve_bits(rng, samples, noise, headroom):
    """A converter of 12 bit whose range is `headroom` times the largest value of the run."""
    step = 2.0 * headroom * np.nanmax(np.abs(samples)) / 2**12
    return step * np.round(samples / step)


def _common_factor(rng, factor):
    return factor


LINKS = (
    Link("second_order_filter", Place.SIGNAL, _second_order, (600.0, 1500.0)),
    Link("trigger_early", Place.CLOCK, _early, (0.05e-3, 0.4e-3)),
    Link("first_order_noise", Place.NOISE, _first_order_noise, (0.2, 0.7)),
    Link("spikes", Place.SAMPLES, _spikes, (5e-4, 4e-3), everywhere=False),
    Link("twelve_bits", Place.SAMPLES, _twelve_bits, (1.2, 2.5)),
    Link("noise_stated_wrong", Place.STATEMENT, _common_factor, (0.4, 2.5)),
)
