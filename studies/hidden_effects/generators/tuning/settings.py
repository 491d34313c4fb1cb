"""Errors of bench settings and of parameter sheets, for the tuning cases."""

import numpy as np

from studies.hidden_effects.generators.settings import RunDrift, WrongSheet


def _hand_wheel(rng, runs):
    """A hand wheel with backlash: 0.3 … 0.9 % above or below, by the direction from which a setting was reached."""
    return 1.0 + rng.uniform(0.003, 0.009) * np.where(rng.uniform(size=runs) < 0.5, 1.0, -1.0)


def warmer_in_sessions(rng, runs):
    """A rise by 0.6 … 1.6 % as the bench warms up in each session of three runs; it is cold again after the pause."""
    return 1.0 + rng.uniform(0.006, 0.016) * (np.arange(runs) % 3) / 2.0


def _refilled(rng, runs):
    """Fresh oil after one of the runs: 2 … 5 % from then on, either sign."""
    first = rng.integers(1, runs) if runs > 1 else 1
    return 1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.02, 0.05) * (np.arange(runs) >= first)


def _oscillating(rng, runs):
    """The cycle of a thermostat: two periods over the campaign, with an amplitude of 0.3 … 0.8 %."""
    angle = 4.0 * np.pi * np.arange(runs) / max(runs, 2) + rng.uniform(0.0, 6.0)
    return 1.0 + rng.uniform(0.003, 0.008) * np.sin(angle)


def _one_group_off(rng, count):
    """The first or the last third of the parameters is off by the same 1.5 … 2.3 standard deviations."""
    out = np.clip(rng.standard_normal(count), -1.5, 1.5)
    third = slice(0, -(-count // 3)) if rng.uniform() < 0.5 else slice(count - count // 3 or 0, count)
    out[third] = rng.choice([-1.0, 1.0]) * rng.uniform(1.5, 2.3)
    return out


def _one_forgotten(rng, count):
    """One parameter is off by 2.4 … 2.9 standard deviations, the others by at most half of one."""
    out = rng.uniform(-0.5, 0.5, count)
    out[rng.integers(count)] = rng.choice([-1.0, 1.0]) * rng.uniform(2.4, 2.9)
    return out


DRIFTS = (
    RunDrift("hand wheel with play", None, _hand_wheel), RunDrift("thermostat", None, _oscillating),
    RunDrift("coil warms up in sessions", "coil_resistance", warmer_in_sessions),
    RunDrift("force constant of sessions", "force_constant", warmer_in_sessions),
    RunDrift("oil is refilled", "oil_viscosity", _refilled),
)  # fmt: skip
SHEETS = (WrongSheet("one group off", _one_group_off), WrongSheet("one forgotten", _one_forgotten))
