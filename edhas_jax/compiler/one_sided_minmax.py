"""Maximum and minimum of two numbers with a one-sided derivative where both are equal.

The derivative of `jax.numpy.maximum` is the mean of both sides at equality, which costs two comparisons, two selections
and two products. The one-sided derivative costs one selection, by a comparison that the value often needs as well.
"""

import operator
from collections.abc import Callable

import jax
import jax.numpy as jnp


def _with_one_sided_derivative(selects_first: Callable) -> Callable:
    """A decorator for f(a, b): its derivative is that of a where `selects_first(a, b)`, else that of b."""

    def decorate(f):
        one_sided = jax.custom_jvp(f)
        one_sided.defjvp(
            lambda primals, tangents: (one_sided(*primals), jnp.where(selects_first(*primals), *tangents))
        )
        return one_sided

    return decorate


@_with_one_sided_derivative(operator.gt)
def one_sided_max(a, b):
    """max(a, b); the derivative is that of a where a > b, else that of b."""
    return jnp.maximum(a, b)


@_with_one_sided_derivative(operator.lt)
def one_sided_min(a, b):
    """min(a, b); the derivative is that of a where a < b, else that of b."""
    return jnp.minimum(a, b)
