"""Saturation of the motor force at large current."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect


class MagneticSaturation(Effect):
    """The iron saturates under the field of the coil.

    F_e = Km i / √(1 + (i/i_s)²), back-EMF unchanged

    Source: chosen; a smooth form of the armature reaction in moving-coil motors.
    """

    looks_like = "current peaks sharper and higher than the load requires; nothing at small current"
    confused_with = ("force_constant_droop", "force_constant", "seal_friction")

    saturation_current: float = par(
        15.0, "A", (0.1, 1e5), "current at which the force is 1/√2 of the linear one, i_s", plausible=(3.0, 50.0)
    )

    def motor_force_factor(self, s, z):
        return 1.0 / jnp.sqrt(1.0 + jnp.square(s.current / self.saturation_current))
