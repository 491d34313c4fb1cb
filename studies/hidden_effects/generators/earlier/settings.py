"""Settings and sheets that are off, for the earlier judging set."""

import numpy as np

from studies.hidden_effects.generators.settings import RunDrift, WrongSheet


def _creeping(rng, runs):
    """A setting that drifts steadily from run to run, by 0.5 … 1 % over the campaign."""
    steps = np.cumsum(np.abs(rng.standard_normal(runs)))
    return 1.0 + rng.uniform(0.005, 0.01) * rng.choice([-1.0, 1.0]) * steps / steps[-1]


def _after_a_pause(rng, runs):
    """Linear warming with a pause before one of the runs, after which it begins anew; at most 0.5 … 1.2 %."""
    start = rng.integers(1, runs) if runs > 1 else 0
    count = np.concatenate([np.arange(start), np.arange(runs - start)])
    return 1.0 + rng.uniform(0.005, 0.012) * count / max(1, count.max())


def _thinner(rng, runs):
    """A viscosity that falls by 1 … 3 % over the campaign."""
    return 1.0 - rng.uniform(0.01, 0.03) * np.arange(runs) / max(1, runs - 1)


def _spread_out(rng, count):
    """Deviations spread evenly within 2.7 standard deviations."""
    return rng.uniform(-2.7, 2.7, count)


def _one_sided(rng, count):
    """A machine that has run in: half of the parameters 1.5 … 2.8 standard deviations off in one direction."""
    off = rng.uniform(1.5, 2.8, count) * rng.choice([-1.0, 1.0])
    return np.where(rng.uniform(size=count) < 0.5, off, np.clip(rng.standard_normal(count), -2.0, 2.0))


DRIFTS = (
    RunDrift("settings creep", None, _creeping), RunDrift("coil warms and cools", "coil_resistance", _after_a_pause),
    RunDrift("oil becomes thinner", "oil_viscosity", _thinner),
)  # fmt: skip
SHEETS = (WrongSheet("parameters anywhere", _spread_out), WrongSheet("run-in machine", _one_sided))
