"""A force constant that falls towards the ends of the stroke."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect
from edhas_jax.machine.effects.reference_scales import REFERENCE_TRAVEL


class ForceConstantDroop(Effect):
    """The coil leaves the uniform field of the magnet at the ends of its travel.

    Km → Km (1 − κ (x/x_m)²), x_m = 5 mm, in force and back-EMF alike

    Source: bell-shaped force curves of voice coils, e.g. J. Synchrotron Rad. 17 (2010), article kv5082, Fig. 4.
    """

    looks_like = "more current towards the ends of the stroke, in proportion to the load; third harmonic of the current"
    confused_with = ("magnetic_saturation", "stroke_dependent_friction", "force_constant", "parasitic_spring")

    droop: float = par(0.1, "-", (-1.0, 1.0), "share of Km lost 5 mm from mid-stroke, κ", plausible=(0.03, 0.3))

    def force_constant_factor(self, s, z):
        return 1.0 - self.droop * jnp.square(s.piston_position / REFERENCE_TRAVEL)
