"""A misfit at low frequencies is seen where noise hides it over all frequencies; noise alone is none."""

import dataclasses

import numpy as np
import pytest

from edhas_jax.inference.fit.evaluated_fit import remaining
from edhas_jax.inference.likelihood.slow_residuals import slow_excess
from edhas_jax.inference.likelihood.whitening import innovation_share
from edhas_jax.measurements.campaign import Channel
from tests.support.synthetic_campaign import empty_campaign

SAMPLES, CHANNELS = 4001, ("current", "piston_position")


def residuals(rng, amplitude: float, frequency: float) -> dict:
    """White noise of unit variance with a sine [cycles per sample] in one signal, for three runs."""
    wave = amplitude * np.sin(2.0 * np.pi * frequency * np.arange(SAMPLES))
    return {
        f"run{r}": {n: rng.normal(size=SAMPLES) + wave * (n == "current") for n in CHANNELS} for r in (1, 2, 3)
    }


@pytest.fixture(scope="module")
def campaign():
    """Three runs, and the noise of two signals."""
    return empty_campaign(lengths=(SAMPLES,) * 3)


def half_chi_square(found) -> float:
    return 0.5 * sum(float(v @ v) for run in found.values() for v in run.values())


def test_noise_alone_has_no_slow_misfit(campaign):
    found = [slow_excess(campaign, campaign.runs, residuals(np.random.default_rng(k), 0.0, 0.0)) for k in range(40)]
    assert max(found) == 0.0


def test_a_small_sine_is_seen_at_its_size(campaign):
    amplitude, names = 0.15, [run.name for run in campaign.runs]
    found = residuals(np.random.default_rng(1), amplitude, 0.004)
    found = {name: found[f"run{k + 1}"] for k, name in enumerate(names)}
    size = 3 * SAMPLES * amplitude**2 / 4.0  # ½χ² of the sine
    samples = sum(v.size for run in found.values() for v in run.values())
    assert remaining(half_chi_square(found) - 0.5 * samples, samples) == 0.0
    assert slow_excess(campaign, campaign.runs, found) == pytest.approx(size, abs=5.0 * np.sqrt(size))
    fast = residuals(np.random.default_rng(1), amplitude, 0.4)
    fast = {name: fast[f"run{k + 1}"] for k, name in enumerate(names)}
    assert slow_excess(campaign, campaign.runs, fast) == 0.0


def test_correlated_noise_is_whitened_first(campaign):
    """Noise of a first-order filter is slow by itself, and no misfit."""
    coefficient, rng = 0.9, np.random.default_rng(2)
    channel = campaign.channels["current"]
    correlated = Channel(channel.unit, channel.noise, correlation=(coefficient,))
    own = {**campaign.channels, "current": correlated}
    rows = {}
    for run in campaign.runs:
        e = rng.normal(size=SAMPLES + 200) * innovation_share((coefficient,))
        for t in range(1, len(e)):
            e[t] += coefficient * e[t - 1]
        rows[run.name] = {"current": e[200:]}
    assert slow_excess(campaign, campaign.runs, rows) > 100.0
    assert slow_excess(dataclasses.replace(campaign, channels=own), campaign.runs, rows) == 0.0
