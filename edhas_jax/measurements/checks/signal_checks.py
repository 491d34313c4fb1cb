"""Check single measured signals: slow sampling, noise of one run above that of the others."""

from collections.abc import Iterator, Mapping

import numpy as np

from edhas_jax.core.remark import Remark
from edhas_jax.core.units import difference_to_si
from edhas_jax.measurements.campaign import BenchRun, Campaign
from edhas_jax.measurements.checks.noise_records import fast_noise
from edhas_jax.measurements.checks.time_axis_checks import GAP_IN_INTERVALS, MAX_JITTER, jitter

MIN_COMPARED = 20  # samples between others
MIN_EXCESS_OVER_NOISE = 1.5  # rms deviation from the interpolation beyond the noise, over the noise: slow sampling
MIN_EXCESS_OVER_SIGNAL = 0.05  # and over the standard deviation of the signal
MAX_NOISE_RATIO = 2.0  # estimated noise of a run over the noise that is used
# standard deviation of `_interpolation_error` for white noise of standard deviation 1
INTERPOLATION_NOISE_GAIN = np.sqrt(1.0 + 2.0 * (9.0**2 + 1.0) / 16.0**2)


def check_quality(campaign: Campaign, run: BenchRun, name: str, ratios: Mapping[str, float]) -> Iterator[Remark]:
    """Check a signal for slow sampling and excessive noise by interpolating each sample from its neighbours.

    Args:
        campaign: gives the noise.
        run: the run.
        name: name of the signal.
        ratios: from `noise_ratios`.

    Yields:
        A warning on slow sampling or noise.
    """
    values, channel, unit = run.signals[name], campaign.channels[name], campaign.machine.signals[name].unit
    error = _interpolation_error(run, values)
    if jitter(run) > MAX_JITTER or np.isfinite(error).sum() < MIN_COMPARED:
        return
    strength = float(np.nanstd(values))
    ratio = ratios[run.name]
    # allow three standard deviations of the estimated mean square
    allowance = 1.0 + 3.0 * np.sqrt(3.0 / np.isfinite(error).sum())
    noise_square = allowance * (INTERPOLATION_NOISE_GAIN * channel.noise) ** 2
    excess = np.sqrt(max(float(np.nanmean(error**2)) - noise_square, 0.0))
    others = [other for name, other in ratios.items() if name != run.name and other > 0.0]
    same_in_others = bool(others) and abs(np.log(np.median(others) / ratio)) < np.log(1.5)
    excess_limit = max(MIN_EXCESS_OVER_NOISE * channel.noise, MIN_EXCESS_OVER_SIGNAL * strength)
    # where the signal is nowhere quiet, its own content is in the fast part, in all runs alike
    usual = 1.0 if channel.is_noise_seen else float(np.median(others)) if others else ratio
    is_noisier = ratio > MAX_NOISE_RATIO * usual
    if excess > excess_limit and not (is_noisier and same_in_others):
        shares = f"{excess / strength:.0%} of the signal, {excess / channel.noise:.1f} times the noise"
        sentence = "sampled too slowly for its content, or noisier than in other runs: samples deviate from the"
        yield run.warning(f"{name}: {sentence} interpolation between their neighbours by {shares}", 0)
    elif is_noisier:
        size = difference_to_si(f"1 {channel.unit}", unit)
        found, stated = (f"{noise / size:.3g} {channel.unit}" for noise in (ratio * channel.noise, channel.noise))
        sentence = f"its noise is {found}, {ratio:.1f} times the {stated} of this signal"
        yield run.warning(f"{name}: {sentence}", 0)


def noise_ratios(campaign: Campaign, name: str) -> dict[str, float]:
    """Fast part of the noise of a signal over the noise of the signal, by run.

    Args:
        campaign: gives the noise.
        name: name of the signal.

    Returns:
        The ratios of standard deviations; NaN where it cannot be seen.
    """
    noise = campaign.channels[name].noise
    return {run.name: fast_noise(run, name) / noise for run in campaign.runs if name in run.signals}


def _interpolation_error(run: BenchRun, values: np.ndarray) -> np.ndarray:
    """Deviation of samples 3 … n−4 from the cubic through the samples at ±1 and ±3 around each; NaN next to gaps."""
    v = values
    error = v[3:-3] - (9.0 * (v[2:-4] + v[4:-2]) - v[:-6] - v[6:]) / 16.0
    without_gap = np.diff(run.time) <= GAP_IN_INTERVALS * run.interval
    return np.where(np.convolve(without_gap, np.ones(6), "valid") > 5.5, error, np.nan)
