"""Laws of chambers, valves, oil and lines, for tuning."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect, state
from studies.hidden_effects.generators.functions import outlet_line_drop, signed_root, suction_line_drop
from studies.hidden_effects.generators.laws import Law

SCRATCH_PRESSURE = 0.2e6  # Pa, at which a scratch has its stated area


class ConcentricLeakage(Effect):
    """Laminar leakage past a concentric plunger, without the flow that it drags along: π d δ³ Δp/(12 μ L).

    Source: Blackburn, Reethof, Shearer, Fluid Power Control (1960).
    """

    leakage_gap: float = par(22e-6, "m", (0.0, 1e-3), "δ", plausible=(12e-6, 35e-6))

    def chamber_leakage(self, s, z):
        conductance = jnp.pi * s.piston_diameter * self.leakage_gap**3 / (12.0 * s.viscosity * 20e-3)
        return conductance * (s.chamber_pressure - s.accumulator_pressure)


class OrificeLeakage(Effect):
    """Leakage through a short scratch in the bore, an orifice: Q = A √(2 Δp/ρ), linear below 1 kPa.

    Source: Merritt, Hydraulic Control Systems (1967), sharp-edged orifices.
    """

    scratch_area: float = par(2e-8, "m^2", (0.0, 1e-3), "A", plausible=(1e-9, 1e-7))

    def chamber_leakage(self, s, z):
        drop = s.chamber_pressure - s.accumulator_pressure
        return self.scratch_area * signed_root(2.0 * drop / s.oil_density, 2e3 / 860.0)


class PolytropicAir(Effect):
    """Air that does not have the time to take the temperature of the oil: V ∝ p^(−1/1.4).

    Source: Gholizadeh, Burton, Schoenau, Int. J. Fluid Power 13 (2012) 7.
    """

    free_air: float = par(0.005, "-", (1e-7, 0.2), "volume of air per volume of oil at 1 atm", plausible=(0.002, 0.015))

    def oil_gas(self, s, z):
        return self.free_air * s.atmospheric_pressure

    def oil_compressibility(self, s, z):
        return self.free_air / (1.4 * s.pressure) * (s.atmospheric_pressure / s.pressure) ** (1.0 / 1.4)


class StiffeningHose(Effect):
    """A hose that stiffens with pressure: C/(1 + (p/0.6 MPa)²).

    Source: measured hoses, whose expansion per pressure falls once the braid carries the load.
    """

    hose_size: float = par(3e-13, "m^3/Pa", (0.0, 1e-8), "C", plausible=(1e-14, 1e-11))

    def outlet_capacity(self, s, z):
        return self.hose_size / (1.0 + jnp.square(s.outlet_pressure / 0.6e6))


class FadingFlowForce(Effect):
    """A flow force that fades as the valve opens: −K A Δp exp(−y/0.4 mm).

    Source: Johnston, Edge, Vaughan, Proc. IMechE I 205 (1991) 263: poppet forces that depend on opening; form chosen.
    """

    flow_force_size: float = par(0.5, "-", (0.0, 10.0), "K", plausible=(0.1, 1.5))

    def check_valve_force(self, s, z):
        fade = jnp.exp(-jnp.maximum(s.lift, 0.0) / 0.4e-3)
        return -self.flow_force_size * s.valve_area * s.pressure_drop * fade


class TurningJetForce(Effect):
    """A flow force whose jet turns towards the plane of the seat: −K A Δp cos(0.8 rad + 0.7 rad y/1 mm), down to 0.

    Source: von Mises' jet angle, which changes with opening; Merritt (1967).
    """

    flow_force_size: float = par(0.7, "-", (0.0, 10.0), "K", plausible=(0.15, 2.0))

    def check_valve_force(self, s, z):
        angle = jnp.minimum(0.8 + 0.7e3 * jnp.maximum(s.lift, 0.0), 0.5 * jnp.pi)
        return -self.flow_force_size * s.valve_area * s.pressure_drop * jnp.cos(angle)


class ExponentialAdhesion(Effect):
    """Adhesion of the ball that falls exponentially with lift: −F exp(−y/15 µm) while it opens.

    Source: chosen; measured adhesion of reed and plate valves falls within some tens of micrometres.
    """

    adhesion_size: float = par(1.0, "N", (0.0, 1e4), "F", plausible=(0.1, 5.0))

    def check_valve_force(self, s, z):
        film = jnp.exp(-jnp.maximum(s.lift, 0.0) / 15e-6)
        return -self.adhesion_size * film * 0.5 * (1.0 + jnp.tanh(s.lift_velocity / 0.5e-3))


class SuctionScratch(Effect):
    """A fine scratch in the seat of the suction valves with laminar flow: area ∝ √Δp, so that Q ∝ Δp.

    Source: laminar leakage of seat valves at small openings; Merritt (1967).
    """

    scratch_size: float = par(3e-8, "m^2", (0.0, 1e-3), "area at 0.2 MPa", plausible=(1e-9, 3e-7))

    def suction_valve_area(self, s, z):
        return self.scratch_size * jnp.sqrt(jnp.abs(s.pressure_drop) / SCRATCH_PRESSURE + 1e-6)


class DeliveryScratch(Effect):
    """A fine scratch in the seat of the delivery valves with laminar flow: area ∝ √Δp, so that Q ∝ Δp.

    Source: laminar leakage of seat valves at small openings; Merritt (1967).
    """

    scratch_size: float = par(3e-8, "m^2", (0.0, 1e-3), "area at 0.2 MPa", plausible=(1e-9, 3e-7))

    def delivery_valve_area(self, s, z):
        return self.scratch_size * jnp.sqrt(jnp.abs(s.pressure_drop) / SCRATCH_PRESSURE + 1e-6)


class TurbulentLineInertance(Effect):
    """A line with inertia and turbulent loss: I dQ/dt = Δp − k |Q| Q.

    Source: rigid-column theory with Darcy-Weisbach friction; Wylie, Streeter, Fluid Transients (1978).
    """

    line_mass: float = par(1e7, "kg/m^4", (1e3, 1e12), "I", plausible=(1e6, 5e7))
    line_loss: float = par(3e12, "kg/m^7", (0.0, 1e20), "k", plausible=(5e11, 1e13))

    line_flow = state("m^3/s", "flow through the line")

    def outlet_line_resistance(self, s, z):
        return self.line_loss * jnp.abs(z.line_flow)

    def outlet_line_flow(self, s, z):
        return z.line_flow

    def rates(self, s, z):
        drop = outlet_line_drop(s, z.line_flow)
        return {"line_flow": drop / self.line_mass}


class TurbulentLine(Effect):
    """A line whose resistance grows with the flow, as the root of the pressure: R √((p − p_s)/0.5 MPa).

    Source: Darcy-Weisbach friction.
    """

    line_size: float = par(1e9, "Pa*s/m^3", (0.0, 1e15), "R", plausible=(1e8, 1e10))

    def outlet_line_resistance(self, s, z):
        drop = jnp.maximum(s.outlet_pressure - s.accumulator_pressure, 0.0)
        return self.line_size * jnp.sqrt(drop / 0.5e6 + 1e-4)


class TurbulentSuctionLine(Effect):
    """A suction line whose resistance grows with the flow: R (0.2 + |v|/0.2 m/s), v the speed of the plungers.

    Source: Darcy-Weisbach friction.
    """

    suction_size: float = par(3e8, "Pa*s/m^3", (1e3, 1e13), "R", plausible=(1e7, 3e9))

    def suction_line_resistance(self, s, z):
        return self.suction_size * (0.2 + jnp.abs(s.sliding_velocity) / 0.2)


class TurbulentSuctionInertance(Effect):
    """A suction line with inertia and turbulent loss: I dQ/dt = p_s − p_m − (R + k |Q|) Q.

    Source: rigid-column theory with Darcy-Weisbach friction; Wylie, Streeter, Fluid Transients (1978).
    """

    suction_mass: float = par(1e7, "kg/m^4", (1e3, 1e12), "I", plausible=(1e6, 5e7))
    suction_loss: float = par(1e12, "kg/m^7", (0.0, 1e20), "k", plausible=(2e11, 4e12))

    line_flow = state("m^3/s", "flow through the line")

    def suction_line_resistance(self, s, z):
        return 5e6 + self.suction_loss * jnp.abs(z.line_flow)

    def suction_line_flow(self, s, z):
        return z.line_flow

    def rates(self, s, z):
        drop = suction_line_drop(s, z.line_flow)
        return {"line_flow": drop / self.suction_mass}


class SlotteViscosity(Effect):
    """Viscosity by a power of the temperature in °C: μ (ϑ/40 °C)^(−m).

    Source: Slotte's formula, Wied. Ann. Phys. 14 (1881) 13.
    """

    slotte_exponent: float = par(1.3, "-", (-10.0, 10.0), "m", plausible=(0.8, 2.2))

    def oil_viscosity_factor(self, s, z):
        return jnp.maximum((s.oil_temperature - 273.15) / 40.0, 0.05) ** (-self.slotte_exponent)


class SquarePressureViscosity(Effect):
    """Viscosity that rises with the square of the pressure in the gap: 1 + a p̄²/0.5 MPa, p̄ = (p + p_s)/2.

    Source: second-order term of pressure-viscosity fits; chosen alone, as a contrast to Barus' law.
    """

    viscosity_rise: float = par(2e-8, "1/Pa", (0.0, 1e-6), "a", plausible=(1e-8, 1e-7))

    def gap_viscosity_factor(self, s, z):
        mean = 0.5 * jnp.maximum(s.chamber_pressure + s.accumulator_pressure, 0.0)
        return 1.0 + self.viscosity_rise * mean * mean / 0.5e6


LAWS = (
    Law(library.PistonLeakage, ConcentricLeakage), Law(library.PistonLeakage, OrificeLeakage),
    Law(library.EntrainedAir, PolytropicAir), Law(library.HoseCompliance, StiffeningHose),
    Law(library.ValveFlowForce, FadingFlowForce), Law(library.ValveFlowForce, TurningJetForce),
    Law(library.ValveAdhesion, ExponentialAdhesion), Law(library.SuctionSeatLeakage, SuctionScratch),
    Law(library.DeliverySeatLeakage, DeliveryScratch), Law(library.OutletLineInertance, TurbulentLineInertance),
    Law(library.OutletLineResistance, TurbulentLine), Law(library.SuctionLineResistance, TurbulentSuctionLine),
    Law(library.SuctionLineInertance, TurbulentSuctionInertance), Law(library.OilTemperature, SlotteViscosity),
    Law(library.PressureViscosity, SquarePressureViscosity),
)  # fmt: skip
