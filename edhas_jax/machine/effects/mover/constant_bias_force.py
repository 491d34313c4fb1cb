"""A constant force on the mover."""

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect


class ConstantBiasForce(Effect):
    """A constant force, as of weight on a tilted bench, unequal rod areas or a magnet: F = −F_b.

    Source: statics.
    """

    looks_like = "the mean of the current is not zero, by the same amount in every run"
    confused_with = ("sensor_offset", "asymmetric_friction", "reluctance_force")

    bias_force: float = par(1.0, "N", (-1e4, 1e4), "force towards negative x, F_b", plausible=(-5.0, 5.0))

    def mover_force(self, s, z):
        return -self.bias_force
