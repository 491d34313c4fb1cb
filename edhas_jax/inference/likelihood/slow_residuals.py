"""Misfit at low frequencies: the power of the residuals there beyond that of the noise.

Over all frequencies ½χ² of N samples scatters by √(N/2), which hides an effect that is small but regular. Mechanisms
act at the frequencies of the motion and a few harmonics, far below the sample rate, where only few degrees of freedom
scatter.

Source: mean and variance of the periodogram of white noise, Priestley, Spectral Analysis and Time Series (1981), ch. 6.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from edhas_jax.inference.likelihood.whitening import whiten
from edhas_jax.measurements.campaign import BenchRun, Campaign

BANDS = (0.25, 0.0625, 0.0156)  # upper ends, over half the sample rate
SIGMAS = 4.0  # an excess counts beyond this many standard deviations of that of noise alone


def slow_excess(
    campaign: Campaign, runs: Iterable[BenchRun], residuals: Mapping[str, Mapping[str, np.ndarray]]
) -> float:  # fmt: skip
    """The excess of ½χ² of the residuals over that of noise at low frequencies, beyond its scatter [nats]; at least 0.

    The largest value over several frequency bands, of each signal in all runs and of all signals together.

    Args:
        campaign: noise of the signals.
        runs: runs whose residuals count.
        residuals: residual over noise (samples,) by run and signal.
    """
    names = list(campaign.channels)
    excess, bins = np.zeros((len(names), len(BANDS))), np.zeros((len(names), len(BANDS)))
    for run in runs:
        for k, name in enumerate(names):
            channel = campaign.channels[name]
            rows = residuals.get(run.name, {}).get(name)
            if rows is None:
                continue
            white = whiten(rows * channel.noise, channel)
            white = white[np.isfinite(white)]
            power = np.abs(np.fft.rfft(white)) ** 2 / max(len(white), 1)
            for j, band in enumerate(BANDS):
                last = int(0.5 * band * len(white))
                excess[k, j] += power[1 : 1 + last].sum() - last
                bins[k, j] += last
    excess, bins = np.vstack([excess, excess.sum(axis=0)]), np.vstack([bins, bins.sum(axis=0)])
    return float(np.maximum(excess - SIGMAS * np.sqrt(bins), 0.0).max(initial=0.0))
