"""Viscous friction that differs between the directions."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect


class AsymmetricDamping(Effect):
    """Viscous friction that differs between forward and backward, as of a worn screw or of guides under a side load.

    F = −c_a |v|: the damping coefficient is higher by c_a forward and lower by c_a backward

    Source: measured on a linear drive, 167 and 240 N·s/m (Janot, Gautier, Brunot: EMPS, 2019). The effect is in the
    library because of that record, so finding it there is no independent test.
    """

    looks_like = "an offset of the current that grows with speed, of one sign in both directions"
    confused_with = ("asymmetric_friction", "constant_bias_force", "reluctance_force")

    damping_difference: float = par(
        5.0, "N*s/m", (-1e4, 1e4), "half of forward less backward damping, c_a", plausible=(-60.0, 60.0)
    )

    def mover_force(self, s, z):
        return -self.damping_difference * jnp.abs(s.piston_velocity)
