"""Drag by eddy currents in the coil carrier."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect


class EddyDrag(Effect):
    """Eddy currents brake a moving conductor; at high speed their own field weakens the drag.

    F = −c_e v / (1 + (v/v_e)²)

    Source: eddy-current brakes, e.g. Wouterse, IEE Proc. B 138 (1991) 153.
    """

    looks_like = "current in phase with speed that does not grow in proportion to it, without a step at reversal"
    confused_with = ("mover_damping", "pump_damping", "lugre_friction")

    eddy_coefficient: float = par(10.0, "N*s/m", (0.0, 1e4), "drag per speed at low speed, c_e", plausible=(1.0, 40.0))
    eddy_velocity: float = par(0.3, "m/s", (1e-3, 1e3), "speed of the largest drag v_e", plausible=(0.05, 1.0))

    def mover_force(self, s, z):
        v = s.piston_velocity
        return -self.eddy_coefficient * v / (1.0 + jnp.square(v / self.eddy_velocity))
