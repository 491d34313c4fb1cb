"""Settings and sheets that are off, for tuning."""

import numpy as np

from studies.hidden_effects.generators.settings import RunDrift, WrongSheet


def _scatter(rng, runs):
    """Each run by itself, 0.3 … 1 % off in either direction."""
    return 1.0 + rng.uniform(0.003, 0.01, runs) * rng.choice([-1.0, 1.0], runs)


def _approach(rng, runs):
    """Towards a steady value: up to 0.6 … 1.5 % more in the last run."""
    return 1.0 + rng.uniform(0.006, 0.015) * (1.0 - np.exp(-np.arange(runs) / 2.0))


def _three_far_off(rng, count):
    """Three parameters 2.2 … 2.9 standard deviations off, the others as usual."""
    out = np.clip(rng.standard_normal(count), -2.0, 2.0)
    chosen = rng.choice(count, min(3, count), replace=False)
    out[chosen] = rng.uniform(2.2, 2.9, len(chosen)) * rng.choice([-1.0, 1.0], len(chosen))
    return out


DRIFTS = (RunDrift("settings scatter", None, _scatter), RunDrift("coil warms up", "coil_resistance", _approach))
SHEETS = (WrongSheet("three parameters far off", _three_far_off),)
