"""Laws of the coupling between coil carrier and plungers, for tuning."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect
from studies.hidden_effects.generators.laws import Law


class HardeningCoupling(Effect):
    """A coupling that hardens: k Δ (1 + (Δ/40 µm)²) + 20 N·s/m Δ̇, with the compliance 1/k.

    Source: preloaded joints, whose contact area grows with the load; the form is chosen.
    """

    rod_compliance: float = par(1e-6, "m/N", (1e-12, 1.0), "1/k", plausible=(1e-7, 1e-5))

    def coupling_force(self, s, z):
        d = s.coupling_deflection
        return d / self.rod_compliance * (1.0 + jnp.square(d / 40e-6)) + 20.0 * s.coupling_velocity


class HertzianBacklash(Effect):
    """Play with contacts after Hertz: k (|Δ| − b/2)^1.5 beyond the play, k = 1e8 N/m^1.5, and damping in contact.

    Source: Hertz (1881); Hunt, Crossley, J. Applied Mechanics 42 (1975) 440.
    """

    play: float = par(30e-6, "m", (0.0, 1e-2), "b", plausible=(2e-6, 100e-6))

    def coupling_force(self, s, z):
        d = s.coupling_deflection
        depth = jnp.maximum(jnp.abs(d) - 0.5 * self.play, 0.0)
        direction = jnp.where(d > 0.0, 1.0, -1.0)
        contact = depth * jnp.sqrt(depth + 1e-12)
        # 1e8 N/m^1.5 gives the stiffness of 1e6 N/m at 44 µm
        return direction * jnp.maximum(1e8 * contact * (1.0 + 0.3 * s.coupling_velocity * direction), 0.0)


LAWS = (Law(library.CouplingCompliance, HardeningCoupling), Law(library.Backlash, HertzianBacklash))
