"""Errors of bench settings and of parameter sheets, for the judging cases."""

import numpy as np

from studies.hidden_effects.generators.settings import RunDrift, WrongSheet


def _misread_scale(rng, runs):
    """A scale that is misread by the same 0.4 … 1.1 % in all runs, and a random setting error of 0.1 % in each."""
    return 1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.004, 0.011) + 0.001 * rng.standard_normal(runs)


def _creeping_valve(rng, runs):
    """A valve whose setting creeps from run to run: a random walk with steps of 0.2 … 0.4 %."""
    return 1.0 + np.cumsum(rng.uniform(0.002, 0.004, runs) * rng.choice([-1.0, 1.0], runs))


def cooling_room(rng, runs):
    """A room that cools down: the parameter is 0.6 … 1.6 % too high in the first run, and less from run to run."""
    return 1.0 + rng.uniform(0.006, 0.016) * np.exp(-1.5 * np.arange(runs) / max(runs - 1, 1))


def _heated_by_the_last(rng, runs):
    """Heat left from the run before, by chance as the pauses differ: 0 … 1.2 % in each run."""
    return 1.0 + rng.uniform(0.0, 0.012, runs)


def _settling_oil(rng, runs):
    """Oil that warms up from run to run towards a steady state, with 2 … 6 % less viscosity."""
    return 1.0 - rng.uniform(0.02, 0.06) * (1.0 - np.exp(-np.arange(runs) / 2.5))


def _one_sided(rng, count):
    """All parameters deviate in the same direction, as in a worn machine: by 0.3 … 1.9 standard deviations."""
    return rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 1.9, count)


def _sheet_of_another(rng, count):
    """The parameter sheet of another specimen: deviations 1.3 times as large as stated, limited to 2.6."""
    return np.clip(1.3 * rng.standard_normal(count), -2.6, 2.6)


DRIFTS = (
    RunDrift("misread scale", None, _misread_scale), RunDrift("creeping valve", None, _creeping_valve),
    RunDrift("room cools down", "coil_resistance", cooling_room),
    RunDrift("magnets after pauses", "force_constant", _heated_by_the_last),
    RunDrift("oil warms up", "oil_viscosity", _settling_oil),
)  # fmt: skip
SHEETS = (WrongSheet("all off in one direction", _one_sided), WrongSheet("sheet of another", _sheet_of_another))
