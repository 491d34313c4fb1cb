"""The error of an estimated law relative to the true one."""

import numpy as np
import pytest

from studies.hidden_effects.law_errors import _relative

TIME = np.linspace(0.0, 1.0, 50)


def test_the_error_of_a_law_is_relative_to_the_true_contribution():
    true = {"at_0": np.sin(TIME), "at_1": np.cos(TIME)}
    assert _relative({place: 1.2 * row for place, row in true.items()}, true) == pytest.approx(0.2)
    assert np.isnan(_relative(true, {"at_0": 0.0 * TIME}))


def test_a_law_that_does_not_act_at_a_place_is_zero_there():
    """An estimated law may act in two chambers where the true one acts in a third volume as well."""
    true = {"at_0": np.ones(50), "at_1": np.ones(50), "at_2": np.ones(50)}
    assert _relative({"at_0": np.ones(50), "at_1": np.ones(50)}, true) == pytest.approx(np.sqrt(1.0 / 3.0))
    assert _relative(true, {"at_0": np.ones(50)}) == pytest.approx(np.sqrt(2.0))
