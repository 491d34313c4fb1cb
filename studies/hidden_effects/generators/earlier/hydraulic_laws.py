"""Laws of chambers, oil and outlet, for the earlier judging set."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect, state
from studies.hidden_effects.generators.functions import outlet_line_drop
from studies.hidden_effects.generators.laws import Law


class BlasiusLeakage(Effect):
    """Turbulent leakage through a long smooth scratch: Q = Q_1 (Δp/0.5 MPa)^(4/7), signed.

    Source: Blasius' friction factor (1913).
    """

    scratch_flow: float = par(3e-7, "m^3/s", (0.0, 1e-3), "Q_1", plausible=(5e-9, 2e-6))

    def chamber_leakage(self, s, z):
        u = (s.chamber_pressure - s.accumulator_pressure) / 0.5e6
        return self.scratch_flow * u * (jnp.square(u) + 1e-6) ** (-1.5 / 7.0)


class WideningGapLeakage(Effect):
    """Leakage whose gap widens with pressure: π d δ³ (1 + Δp/1 MPa)³ Δp/(12 μ L) − (π d δ/2) v.

    Source: elastic deformation of a thin bore; the linear law is chosen.
    """

    widening_gap: float = par(20e-6, "m", (0.0, 1e-3), "δ", plausible=(12e-6, 30e-6))

    def chamber_leakage(self, s, z):
        drop = s.chamber_pressure - s.accumulator_pressure
        wide = 1.0 + jnp.maximum(drop, 0.0) / 1e6
        area = jnp.pi * s.piston_diameter * self.widening_gap
        flow = area * jnp.square(self.widening_gap) * wide * wide * wide * drop / (12.0 * s.viscosity * 20e-3)
        return flow - 0.5 * area * s.plunger_velocity


class DissolvingAir(Effect):
    """Air that dissolves in proportion to the pressure, completely at 1.2 MPa.

    Free volume α (p_atm/p) θ(p) with θ = 1 at ambient pressure and 0 at 1.2 MPa, linear between.

    Source: Henry's law; Gholizadeh, Burton, Schoenau, Int. J. Fluid Power 13 (2012) 7.
    """

    undissolved_air: float = par(0.005, "-", (1e-7, 0.2), "α", plausible=(0.002, 0.015))

    def oil_gas(self, s, z):
        return self.undissolved_air * s.atmospheric_pressure

    def oil_compressibility(self, s, z):
        p, span = s.pressure, 1.2e6 - s.atmospheric_pressure
        share = jnp.clip((1.2e6 - p) / span, 0.0, 1.0)
        rate = jnp.where((share > 0.0) & (share < 1.0), 1.0 / span, 0.0)
        return self.oil_gas(s, z) * (share / jnp.square(p) + rate / p)


class SlowlyDissolvingAir(Effect):
    """Air that dissolves more and more with pressure: free volume α (p_atm/p)/(1 + p/0.12 MPa).

    Source: Henry's law with a limited rate, as a fit over pressure; the form is chosen.
    """

    bubble_air: float = par(0.01, "-", (1e-7, 0.2), "α", plausible=(0.004, 0.03))

    def oil_gas(self, s, z):
        return self.bubble_air * s.atmospheric_pressure

    def oil_compressibility(self, s, z):
        u = s.pressure / 0.12e6
        return self.bubble_air * s.atmospheric_pressure * (1.0 + 2.0 * u) / jnp.square(s.pressure * (1.0 + u))


class ExponentialHose(Effect):
    """A hose that stiffens exponentially: C exp(−p/0.5 MPa).

    Source: chosen; a soft liner that is pressed against its braid.
    """

    liner_volume: float = par(5e-13, "m^3/Pa", (0.0, 1e-8), "C", plausible=(2e-14, 2e-11))

    def outlet_capacity(self, s, z):
        return self.liner_volume * jnp.exp(-s.outlet_pressure / 0.5e6)


class SofteningHose(Effect):
    """A hose that becomes softer with pressure: C √(p/0.3 MPa).

    Source: thin-walled rubber tubes, whose wall becomes thinner as they expand; the exponent is chosen.
    """

    liner_volume: float = par(3e-13, "m^3/Pa", (0.0, 1e-8), "C", plausible=(1e-14, 1e-11))

    def outlet_capacity(self, s, z):
        return self.liner_volume * jnp.sqrt(jnp.maximum(s.outlet_pressure, 0.0) / 0.3e6)


class UnsteadyLineInertance(Effect):
    """A line with inertance and unsteady friction: I dQ/dt = Δp − R Q − 2 R (Q − Q_s), dQ_s/dt = (Q − Q_s)/τ.

    Source: Zielke, J. Basic Eng. 90 (1968) 109; Trikha, J. Fluids Eng. 97 (1975) 97, with one term.
    """

    column_mass: float = par(1e7, "kg/m^4", (1e3, 1e12), "I", plausible=(1e6, 5e7))
    column_loss: float = par(5e8, "Pa*s/m^3", (0.0, 1e15), "R", plausible=(1e8, 1e9))
    diffusion_time: float = par(5e-3, "s", (1e-4, 10.0), "τ", plausible=(2e-3, 2e-2))

    line_flow = state("m^3/s", "flow through the line")
    slow_flow = state("m^3/s", "its part in equilibrium with the wall")

    def outlet_line_resistance(self, s, z):
        return self.column_loss

    def outlet_line_flow(self, s, z):
        return z.line_flow

    def rates(self, s, z):
        lag = z.line_flow - z.slow_flow
        drop = outlet_line_drop(s, z.line_flow)
        return {
            "line_flow": (drop - 2.0 * self.column_loss * lag) / self.column_mass,
            "slow_flow": lag / self.diffusion_time,
        }


class BlasiusLineInertance(Effect):
    """A smooth line with inertance and a loss ∝ Q^1.75.

    Source: Blasius' friction factor (1913).
    """

    column_mass: float = par(1e7, "kg/m^4", (1e3, 1e12), "I", plausible=(1e6, 5e7))
    column_loss: float = par(5e8, "Pa*s/m^3", (0.0, 1e15), "resistance at 1 L/min", plausible=(1e8, 2e9))

    line_flow = state("m^3/s", "flow through the line")

    def outlet_line_resistance(self, s, z):
        return self.column_loss * (jnp.square(z.line_flow / 1.67e-5) + 1e-6) ** 0.375

    def outlet_line_flow(self, s, z):
        return z.line_flow

    def rates(self, s, z):
        drop = outlet_line_drop(s, z.line_flow)
        return {"line_flow": drop / self.column_mass}


class BypassFilter(Effect):
    """A filter whose bypass opens with the pressure drop: R/(1 + ((p − p_s)/0.4 MPa)²).

    Source: return filters with a bypass valve; the form is chosen.
    """

    filter_resistance: float = par(1e9, "Pa*s/m^3", (0.0, 1e15), "R", plausible=(1e8, 1e10))

    def outlet_line_resistance(self, s, z):
        drop = (s.outlet_pressure - s.accumulator_pressure) / 0.4e6
        return self.filter_resistance / (1.0 + jnp.square(drop))


class CompressedFilter(Effect):
    """A filter whose felt is compressed by the pressure drop: R (0.5 + (p − p_s)/0.4 MPa).

    Source: compressible filter cakes; Ruth, Ind. Eng. Chem. 27 (1935) 708.
    """

    filter_resistance: float = par(1e9, "Pa*s/m^3", (0.0, 1e15), "R", plausible=(1e8, 1e10))

    def outlet_line_resistance(self, s, z):
        return self.filter_resistance * (0.5 + jnp.maximum(s.outlet_pressure - s.accumulator_pressure, 0.0) / 0.4e6)


class WaltherViscosity(Effect):
    """Viscosity by Walther's equation ln ln(ν + 0.8) = c − m ln T, ν in mm²/s, T in K, with ν = 46 mm²/s at 40 °C.

    Source: Walther, Erdöl und Teer 4 (1928) 510; ASTM D341.
    """

    walther_slope: float = par(3.6, "-", (-20.0, 20.0), "m", plausible=(3.0, 4.5))

    def oil_viscosity_factor(self, s, z):
        level = jnp.log(jnp.log(46.8)) - self.walther_slope * jnp.log(s.oil_temperature / 313.15)
        return (jnp.exp(jnp.exp(level)) - 0.8) / 46.0


class AndradeViscosity(Effect):
    """Viscosity by Andrade's formula: exp(B (1/T − 1/313 K)).

    Source: Andrade, Phil. Mag. 17 (1934) 497.
    """

    andrade_temperature: float = par(3000.0, "K", (-2e4, 2e4), "B", plausible=(2000.0, 5000.0))

    def oil_viscosity_factor(self, s, z):
        return jnp.exp(self.andrade_temperature * (1.0 / s.oil_temperature - 1.0 / 313.15))


class LinearPressureViscosity(Effect):
    """Viscosity that rises linearly with the pressure of the chamber alone: 1 + a p.

    Source: first term of Barus' law; the choice of the pressure is of this study.
    """

    chamber_rise: float = par(2e-8, "1/Pa", (0.0, 1e-6), "a", plausible=(1e-8, 1e-7))

    def gap_viscosity_factor(self, s, z):
        return 1.0 + self.chamber_rise * jnp.maximum(s.chamber_pressure, 0.0)


class ThresholdPressureViscosity(Effect):
    """Viscosity that rises above a pressure of the chamber only: 1 + a max(p − 0.6 MPa, 0).

    Source: chosen; additives that thicken the oil under pressure.
    """

    thickening: float = par(3e-8, "1/Pa", (0.0, 1e-6), "a", plausible=(1e-8, 2e-7))

    def gap_viscosity_factor(self, s, z):
        return 1.0 + self.thickening * jnp.maximum(s.chamber_pressure - 0.6e6, 0.0)


LAWS = (
    Law(library.PistonLeakage, BlasiusLeakage), Law(library.PistonLeakage, WideningGapLeakage),
    Law(library.EntrainedAir, DissolvingAir), Law(library.EntrainedAir, SlowlyDissolvingAir),
    Law(library.HoseCompliance, ExponentialHose), Law(library.HoseCompliance, SofteningHose),
    Law(library.OutletLineInertance, UnsteadyLineInertance), Law(library.OutletLineInertance, BlasiusLineInertance),
    Law(library.OutletLineResistance, BypassFilter), Law(library.OutletLineResistance, CompressedFilter),
    Law(library.OilTemperature, WaltherViscosity), Law(library.OilTemperature, AndradeViscosity),
    Law(library.PressureViscosity, LinearPressureViscosity), Law(library.PressureViscosity, ThresholdPressureViscosity),
)  # fmt: skip
