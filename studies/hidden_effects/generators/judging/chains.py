"""Links of sensor chains, for the judging cases."""

import numpy as np
from scipy.signal import lfilter

from studies.hidden_effects.generators.chains import Link, Place

RINGING = 0.35  # damping ratio of a pressure sensor behind a tube, or of a sensor on an elastic mount
BURST = 25  # samples with the same noise level


def _from_start(trace, b, a):
    """The first sample plus the filtered change from it: a digital filter that is at rest until the first sample."""
    return trace[0] + lfilter(b, a, trace - trace[0])


def _ringing_mount(interval, trace, period):
    """A sensor with a resonance of this undamped period: a damped oscillator, its poles mapped to the time grid."""
    omega = 2.0 * np.pi / period
    pole = np.exp(interval * omega * (-RINGING + 1j * np.sqrt(1.0 - RINGING**2)))
    a = np.array([1.0, -2.0 * pole.real, abs(pole) ** 2])
    return _from_start(trace, [a.sum()], a)


def _integrating(interval, trace, time):
    """An integrating A/D converter: each sample is the mean over this time before it."""
    share = time / interval
    whole = int(share)
    b = np.append(np.ones(whole + 1), share - whole)
    return _from_start(trace, b / b.sum(), [1.0])


def _draining(interval, trace, time):
    """A charge amplifier: a first-order high-pass filter with this time constant, which starts with the record."""
    pole = np.exp(-interval / time)
    return _from_start(trace, [1.0, -1.0], [1.0, -pole])


def _fast_clock(times, share):
    """A recorder whose clock is slow by this share: it samples later than its time stamps say."""
    return times * (1.0 + share)


def _timer_ticks(times, tick):
    """Sampling times rounded to the ticks of a timer, while the time stamps are equidistant."""
    return tick * np.round(times / tick)


def _flicker(rng, count, share):
    """White noise plus flicker (1/f) noise with this share of the variance.

    The flicker noise is the sum of three first-order processes with correlation lengths of 2, 10 and 50 samples.
    """
    out = np.sqrt(1.0 - share) * rng.standard_normal(count)
    for length in (2.0, 10.0, 50.0):
        pole = np.exp(-1.0 / length)
        white = rng.standard_normal(count + 400) * np.sqrt((1.0 - pole**2) * share / 3.0)
        out = out + lfilter([1.0], [1.0, -pole], white)[400:]
    return out


def _shaped(rng, count, weight):
    """First-order shaped noise of an A/D converter, less at low frequency: n_k − w n_{k−1}, of unit deviation."""
    white = rng.standard_normal(count + 1)
    return (white[1:] - weight * white[:-1]) / np.sqrt(1.0 + weight**2)


def _bursts(rng, count, factor):
    """Noise in bursts: larger by this factor in a quarter of the time, as beside a relay; scaled to unit deviation."""
    blocks = rng.uniform(size=count // BURST + 1) < 0.25
    size = np.where(np.repeat(blocks, BURST)[:count], factor, 1.0)
    return size * rng.standard_normal(count) / np.sqrt(0.75 + 0.25 * factor**2)


def _missing_codes(rng, samples, noise, steps):
    """An A/D converter with missing codes: every fourth reads as the one below; `steps` is a code over the noise."""
    code = np.round(samples / (steps * noise))
    return np.where(code % 4 == 3, code - 1.0, code) * steps * noise


def _running_mean(rng, samples, noise, weight):
    """Exponential smoothing of the samples in software: y_k = (1 − w) x_k + w y_(k−1)."""
    return _from_start(samples, [1.0 - weight], [1.0, -weight])


def _curved_sensor(rng, samples, noise, size):
    """A sensor with a cubic nonlinearity within its accuracy; no error at zero and at the ends of its range."""
    share = samples / np.nanmax(np.abs(samples))
    return samples + size * np.nanmax(np.abs(samples)) * 2.6 * (share**3 - share)


def _creeping_zero(rng, samples, noise, size):
    """Zero drift: the offset grows with the square root of time, to this share of the largest value at the end."""
    direction = rng.choice([-1.0, 1.0])
    return samples + direction * size * np.nanmax(np.abs(samples)) * np.linspace(0.0, 1.0, len(samples)) ** 0.5


LINKS = (
    Link("ringing_mount", Place.SIGNAL, _ringing_mount, (2.5e-4, 1e-3), everywhere=False),
    Link("integrating_converter", Place.SIGNAL, _integrating, (1e-4, 4e-4)),
    Link("draining_amplifier", Place.SIGNAL, _draining, (15.0, 150.0), everywhere=False),
    Link("fast_clock", Place.CLOCK, _fast_clock, (5e-5, 6e-4)),
    Link("timer_ticks", Place.CLOCK, _timer_ticks, (2.3e-5, 1.3e-4)),
    Link("flicker_noise", Place.NOISE, _flicker, (0.1, 0.6)),
    Link("shaped_noise", Place.NOISE, _shaped, (0.3, 0.9)),
    Link("noise_in_bursts", Place.NOISE, _bursts, (2.0, 5.0)),
    Link("missing_codes", Place.SAMPLES, _missing_codes, (0.5, 2.5), everywhere=False),
    Link("running_mean", Place.SAMPLES, _running_mean, (0.1, 0.4)),
    Link("curved_sensor", Place.SAMPLES, _curved_sensor, (3e-4, 1.5e-3), everywhere=False),
    Link("creeping_zero", Place.SAMPLES, _creeping_zero, (3e-4, 1.5e-3), everywhere=False),
    Link("stated_peak_to_peak", Place.STATEMENT, lambda rng, factor: factor, (4.0, 6.6)),
    Link("stated_for_the_bare_sensor", Place.STATEMENT, lambda rng, factor: factor * rng.uniform(0.7, 1.4), (0.2, 0.6)),
)
