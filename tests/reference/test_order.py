"""The step is of second order where nothing switches."""

import pytest

from tests.support.convergence import convergence, stretches


@pytest.mark.parametrize("name", stretches())
def test_order_is_two(name):
    found = convergence(stretches()[name])
    assert len(found.steps) >= 5
    assert found.order >= 1.9
    assert found.errors[-1] < 1e-5
