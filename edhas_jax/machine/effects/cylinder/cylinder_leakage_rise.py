"""Cylinder leakage that rises with the position, as of a worn bore."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect


class CylinderLeakageRise(Effect):
    """Leakage between the sides that grows with the distance from the head end: K_il → K_il + k max(x_c, 0).

    Source: leakage that grows over the stroke, JSME MoViC 2017, B01; the linear law is chosen.
    """

    looks_like = "a cylinder under load that is slower, and creeps back faster, the further it is out"
    confused_with = ("cylinder_leakage", "load_spring")

    leakage_slope: float = par(1e-11, "m^2/(s*Pa)", (0.0, 1e-6), "conductance per position k", plausible=(1e-12, 1e-10))

    def cylinder_leakage_change(self, s, z):
        """Added conductance [m³/(s·Pa)]."""
        return self.leakage_slope * jnp.maximum(s.cylinder_position, 0.0)
