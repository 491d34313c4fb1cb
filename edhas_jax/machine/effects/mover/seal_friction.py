"""Friction of the plunger seals that grows with the pressure."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect
from edhas_jax.machine.effects.reference_scales import smooth_sign


class SealFriction(Effect):
    """Dry friction of the plunger seals, in proportion to the pressure in the chambers.

    F = μ_s S_p (max(p_A − p_atm, 0) + max(p_B − p_atm, 0)) th(v),   th(v) = tanh(v / 5 mm/s)

    Source: chosen; 1 … 15 N/MPa for seals of 12 mm.
    """

    looks_like = "current in phase with the sign of the speed that grows with the pressure; nothing without load"
    confused_with = ("magnetic_saturation", "lugre_friction", "force_constant", "piston_clearance")

    seal_coefficient: float = par(0.03, "-", (0.0, 10.0), "friction over pressure force μ_s", plausible=(0.005, 0.2))

    def mover_friction(self, s, z):
        gauge = [jnp.maximum(p - s.atmospheric_pressure, 0.0) for p in (s.chamber_pressure_a, s.chamber_pressure_b)]
        return self.seal_coefficient * s.piston_area * sum(gauge[1:], gauge[0]) * smooth_sign(s.sliding_velocity)
