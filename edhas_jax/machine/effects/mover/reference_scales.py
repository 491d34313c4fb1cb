"""What several effects of the mover share: the travel and the speed that their formulas are scaled by."""

import jax.numpy as jnp

TRAVEL = 5e-3  # m, the distance from mid-stroke x_m at which position-dependent effects have their stated size
SPEED = 5e-3  # m/s, the speed at which a smooth friction has built up


def direction(velocity):
    """th(v) = tanh(v / 5 mm/s): the sign of a speed, smooth through zero."""
    return jnp.tanh(velocity / SPEED)
