"""A parasitic spring between mover and frame."""

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect


class ParasiticSpring(Effect):
    """A cable, a seal or a flexure that pulls the mover to mid-stroke: F = −k x.

    Source: statics.
    """

    looks_like = "current in phase with position, in proportion to the amplitude and independent of frequency"
    confused_with = ("mover_mass", "plunger_mass", "cogging_force", "coupling_compliance")

    spring_rate: float = par(500.0, "N/m", (0.0, 1e8), "spring rate k", plausible=(50.0, 5000.0))

    def mover_force(self, s, z):
        return -self.spring_rate * s.piston_position
