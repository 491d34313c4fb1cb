"""Friction of the cylinder seals that grows with the pressure."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect


class CylinderSealFriction(Effect):
    """Both dry friction levels of the cylinder, F_d and F_m, grow by μ_r A max(p_h − p_atm, 0).

    Source: O-ring friction in cylinders, PLoS ONE 18 (2023) e0280815, for the dependence on contact pressure.
    """

    looks_like = "a dead band of the cylinder that grows with the load"
    confused_with = ("karnopp_friction", "cylinder_sliding_friction", "load_spring")

    seal_coefficient: float = par(0.02, "-", (0.0, 10.0), "friction over pressure force μ_r", plausible=(0.005, 0.1))

    def cylinder_friction_level(self, s, z):
        """Added friction level [N]."""
        gauge = jnp.maximum(s.head_pressure - s.atmospheric_pressure, 0.0)
        return self.seal_coefficient * s.cylinder_area * gauge
