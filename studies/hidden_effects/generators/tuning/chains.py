"""Links of sensor chains, for the tuning cases."""

import math

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from studies.hidden_effects.generators.chains import Link, Place

SIDE = 0.25  # by which the lead exceeds the lag that it should cancel
DECADE = 10.0


def _lagged(trace, pole):
    """The trace after a first-order lag that is in steady state at the start."""
    return trace[0] + lfilter([1.0 - pole], [1.0, -pole], trace - trace[0])


def _three_poles(interval, trace, time):
    """A low-pass filter of three equal first-order lags in series, in steady state at the start."""
    pole = np.exp(-interval / time)
    for _ in range(3):
        trace = _lagged(trace, pole)
    return trace


def _compensated(interval, trace, time):
    """A transducer whose lag is compensated with a time constant that is 25 % off: (1 + 1.25 τ s)/(1 + τ s)."""
    pole = np.exp(-interval / time)
    return trace + SIDE * (trace - _lagged(trace, pole))


def _smoothed(interval, trace, time):
    """Smoothing without phase lag in software: a Gaussian window with this standard deviation."""
    return gaussian_filter1d(trace, time / interval, mode="nearest")


def _buffer_overrun(times, lost):
    """A recorder that loses a block of this duration two fifths into each record, without a gap in its time stamps."""
    return times + lost * (times > 0.4 * times[-1])


def _unsteady_clock(times, size):
    """A clock whose error oscillates along the record, in the same way in all runs."""
    return times + size * np.sin(2.0 * np.pi * 37.0 * times) * np.sin(2.0 * np.pi * 5.3 * times)


def _heavy_tails(rng, count, share):
    """Heavy-tailed noise: this share of the samples is three times as noisy; scaled to unit standard deviation."""
    size = np.where(rng.uniform(size=count) < share, 3.0, 1.0)
    return size * rng.standard_normal(count) / np.sqrt(1.0 + 8.0 * share)


def _line_noise(rng, count, share):
    """White noise plus a hum of 0.017 cycles per sample and random phase, which has this share of the variance."""
    hum = np.sqrt(2.0 * share) * np.sin(2.0 * np.pi * 0.017 * np.arange(count) + rng.uniform(0.0, 2.0 * np.pi))
    return hum + np.sqrt(1.0 - share) * rng.standard_normal(count)


def _growing_noise(rng, count, growth):
    """Noise that grows linearly along the record, by `growth` times its initial level; of unit standard deviation."""
    size = np.linspace(1.0, 1.0 + growth, count)
    return size * rng.standard_normal(count) / np.sqrt(np.mean(size**2))


def _send_on_delta(rng, samples, noise, band):
    """Send-on-delta transmission: a value is sent only when it has changed by more than `band` times the noise."""
    out, sent = samples.copy(), samples[0]
    for k, value in enumerate(samples):
        sent = value if abs(value - sent) > band * noise else sent
        out[k] = sent
    return out


def _companding(rng, samples, noise, steps):
    """A companding A/D converter: its step is `steps` times the noise at zero and grows with the value."""
    scale = 20.0 * noise
    curved = np.sign(samples) * np.log1p(np.abs(samples) / scale)
    rounded = np.round(curved * 20.0 / steps) * steps / 20.0
    return np.sign(rounded) * scale * np.expm1(np.abs(rounded))


def _drifting_gain(rng, samples, noise, size):
    """Gain drift along the record, within the accuracy of the sensor."""
    return samples * (1.0 + rng.choice([-1.0, 1.0]) * size * np.linspace(-0.5, 0.5, len(samples)))


def _sensor_hysteresis(rng, samples, noise, size):
    """Hysteresis of a sensor: it reads low while its signal rises and high while it falls, within its accuracy."""
    return samples - size * np.nanmax(np.abs(samples)) * np.tanh(np.gradient(samples) / (noise + 1e-12))


def _not_stated(rng, value):
    """The noise is not stated."""
    return math.nan


def _rounded_up(rng, factor):
    """The stated noise is half a decade too large or too small, times a further factor."""
    return DECADE ** rng.choice([-0.5, 0.5]) * factor


LINKS = (
    Link("three_poles", Place.SIGNAL, _three_poles, (2e-5, 1.2e-4), everywhere=False),
    Link("compensated_transducer", Place.SIGNAL, _compensated, (1e-4, 2e-3), everywhere=False),
    Link("smoothing_software", Place.SIGNAL, _smoothed, (1e-4, 5e-4)),
    Link("buffer_overrun", Place.CLOCK, _buffer_overrun, (5e-5, 4e-4)),
    Link("unsteady_clock", Place.CLOCK, _unsteady_clock, (2e-5, 1.5e-4)),
    Link("heavy_tails", Place.NOISE, _heavy_tails, (0.02, 0.15)),
    Link("line_noise", Place.NOISE, _line_noise, (0.1, 0.5)),
    Link("growing_noise", Place.NOISE, _growing_noise, (0.5, 3.0)),
    Link("send_on_delta", Place.SAMPLES, _send_on_delta, (0.7, 3.0), everywhere=False),
    Link("companding_converter", Place.SAMPLES, _companding, (0.5, 2.0), everywhere=False),
    Link("drifting_gain", Place.SAMPLES, _drifting_gain, (1e-3, 3e-3)),
    Link("sensor_hysteresis", Place.SAMPLES, _sensor_hysteresis, (3e-4, 1e-3), everywhere=False),
    Link("noise_not_stated", Place.STATEMENT, _not_stated, (0.9, 1.1)),
    Link("noise_of_a_data_sheet", Place.STATEMENT, _rounded_up, (0.7, 1.4)),
)
