"""Dry friction that differs between the directions."""

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect
from edhas_jax.machine.effects.reference_scales import smooth_sign


class AsymmetricFriction(Effect):
    """Additional dry friction in the forward stroke, as of a lip seal.

    F = F_a th(v) (1 + th(v))/2,   th(v) = tanh(v / 5 mm/s)

    Source: chosen; friction of lip seals differs by 5 … 40 % between the directions.
    """

    looks_like = "an offset of the current in the forward stroke only"
    confused_with = ("constant_bias_force", "reluctance_force", "lugre_friction", "sensor_offset")

    forward_friction: float = par(1.5, "N", (0.0, 1e4), "further friction at v > 0, F_a", plausible=(0.3, 5.0))

    def mover_friction(self, s, z):
        forward = smooth_sign(s.sliding_velocity)
        return self.forward_friction * forward * 0.5 * (1.0 + forward)
