"""Frequency and amplitude that are read from a record."""

import numpy as np
import pytest

from edhas_jax.config.tables.table import Column, Table
from edhas_jax.measurements.table_guess import guess_columns, guess_sine

AVAILABLE = "voltage", "current", "piston_position", "outlet_pressure"


def found_in(time, unit="s", **columns):
    """The sine that is found in columns, given with their units as `name=(unit, values)`."""
    given = {"t": Column(unit, time)} | {name: Column(own, values) for name, (own, values) in columns.items()}
    table = Table(given, np.arange(len(time)) + 2, 1)
    return guess_sine(table, guess_columns(table, AVAILABLE))


@pytest.mark.parametrize("frequency", [10.0, 12.37, 3.1, 45.0])
def test_frequency_and_amplitude_of_a_position_with_soft_start_offset_and_noise(frequency):
    rng, time = np.random.default_rng(1), np.arange(0.0, 1.0, 5e-4)
    values = 7.0 + 3.5 * np.clip(time / 0.2, 0.0, 1.0) * np.sin(2.0 * np.pi * frequency * time)
    found = found_in(1e3 * time, "ms", x=("mm", values + rng.normal(0.0, 0.02, len(time))))
    assert found.column == "x" and found.amplitude == pytest.approx(3.5e-3, rel=0.02)
    assert found.frequency == pytest.approx(frequency, abs=0.004)  # a hundredth of a cycle over the record


def test_a_round_frequency_is_offered_round():
    time = np.arange(0.0, 2.0, 1e-3)
    assert found_in(time, x=("m", 2e-3 * np.sin(2.0 * np.pi * 25.0 * time + 0.3)))[1:] == (25.0, 2e-3)


def test_a_record_without_a_position_tells_the_frequency_only():
    time = np.arange(0.0, 1.0, 1e-3)
    pressure = np.sin(2.0 * np.pi * 40.0 * time)  # of a pump, at twice the frequency
    found = found_in(time, p=("bar", pressure), i=("A", np.sin(2.0 * np.pi * 20.0 * time)))
    assert found.column == "i" and found.frequency == 20.0 and np.isnan(found.amplitude)


def test_gaps_and_missing_values_do_not_matter():
    time = np.delete(np.arange(0.0, 1.0, 1e-3), slice(700, 760))
    values = np.sin(2.0 * np.pi * 15.0 * time)
    values[::50] = np.nan
    assert found_in(time, x=("mm", values)).frequency == 15.0


@pytest.mark.parametrize("kind", ["step", "noise", "still", "one cycle", "empty", "two samples"])
def test_what_is_no_sine_gives_no_guess(kind):
    time = np.arange(0.0, 1.0, 1e-3)
    values = {
        "step": np.where(time > 0.6, 1.0, 0.0), "noise": np.random.default_rng(0).normal(size=len(time)),
        "still": 0.0 * time, "one cycle": np.sin(2.0 * np.pi * time), "empty": np.nan * time, "two samples": time,
    }[kind]  # fmt: skip
    count = 2 if kind == "two samples" else len(time)
    assert found_in(time[:count], x=("mm", values[:count])) is None
