"""Voltage drop of the supply under load."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect


class SupplySag(Effect):
    """The supply voltage drops at the internal resistance of supply and leads.

    U_max → max(U_max − R_s |i|, 0), for the limit of the command and for the anti-windup

    Source: a voltage source with internal resistance.
    """

    looks_like = "the command is cut off below the nominal limit, the lower the larger the current; else nothing"
    confused_with = ("supply_voltage", "coil_resistance", "magnetic_saturation")

    supply_resistance: float = par(0.3, "ohm", (0.0, 1e3), "internal resistance R_s", plausible=(0.05, 1.0))

    def supply_voltage_change(self, s, z):
        return -jnp.minimum(self.supply_resistance * jnp.abs(s.current), s.supply_voltage)
