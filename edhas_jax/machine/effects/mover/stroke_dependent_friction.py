"""Friction that grows towards the ends of the stroke."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect
from edhas_jax.machine.effects.reference_scales import REFERENCE_TRAVEL, smooth_sign


class StrokeDependentFriction(Effect):
    """Dry friction that grows towards the ends of the stroke, as of a narrow bore or a misaligned guide.

    F = F_s (x/x_m)² th(v),   x_m = 5 mm,   th(v) = tanh(v / 5 mm/s)

    Source: chosen; the lowest even order of a friction that depends on position.
    """

    looks_like = "half the difference of the current between the directions grows towards the ends of the stroke"
    confused_with = ("force_constant_droop", "cogging_force", "lugre_friction", "seal_friction")

    end_friction: float = par(3.0, "N", (0.0, 1e4), "further friction 5 mm from mid-stroke, F_s", plausible=(0.5, 10.0))

    def mover_friction(self, s, z):
        return self.end_friction * jnp.square(s.sliding_position / REFERENCE_TRAVEL) * smooth_sign(s.sliding_velocity)
