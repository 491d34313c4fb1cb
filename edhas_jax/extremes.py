"""The larger and the smaller of two numbers, with a derivative that takes a side.

That of `jax.numpy.maximum` halves the derivative where both are equal, which costs two comparisons, two selections and
two products each time; here one selection by a comparison that a program often has anyway.
"""

import jax
import jax.numpy as jnp


@jax.custom_jvp
def larger(a, b):
    """max(a, b); the derivative is that of a where a > b, else that of b."""
    return jnp.maximum(a, b)


@larger.defjvp
def _larger(primals, tangents):
    (a, b), (da, db) = primals, tangents
    return larger(a, b), jnp.where(a > b, da, db)


@jax.custom_jvp
def smaller(a, b):
    """min(a, b); the derivative is that of a where a < b, else that of b."""
    return jnp.minimum(a, b)


@smaller.defjvp
def _smaller(primals, tangents):
    (a, b), (da, db) = primals, tangents
    return smaller(a, b), jnp.where(a < b, da, db)
