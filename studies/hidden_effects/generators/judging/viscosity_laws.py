"""Laws of the viscosity of oil, for judging."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect, state
from studies.hidden_effects.generators.laws import Law

ROELANDS_OFFSET = 9.67  # −ln of 6.31e-5 Pa·s, the viscosity at which the isotherms of Roelands meet


class VogelViscosity(Effect):
    """Viscosity by Vogel's equation: exp(B/(ϑ + 95 °C) − B/135 °C), ϑ in °C.

    Source: Vogel, Physik. Z. 22 (1921) 645; 95 °C for mineral oils by Cameron, The Principles of Lubrication (1966).
    """

    vogel_temperature: float = par(840.0, "K", (-2e4, 2e4), "B", plausible=(550.0, 1200.0))

    def oil_viscosity_factor(self, s, z):
        return jnp.exp(self.vogel_temperature * (1.0 / (s.oil_temperature - 178.15) - 1.0 / 135.0))


class RoelandsTemperature(Effect):
    """Viscosity by Roelands' equation: exp((ln μ_40 + 9.67) (((T − 138 K)/(313 K − 138 K))^(−S) − 1)), μ_40 in Pa·s.

    Source: Roelands, Correlational aspects of the viscosity-temperature-pressure relationship, thesis, Delft (1966).
    """

    roelands_slope: float = par(1.1, "-", (-20.0, 20.0), "S", plausible=(0.7, 1.6))

    def oil_viscosity_factor(self, s, z):
        ratio = jnp.maximum(s.oil_temperature - 138.0, 1.0) / (313.15 - 138.0)
        return jnp.exp((jnp.log(s.oil_viscosity) + ROELANDS_OFFSET) * (ratio ** (-self.roelands_slope) - 1.0))


class FluidityRise(Effect):
    """Viscosity whose reciprocal increases linearly with temperature: 1/(1 + b (ϑ − 40 °C)), at most 5.

    Source: Batschinski, Z. Phys. Chem. 84 (1913) 643: fluidity in proportion to the free volume.
    """

    fluidity_slope: float = par(0.03, "1/K", (-0.2, 0.2), "b", plausible=(0.015, 0.038))

    def oil_viscosity_factor(self, s, z):
        return 1.0 / jnp.maximum(1.0 + self.fluidity_slope * (s.oil_temperature - 313.15), 0.2)


class LevellingPressureViscosity(Effect):
    """Viscosity that increases with the mean pressure of the gap and saturates.

    1 + b p̄/(p̄ + 0.3 MPa), p̄ = (p + p_s)/2

    Source: the form is chosen; an additive whose contribution saturates.
    """

    levelling_rise: float = par(0.1, "-", (0.0, 10.0), "b", plausible=(0.03, 0.6))

    def gap_viscosity_factor(self, s, z):
        mean = 0.5 * jnp.maximum(s.chamber_pressure + s.accumulator_pressure, 0.0)
        return 1.0 + self.levelling_rise * mean / (mean + 0.3e6)


class LatePressureViscosity(Effect):
    """Viscosity that follows the outlet pressure with a first-order lag: 1 + a p_f, dp_f/dt = (p_o − p_f)/τ, τ = 15 ms.

    Source: volume relaxation with one time constant; Harrison, The Dynamic Properties of Supercooled Liquids (1976).
    """

    late_rise: float = par(3e-8, "1/Pa", (0.0, 1e-6), "a", plausible=(1e-8, 3e-7))

    followed_pressure = state("Pa", "pressure that the viscosity follows")

    def gap_viscosity_factor(self, s, z):
        return 1.0 + self.late_rise * jnp.maximum(z.followed_pressure, 0.0)

    def rates(self, s, z):
        return {"followed_pressure": (s.outlet_pressure - z.followed_pressure) / 15e-3}


LAWS = (
    Law(library.OilTemperature, VogelViscosity), Law(library.OilTemperature, RoelandsTemperature),
    Law(library.OilTemperature, FluidityRise), Law(library.PressureViscosity, LevellingPressureViscosity),
    Law(library.PressureViscosity, LatePressureViscosity),
)  # fmt: skip
