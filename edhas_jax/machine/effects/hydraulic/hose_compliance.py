"""Compliance of a hose behind the delivery valves."""

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect


class HoseCompliance(Effect):
    """A hose that expands with pressure: V_d/β → V_d/β + C_h.

    Source: V/β of a hose with a bulk modulus of 50 … 700 MPa.
    """

    looks_like = "less ripple of the outlet pressure, at low and at high pressure alike"
    confused_with = ("air_fraction", "outlet_volume", "sensor_lag", "oil_bulk_modulus")

    hose_compliance: float = par(3e-13, "m^3/Pa", (0.0, 1e-8), "volume per pressure C_h", plausible=(1e-14, 1e-11))

    def outlet_capacity(self, s, z):
        return self.hose_compliance
