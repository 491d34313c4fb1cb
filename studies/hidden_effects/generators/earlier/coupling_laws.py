"""Laws of the coupling between coil carrier and plungers, for the earlier judging set."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect, state
from studies.hidden_effects.generators.laws import Law


class RubberCoupling(Effect):
    """A viscoelastic coupling (standard linear solid): F = (Δ + 1.5 (Δ − Δ_r))/C + 5 N·s/m Δ̇, dΔ_r/dt = (Δ − Δ_r)/τ.

    Source: standard linear solid (Zener, Elasticity and Anelasticity of Metals, 1948).
    """

    rubber_compliance: float = par(1e-6, "m/N", (1e-12, 1.0), "C", plausible=(1e-7, 1e-5))
    creep_time: float = par(2e-3, "s", (1e-5, 1.0), "τ", plausible=(5e-4, 1e-2))

    relaxed = state("m", "deflection at which the relaxing part is free of force")

    def coupling_force(self, s, z):
        d = s.coupling_deflection
        return (d + 1.5 * (d - z.relaxed)) / self.rubber_compliance + 5.0 * s.coupling_velocity

    def rates(self, s, z):
        return {"relaxed": (s.coupling_deflection - z.relaxed) / self.creep_time}


class OneSidedCoupling(Effect):
    """A coupling that is stiffer in compression than in tension: Δ/C for Δ > 0, Δ/(3 C) for Δ < 0, 20 N·s/m Δ̇.

    Source: a bolted joint that opens under tension; the factor is chosen.
    """

    joint_compliance: float = par(1e-6, "m/N", (1e-12, 1.0), "C", plausible=(1e-7, 1e-5))

    def coupling_force(self, s, z):
        d = s.coupling_deflection
        return jnp.where(d > 0.0, d, d / 3.0) / self.joint_compliance + 20.0 * s.coupling_velocity


class OilFilmBacklash(Effect):
    """Play that is filled with oil: contacts of 1e6 N/m beyond the play, and a viscous damping of 400 N·s/m.

    Source: chosen; a joint that is immersed in oil squeezes it out before its faces touch.
    """

    film_play: float = par(30e-6, "m", (0.0, 1e-2), "b", plausible=(2e-6, 100e-6))

    def coupling_force(self, s, z):
        d = s.coupling_deflection
        depth = jnp.maximum(jnp.abs(d) - 0.5 * self.film_play, 0.0)
        return 1e6 * jnp.where(d > 0.0, depth, -depth) + 400.0 * s.coupling_velocity


class RoundedBacklash(Effect):
    """Play with contacts whose stiffness grows from zero: 1e6 N/m Δ³/(Δ² + b²/4), 10 N·s/m Δ̇.

    Source: rough contacts, which stiffen as they are pressed on; the form is chosen.
    """

    rounded_play: float = par(30e-6, "m", (1e-9, 1e-2), "b", plausible=(3e-6, 150e-6))

    def coupling_force(self, s, z):
        d, half = s.coupling_deflection, 0.5 * self.rounded_play
        return 1e6 * d * d * d / (d * d + half * half) + 10.0 * s.coupling_velocity


LAWS = (
    Law(library.CouplingCompliance, RubberCoupling), Law(library.CouplingCompliance, OneSidedCoupling),
    Law(library.Backlash, OilFilmBacklash), Law(library.Backlash, RoundedBacklash),
)  # fmt: skip
