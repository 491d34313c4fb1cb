"""LuGre friction of mover and plungers."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect, state


class LugreFriction(Effect):
    """Dry friction as the deflection of bristles between the surfaces, with Stribeck effect and pre-sliding.

    F_f = σ0 z + σ1 ż + σ2 v,   ż = v − σ0 |v| z / G(v),   G(v) = F_C + (F_S − F_C) exp(−(v/v_S)²)

    The plausible ranges of Coulomb (from 15 to 50 N), static (25 to 80 N) and viscous friction (10 to 400 N·s/m) were
    widened so that they contain a linear drive, EMPS, with 20 N and 204 N·s/m.

    Source: Canudas de Wit, Olsson, Åström, Lischinsky, IEEE Trans. Autom. Control 40 (1995) 419; Actuators 2022,
    11(10), 281, Eq. (2).
    """

    looks_like = "current in phase with speed and nearly independent of it, a step at each reversal of the piston"
    confused_with = ("inverter_dead_time", "asymmetric_friction", "stroke_dependent_friction", "mover_damping")

    coulomb_friction: float = par(4.0, "N", (1e-6, 1e4), "friction while sliding, F_C", plausible=(0.5, 50.0))
    static_friction: float = par(
        6.0, "N", (1e-6, 1e4), "friction at break-away, F_S", plausible=(0.5, 80.0), at_least="coulomb_friction"
    )
    stribeck_velocity: float = par(
        0.02, "m/s", (1e-5, 1.0), "speed at which friction has fallen, v_S", plausible=(0.003, 0.1)
    )
    bristle_stiffness: float = par(1e5, "N/m", (1.0, 1e9), "stiffness before sliding, σ0", plausible=(1e4, 1e6))
    bristle_damping: float = par(100.0, "N*s/m", (0.0, 1e6), "damping of the bristles, σ1", plausible=(10.0, 1000.0))
    viscous_friction: float = par(2.0, "N*s/m", (0.0, 1e4), "viscous part, σ2", plausible=(0.5, 400.0))

    deflection = state("m", "mean deflection of the bristles")

    def _deflection_rate(self, v, z):
        """ż [m/s] by Eq. (2)."""
        level = self.coulomb_friction + (self.static_friction - self.coulomb_friction) * jnp.exp(
            -jnp.square(v / self.stribeck_velocity)
        )
        return v - self.bristle_stiffness * jnp.abs(v) * z / level

    def mover_friction(self, s, z):
        """F_f = σ0 z + σ1 ż + σ2 v [N] by Eq. (2)."""
        rate = self._deflection_rate(s.sliding_velocity, z.deflection)
        return (
            self.bristle_stiffness * z.deflection
            + self.bristle_damping * rate
            + self.viscous_friction * s.sliding_velocity
        )

    def rates(self, s, z):
        return {"deflection": self._deflection_rate(s.sliding_velocity, z.deflection)}
