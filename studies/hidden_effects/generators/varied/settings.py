"""Settings and sheets that are off, for varied cases."""

import numpy as np

from studies.hidden_effects.generators.settings import RunDrift, WrongSheet


def _random_walk(rng, runs):
    """From run to run 0.2 … 0.6 % further, in either direction."""
    return 1.0 + np.cumsum(rng.uniform(0.002, 0.006, runs) * rng.choice([-1.0, 1.0], runs))


def _one_is_wrong(rng, runs):
    """One run 1.5 … 3 % off, the others by 0.1 %."""
    out = 1.0 + 0.001 * rng.standard_normal(runs)
    out[rng.integers(runs)] += rng.uniform(0.015, 0.03) * rng.choice([-1.0, 1.0])
    return out


def _wide(rng, count):
    """All parameters scatter by 1.5 times what the sheet says."""
    return np.clip(1.5 * rng.standard_normal(count), -3.0, 3.0)


DRIFTS = (
    RunDrift("settings walk", None, _random_walk), RunDrift("one setting is wrong", None, _one_is_wrong),
    RunDrift("magnets warm up", "force_constant", _random_walk),
    RunDrift("oil warms up", "oil_viscosity", _random_walk),
)  # fmt: skip
SHEETS = (WrongSheet("a sheet that is too sure", _wide),)
