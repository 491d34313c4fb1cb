"""Settings and sheets that are off, for judging."""

import numpy as np

from studies.hidden_effects.generators.settings import RunDrift, WrongSheet


def _readjusted(rng, runs):
    """A setting that is readjusted before one of the runs and is 0.5 … 1.2 % off from then on."""
    start = rng.integers(1, runs) if runs > 1 else 0
    return 1.0 + rng.uniform(0.005, 0.012) * rng.choice([-1.0, 1.0]) * (np.arange(runs) >= start)


def _wandering(rng, runs):
    """A random walk from run to run, which starts at the stated value; its steps have a deviation of 0.2 … 0.5 %."""
    steps = rng.uniform(0.002, 0.005) * rng.standard_normal(runs)
    return 1.0 + np.cumsum(steps) - steps[0]


def _cold_at_first(rng, runs):
    """A viscosity that is 2 … 5 % too high in the first run, with an error that halves from run to run."""
    return 1.0 + rng.uniform(0.02, 0.05) * 0.5 ** np.arange(runs)


def _leaving(rng, runs):
    """An air content that falls linearly by 5 … 15 % over the campaign."""
    return 1.0 - rng.uniform(0.05, 0.15) * np.arange(runs) / max(1, runs - 1)


def _too_certain(rng, count):
    """Deviations that are 1.5 times as large as the sheet states, at most three standard deviations."""
    return np.clip(1.5 * rng.standard_normal(count), -3.0, 3.0)


def _second_half_guessed(rng, count):
    """Guessed values in the second half of the sheet: 1.2 … 2.5 standard deviations off."""
    out = np.clip(rng.standard_normal(count), -2.0, 2.0)
    guessed = np.arange(count) >= count // 2
    return np.where(guessed, rng.uniform(1.2, 2.5, count) * rng.choice([-1.0, 1.0], count), out)


DRIFTS = (
    RunDrift("bench readjusted", None, _readjusted),
    RunDrift("coil temperature wanders", "coil_resistance", _wandering),
    RunDrift("oil cold at first", "oil_viscosity", _cold_at_first),
    RunDrift("air leaves the oil", "air_fraction", _leaving),
)
SHEETS = (WrongSheet("sheet too certain", _too_certain), WrongSheet("second half guessed", _second_half_guessed))
