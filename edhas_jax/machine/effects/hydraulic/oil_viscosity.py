"""Viscosity of the oil as a function of temperature, and of pressure."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect

REFERENCE_TEMPERATURE = 313.15  # K (40 °C), temperature at which `oil_viscosity` applies


class OilTemperature(Effect):
    """Viscosity that falls with temperature.

    μ → μ exp(−b (T − 40 °C)), T the `oil_temperature` of the run

    Source: Reynolds' law; b of mineral oils of ISO VG 32 … 46 between 20 and 60 °C.
    """

    looks_like = "leakage that follows the oil temperature of the runs; nothing where all runs are at 40 °C"
    confused_with = ("oil_viscosity", "piston_clearance", "pressure_viscosity")

    viscosity_exponent: float = par(0.03, "1/K", (-1.0, 1.0), "relative fall per kelvin b", plausible=(0.02, 0.05))

    def oil_viscosity_factor(self, s, z):
        return jnp.exp(-self.viscosity_exponent * (s.oil_temperature - REFERENCE_TEMPERATURE))


class PressureViscosity(Effect):
    """Viscosity that rises with pressure, in the gap of a plunger with the mean of the pressures at its ends.

    μ → μ exp(a (p + p_s)/2) in the pressure-driven part of the leakage

    Source: Barus' law; 1.3 … 3e-8 1/Pa for mineral oils.
    """

    looks_like = "leakage that grows less than the pressure, by an eighth at 7 MPa"
    confused_with = ("oil_viscosity", "piston_clearance", "oil_temperature")

    pressure_coefficient: float = par(2e-8, "1/Pa", (0.0, 1e-6), "relative rise per pressure a", plausible=(1e-8, 3e-8))

    def gap_viscosity_factor(self, s, z):
        return jnp.exp(0.5 * self.pressure_coefficient * (s.chamber_pressure + s.accumulator_pressure))
