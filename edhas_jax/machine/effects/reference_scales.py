"""Reference travel and reference speed by which the formulas of several effects are scaled."""

import jax.numpy as jnp

REFERENCE_TRAVEL = 5e-3  # m, distance x_m from mid-stroke at which position-dependent effects have their stated size
SIGN_SMOOTHING_SPEED = 5e-3  # m/s, speed at which tanh has nearly reached the sign


def smooth_sign(velocity):
    """th(v) = tanh(v / 5 mm/s): the sign of a velocity [m/s], smooth through zero."""
    return jnp.tanh(velocity / SIGN_SMOOTHING_SPEED)
