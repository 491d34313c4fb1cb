"""Heating of the coil by its copper loss."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect, state

COPPER_TEMPERATURE_COEFFICIENT = 0.00393  # 1/K, of the resistance


class CoilHeating(Effect):
    """The copper loss heats the coil, and its resistance rises.

    R → R (1 + 0.00393 ϑ),   C dϑ/dt = R i² − ϑ/R_th

    Source: IEC 60028 for copper; time constants of voice coils 20 … 300 s, of the bare winding less.
    """

    looks_like = "more voltage for the same current, growing through the run and with the load"
    confused_with = ("coil_resistance", "inverter_dead_time", "supply_sag")

    heat_capacity: float = par(10.0, "J/K", (1e-2, 1e6), "heat capacity C", plausible=(1.0, 50.0))
    thermal_resistance: float = par(
        3.0, "K/W", (1e-3, 1e4), "resistance to the surroundings R_th", plausible=(0.5, 10.0)
    )

    temperature_rise = state("K", "temperature above that at the start")

    def coil_resistance_factor(self, s, z):
        return 1.0 + COPPER_TEMPERATURE_COEFFICIENT * z.temperature_rise

    def rates(self, s, z):
        heat = s.resistance * jnp.square(s.current) - z.temperature_rise / self.thermal_resistance
        return {"temperature_rise": heat / self.heat_capacity}
