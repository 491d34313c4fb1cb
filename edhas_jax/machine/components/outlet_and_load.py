"""The outlet node, its relief valve and the load orifice."""

import jax.numpy as jnp

from edhas_jax.core.structs import par, struct


@struct
class Outlet:
    """The volume behind the delivery valves, with a relief valve: Q_rv = G_rv max(p_d − p_set, 0)."""

    outlet_volume: float = par(20e-6, "m^3", (1e-9, 1.0), "volume of the outlet node V_d")
    relief_pressure: float = par(6e6, "Pa", (1e4, 1e9), "opening pressure of the relief valve p_set (absolute)")
    relief_conductance: float = par(1e-10, "m^3/(s*Pa)", (0.0, 1e-5), "flow per pressure above opening G_rv")

    def relief_flow(self, pressure):
        """The relief flow Q_rv [m³/s] at an absolute outlet pressure [Pa]."""
        return self.relief_conductance * jnp.maximum(pressure - self.relief_pressure, 0.0)


@struct
class LoadOrifice:
    """The load of the bench: an orifice from the outlet node back to the accumulator."""

    load_orifice_area: float = par(4.2e-6, "m^2", (1e-12, 1e-2), "area of the load orifice A_load")
