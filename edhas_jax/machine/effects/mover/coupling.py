"""Coupling between coil carrier and plungers: its elasticity, and its backlash."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect


class CouplingCompliance(Effect):
    """An elastic rod between the coil carrier and the plungers.

    F = k Δ + d Δ̇,   Δ the lag of the plungers behind the coil carrier, whose position is measured

    Source: two masses joined by a Kelvin-Voigt element.
    """

    looks_like = (
        "less flow in proportion to the pressure, piston as commanded; ringing at 0.3 … 3 kHz after each reversal"
    )
    confused_with = ("backlash", "hose_compliance", "air_fraction", "piston_clearance")

    coupling_stiffness: float = par(1e6, "N/m", (1e3, 1e10), "stiffness k", plausible=(1e5, 1e7))
    coupling_damping: float = par(20.0, "N*s/m", (0.0, 1e6), "damping d", plausible=(1.0, 200.0))

    def coupling_force(self, s, z):
        return self.coupling_stiffness * s.coupling_deflection + self.coupling_damping * s.coupling_velocity


class Backlash(Effect):
    """Play between the coil carrier and the plungers.

    F = sgn Δ max(k (|Δ| − b/2) + d Δ̇ sgn Δ, 0) while |Δ| > b/2, else 0: never adhesive

    Source: Modelica.Mechanics.Translational, ElastoGap, with damping in contact only.
    """

    looks_like = "the same volume of flow lost in every cycle, at any load; a spike of the current after each reversal"
    confused_with = ("coupling_compliance", "air_fraction", "pump_dead_volume", "suction_seat_leakage")

    backlash_width: float = par(30e-6, "m", (0.0, 1e-2), "play from contact to contact b", plausible=(2e-6, 100e-6))
    contact_stiffness: float = par(1e6, "N/m", (1e3, 1e10), "stiffness of a contact k")
    contact_damping: float = par(20.0, "N*s/m", (0.0, 1e6), "damping of a contact d")

    def coupling_force(self, s, z):
        is_positive = s.coupling_deflection > 0.0
        depth = jnp.abs(s.coupling_deflection) - 0.5 * self.backlash_width
        speed = jnp.where(is_positive, s.coupling_velocity, -s.coupling_velocity)
        force = jnp.maximum(self.contact_stiffness * depth + self.contact_damping * speed, 0.0)
        force = jnp.where(depth > 0.0, force, 0.0)
        return jnp.where(is_positive, force, -force)
