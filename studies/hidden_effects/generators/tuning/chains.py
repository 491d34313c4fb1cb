"""Links of sensor chains, for development."""

import math

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from studies.hidden_effects.generators.chains import Link, Place

SIDE = 0.25  # share of the lag of a lead that does not cancel it
DECADE = 10.0


def _three_poles(interval, trace, time):
    """Three equal first-order lags in a row, in steady state at the start."""
    pole = np.exp(-interval / time)
    for _ in range(3):
        trace = trace[0] + lfilter([1.0 - pole], [1.0, -pole], trace - trace[0])
    return trace


def _compensated(interval, trace, time):
    """A transducer whose lag is compensated with a time constant that is 25 % off: (1 + 1.25 τ s)/(1 + τ s)."""
    pole = np.exp(-interval / time)
    lagged = trace[0] + lfilter([1.0 - pole], [1.0, -pole], trace - trace[0])
    return trace + SIDE * (trace - lagged)


def _smoothed(interval, trace, time):
    """Software that smooths in both directions with a bell of this width, so that nothing is late."""
    return gaussian_filter1d(trace, time / interval, mode="nearest")


def _buffer_overrun(times, lost):
    """A recorder that loses a block two fifths into each record; its time stamps go on."""
    return times + lost * (times > 0.4 * times[-1])


def _unsteady_clock(times, size):
    """A clock whose error wanders between time stamps, the same in all runs."""
    return times + size * np.sin(2.0 * np.pi * 37.0 * times) * np.sin(2.0 * np.pi * 5.3 * times)


def _heavy_tails(rng, count, share):
    """Noise of which a share of samples is three times as large, scaled to unit standard deviation."""
    size = np.where(rng.uniform(size=count) < share, 3.0, 1.0)
    return size * rng.standard_normal(count) / np.sqrt(1.0 + 8.0 * share)


def _line_noise(rng, count, share):
    """White noise and a hum of 0.017 cycles per sample with a `share` of the variance, of any phase."""
    hum = np.sqrt(2.0 * share) * np.sin(2.0 * np.pi * 0.017 * np.arange(count) + rng.uniform(0.0, 2.0 * np.pi))
    return hum + np.sqrt(1.0 - share) * rng.standard_normal(count)


def _growing_noise(rng, count, growth):
    """Noise that grows by this factor along the record, scaled to unit standard deviation over it."""
    size = np.linspace(1.0, 1.0 + growth, count)
    return size * rng.standard_normal(count) / np.sqrt(np.mean(size**2))


def _send_on_delta(rng, samples, noise, band):
    """A transmitter that sends a value only when it has changed by a band, in units of the noise."""
    out, sent = samples.copy(), samples[0]
    for k, value in enumerate(samples):
        sent = value if abs(value - sent) > band * noise else sent
        out[k] = sent
    return out


def _companding(rng, samples, noise, steps):
    """A converter whose steps grow with the value, from a share of the noise on."""
    scale = 20.0 * noise
    curved = np.sign(samples) * np.log1p(np.abs(samples) / scale)
    rounded = np.round(curved * 20.0 / steps) * steps / 20.0
    return np.sign(rounded) * scale * np.expm1(np.abs(rounded))


def _drifting_gain(rng, samples, noise, size):
    """A gain that drifts along the record, within the accuracy of the sensor."""
    return samples * (1.0 + rng.choice([-1.0, 1.0]) * size * np.linspace(-0.5, 0.5, len(samples)))


def _sensor_hysteresis(rng, samples, noise, size):
    """A sensor that reads lower while its signal rises, by a share of its range within the accuracy."""
    return samples - size * np.nanmax(np.abs(samples)) * np.tanh(np.gradient(samples) / (noise + 1e-12))


def _not_stated(rng, value):
    """The noise is not stated."""
    return math.nan


def _rounded_up(rng, factor):
    """The noise is stated as a power of ten, or another factor, of what it is."""
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
