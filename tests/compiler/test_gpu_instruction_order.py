"""The order of the operations of a step: it stays an order of computation, and keeps fewer values."""

import numpy as np
import pytest

from edhas_jax.compiler.gpu.instruction_order import most_values, order_with_few_values
from tests.compiler.test_gpu_kernel import kernel_of


def random_graph(seed: int, count: int = 200):
    """Operands by operation, in a random order of computation; the values 0 to 9 are there at the start."""
    rng, start = np.random.default_rng(seed), range(10)
    operands = {10 + i: tuple(int(k) for k in rng.integers(0, 10 + i, rng.integers(1, 4))) for i in range(count)}
    results = {10 + count - 1 - k for k in range(8)}
    return operands, results, set(start)


@pytest.mark.parametrize("seed", range(20))
def test_every_operation_comes_once_and_after_its_operands(seed):
    operands, results, start = random_graph(seed)
    order = order_with_few_values(list(operands), operands.__getitem__, results, start)
    assert sorted(order) == list(operands)
    place = {i: number for number, i in enumerate(order)}
    assert all(place[k] < place[i] for i in order for k in operands[i] if k in place)
    arguments = operands.__getitem__, results, start
    assert most_values(order, *arguments) <= most_values(list(operands), *arguments)


def test_a_chain_and_its_derivative_are_computed_side_by_side():
    """x ← f(x) twenty times, then all steps of its derivative: side by side two values suffice."""
    chain = {i: (i - 1,) for i in range(1, 21)}
    tangents = {100 + i: (100 + i - 1, i - 1) for i in range(1, 21)}  # each from the one before and from x
    operands = chain | tangents
    arguments = operands.__getitem__, {20, 120}, {0, 100}
    given = list(operands)
    assert most_values(given, *arguments) == 22
    order = order_with_few_values(given, *arguments)
    assert most_values(order, *arguments) == 2


def test_values_that_are_counted_by_hand():
    """a and b are there; c = a + b, d = a · c, e = c · d: never more than two, and one at the end."""
    operands = {2: (0, 1), 3: (0, 2), 4: (2, 3)}
    assert most_values([2, 3, 4], operands.__getitem__, {4}, {0, 1}) == 2
    assert most_values([2, 3, 4], operands.__getitem__, {1, 4}, {0, 1}) == 3


def test_the_order_is_the_same_on_every_call():
    """Else the PTX of a kernel would not be found in the cache."""
    assert kernel_of("pump", "float32").text == kernel_of.__wrapped__("pump", "float32").text
