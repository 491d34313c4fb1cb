"""A spring load of the cylinder."""

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect


class LoadSpring(Effect):
    """A load whose force grows with the position: F = −k x_c.

    Source: statics.
    """

    looks_like = "head pressure that rises with the position of the cylinder"
    confused_with = ("load_force", "cylinder_leakage_rise", "cylinder_seal_friction")

    spring_rate: float = par(1e4, "N/m", (0.0, 1e9), "spring rate k", plausible=(1e2, 1e6))

    def cylinder_force(self, s, z):
        return -self.spring_rate * s.cylinder_position
