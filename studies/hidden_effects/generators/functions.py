"""Functions that several laws use, and some that the machine code of the engine does not have, from those it has."""

import jax.numpy as jnp
import numpy as np

# minimax coefficients of atan(x)/x in x² on 0 … 1, fitted below; their error is below 1e-9
_DEGREE = 14
_nodes = 0.5 * (1.0 + np.cos(np.pi * (np.arange(200) + 0.5) / 200))  # of x², Chebyshev
_ATAN = np.polynomial.Polynomial.fit(_nodes, np.arctan(np.sqrt(_nodes)) / np.sqrt(_nodes), _DEGREE, domain=[0.0, 1.0])
_COEFFICIENTS = _ATAN.convert().coef


def arctan(x):
    """atan x, to 1e-9."""
    size = jnp.abs(x)
    small = jnp.minimum(size, 1.0 / jnp.maximum(size, 1e-300))
    square, value = small * small, 0.0
    for c in _COEFFICIENTS[::-1]:
        value = value * square + float(c)
    value = small * value
    return jnp.where(x < 0.0, -1.0, 1.0) * jnp.where(size > 1.0, 0.5 * np.pi - value, value)


def wrapped(angle):
    """An angle [rad] less whole turns, −π … π."""
    return 2.0 * arctan(jnp.sin(angle) / jnp.maximum(1.0 + jnp.cos(angle), 1e-9))


def gauge_pressures(s):
    """Pressures of both pump chambers above ambient [Pa], at least 0."""
    return [jnp.maximum(p - s.atmospheric_pressure, 0.0) for p in (s.chamber_pressure_a, s.chamber_pressure_b)]


def smooth_positive(x, width):
    """max(x, 0), rounded within `width` of zero."""
    return 0.5 * (x + jnp.sqrt(jnp.square(x) + width * width))


def suction_line_drop(s, flow):
    """Pressure [Pa] that accelerates a flow [m³/s] through the suction line: what its resistance leaves."""
    return s.accumulator_pressure - s.suction_pressure - s.suction_line_resistance * flow


def outlet_line_drop(s, flow):
    """Pressure [Pa] that accelerates a flow [m³/s] through the outlet line: what its resistance and the load leave."""
    return s.outlet_pressure - s.accumulator_pressure - s.outlet_line_resistance * flow - s.load_drop
