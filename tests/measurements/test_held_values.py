"""Samples that repeat the one before because the recorder has lost the new value."""

import numpy as np
import pytest

from edhas_jax.measurements.checks.repeated_values import find_held_values

NOISE, SAMPLES = 1.0, 4000


def record(resolution: float) -> np.ndarray:
    """A moving signal with noise, recorded with a resolution."""
    rng = np.random.default_rng(7)
    values = 50.0 * np.sin(0.02 * np.arange(SAMPLES)) + NOISE * rng.standard_normal(SAMPLES)
    return resolution * np.round(values / resolution)


def with_held(values: np.ndarray, lengths: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """The record where some values repeat for given numbers of samples, and a mask of the repetitions."""
    values, mask = values.copy(), np.zeros(len(values), bool)
    for k, length in enumerate(lengths):
        first = 300 + 211 * k
        values[first + 1 : first + length] = values[first]
        mask[first + 1 : first + length] = True
    return values, mask


def test_a_recorder_that_loses_values_loses_single_ones_too():
    values, held = with_held(record(0.01), [2, 5, 2, 3, 7, 2, 4])
    found = find_held_values(values, NOISE, 0.01)
    assert found[held].all()
    assert found[~held].mean() < 0.01  # equal by chance


@pytest.mark.parametrize("lengths", [[], [2, 2, 2]])
def test_two_equal_samples_alone_are_chance(lengths):
    assert not find_held_values(with_held(record(0.01), lengths)[0], NOISE, 0.01).any()


def test_pairs_stay_where_many_are_equal_by_chance():
    values, held = with_held(record(0.3), [2, 9, 2, 9])
    found = find_held_values(values, NOISE, 0.3)
    assert found[held].sum() == 16 and found.sum() == 16
