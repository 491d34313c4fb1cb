"""Products and sums of local partial derivatives, without tracing operations that ±1 and selections make superfluous.

A partial derivative is a JAX scalar, a Python float that is known while tracing, or a `Mask`.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp

# one vertex: {predecessor: partial derivative of the vertex by the predecessor}
Row = dict[Any, Any]


class Mask(NamedTuple):
    """A partial derivative that is 1 where `condition` holds and 0 elsewhere.

    Its product with a number is a selection, so that a branch that is not taken contributes nothing, not even 0 · ∞.
    """

    condition: Any


def as_number(partial):
    """A partial derivative as a number: a `Mask` becomes 1 or 0."""
    return jnp.where(partial.condition, 1.0, 0.0) if isinstance(partial, Mask) else partial


def multiply(a, b):
    """The product of two partial derivatives; multiplication by ±1 or by a `Mask` traces no product."""
    if isinstance(a, float) and isinstance(b, float):
        return a * b
    for factor, other in ((a, b), (b, a)):
        if isinstance(factor, float) and factor == 1.0:
            return other
        if isinstance(factor, float) and factor == -1.0:
            return -as_number(other)
    for mask, other in ((a, b), (b, a)):
        if isinstance(mask, Mask):
            if isinstance(other, Mask):
                return Mask(mask.condition & other.condition)
            return jnp.where(mask.condition, other, 0.0)
    return a * b


def add(a, b):
    """The sum of two partial derivatives."""
    return as_number(a) + as_number(b)
