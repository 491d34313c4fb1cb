"""The level at which a curve begins: found for a hinge, not claimed for a curve that acts everywhere."""

import numpy as np
import pytest

from edhas_jax.diagnosis.laws.curve_onset import onset

NODES = np.linspace(3.0, 19.0, 11)
SPEEDS = np.linspace(-560.0, 430.0, 11)


@pytest.mark.parametrize("level", [8.0, 11.0, 14.0])
def test_a_hinge_begins_where_it_does(level):
    scatter = 0.01 * np.random.default_rng(0).normal(size=11)
    assert onset(NODES, 0.05 * np.maximum(NODES - level, 0.0) + scatter) == pytest.approx(level, abs=1.5)


@pytest.mark.parametrize("values", [
    0.3 * np.tanh(SPEEDS / 100.0) + 0.005 * SPEEDS,  # friction of a motor
    0.3 * np.tanh((SPEEDS + 400.0) / 100.0),
    0.005 * SPEEDS,
    np.where(SPEEDS < -500.0, -1.0, 0.002 * SPEEDS),
])  # fmt: skip
def test_a_curve_that_acts_everywhere_begins_nowhere(values):
    assert onset(SPEEDS, values) is None
