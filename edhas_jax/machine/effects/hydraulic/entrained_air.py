"""Entrained air in the oil."""

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect


class EntrainedAir(Effect):
    """Air bubbles that make the oil compressible at low pressure.

    1/β(p) = α p_atm/p² + (1 − α p_atm/p)/β_f,   p absolute; the contribution is the difference from 1/β_f

    Source: Actuators 2022, 11(10), 281, Eq. (4), for isothermal bubbles.
    """

    looks_like = "a rounded rise of chamber pressure, late opening of the delivery valves; gone above 1 … 3 MPa"
    confused_with = ("hose_compliance", "pump_dead_volume", "backlash")

    air_fraction: float = par(
        0.005, "-", (1e-7, 0.2), "volume of free air per volume of oil at 1 atm, α", plausible=(5e-4, 0.05)
    )

    def oil_gas(self, s, z):
        """Free gas a = α p_atm [Pa], which sets the pole of the strain pressure."""
        return self.air_fraction * s.atmospheric_pressure

    def oil_compressibility(self, s, z):
        """1/β(p) − 1/β_f [1/Pa] by Eq. (4)."""
        return self.oil_gas(s, z) / s.pressure * (1.0 / s.pressure - 1.0 / s.oil_bulk_modulus)
