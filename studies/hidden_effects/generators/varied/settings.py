"""Errors of test settings and of parameter sheets, for varied cases; judging cases have other ones."""

import numpy as np

from studies.hidden_effects.generators.settings import RunDrift, WrongSheet


def _one_is_wrong(rng, runs):
    """One run 1.5 … 3 % off, the others by 0.1 %."""
    out = 1.0 + 0.001 * rng.standard_normal(runs)
    out[rng.integers(runs)] += rng.uniform(0.015, 0.03) * rng.choice([-1.0, 1.0])
    return out


def _two_levels(rng, runs):
    """Every second run 0.4 … 1 % above the others, as if set by another person."""
    return 1.0 + rng.uniform(0.004, 0.01) * (np.arange(runs) % 2)


def _every_second(rng, count):
    """Every second parameter 1.6 … 2.2 standard deviations off, the others exact."""
    out = rng.uniform(1.6, 2.2, count) * rng.choice([-1.0, 1.0], count)
    out[int(rng.integers(2)) :: 2] = 0.0
    return out


DRIFTS = (
    RunDrift("one setting is wrong", None, _one_is_wrong),
    RunDrift("settings of two persons", None, _two_levels),
    RunDrift("magnets warm up in every second run", "force_constant", _two_levels),
)
SHEETS = (WrongSheet("every second parameter off", _every_second),)
