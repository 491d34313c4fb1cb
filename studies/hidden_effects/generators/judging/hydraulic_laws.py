"""Laws of chambers, air and outlet, for judging."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect, state
from studies.hidden_effects.generators.functions import outlet_line_drop
from studies.hidden_effects.generators.laws import Law
from studies.hidden_effects.generators.places import is_chamber_b


def _gap_flow(s, gap, per_length):
    """Flow [m³/s] through an annular gap [m] around the plunger, of the reciprocal length `per_length` [1/m]."""
    area = jnp.pi * s.piston_diameter * gap
    drop = s.chamber_pressure - s.accumulator_pressure
    return area * jnp.square(gap) * drop * per_length / (12.0 * s.viscosity) - 0.5 * area * s.plunger_velocity


class OverlapLeakage(Effect):
    """Laminar leakage along a gap whose length grows as the plunger goes in: π d δ³ Δp/(12 μ (8 mm + x)) − (π d δ/2) v.

    Source: Ivantysyn, Ivantysynova, Hydrostatic Pumps and Motors (2001): guide length of a piston over its stroke.
    """

    overlap_gap: float = par(18e-6, "m", (0.0, 1e-3), "δ", plausible=(8e-6, 40e-6))

    def chamber_leakage(self, s, z):
        inward = -s.sliding_position if is_chamber_b(s) else s.sliding_position
        return _gap_flow(s, self.overlap_gap, 1.0 / jnp.maximum(8e-3 + inward, 1e-3))


class LeaningPlungerLeakage(Effect):
    """Leakage past a plunger whose eccentricity ε grows away from mid-stroke.

    π d δ³ (1 + 1.5 ε²) Δp/(12 μ L) − (π d δ/2) v

    ε² = x²/(x² + (3 mm)²).

    Source: eccentric annulus, Merritt, Hydraulic Control Systems (1967); the eccentricity over the stroke is chosen.
    """

    leaning_gap: float = par(20e-6, "m", (0.0, 1e-3), "δ", plausible=(10e-6, 40e-6))

    def chamber_leakage(self, s, z):
        square = jnp.square(s.sliding_position)
        return _gap_flow(s, self.leaning_gap, (1.0 + 1.5 * square / (square + 9e-6)) / 20e-3)


class CupSealLeakage(Effect):
    """Leakage past a pressure-energised cup seal: k Δp (0.1 + 0.9 exp(−|Δp|/0.3 MPa)).

    Source: lips that the pressure presses on, Müller, Nau, Fluid Sealing Technology (1998); the form is chosen.
    """

    cup_conductance: float = par(1e-13, "m^3/(s*Pa)", (0.0, 1e-6), "k", plausible=(5e-15, 2e-12))

    def chamber_leakage(self, s, z):
        drop = s.chamber_pressure - s.accumulator_pressure
        return self.cup_conductance * drop * (0.1 + 0.9 * jnp.exp(-jnp.abs(drop) / 0.3e6))


class SigmoidDissolvingAir(Effect):
    """Air that begins to dissolve at about 0.3 MPa and is dissolved at 1 MPa: free volume α (p_atm/p) θ.

    θ = (1 − u)⁵ (1 + 5 u + 15 u² + 35 u³ + 70 u⁴), u = (p − p_atm)/(1 MPa − p_atm), within 0 … 1.

    Source: smooth curve of undissolved gas in the fluid library of Simcenter Amesim; the pressure is chosen.
    """

    amount_of_air: float = par(0.005, "-", (1e-7, 0.2), "α", plausible=(3e-4, 0.015))

    def oil_gas(self, s, z):
        return self.amount_of_air * s.atmospheric_pressure

    def oil_compressibility(self, s, z):
        p, span = s.pressure, 1e6 - s.atmospheric_pressure
        u = jnp.clip((p - s.atmospheric_pressure) / span, 0.0, 1.0)
        rest, series = 1.0 - u, 1.0 + u * (5.0 + u * (15.0 + u * (35.0 + u * 70.0)))
        share = jnp.square(jnp.square(rest)) * rest * series
        slope = 630.0 * jnp.square(jnp.square(u * rest)) / span
        return self.oil_gas(s, z) * (share / p + slope) / p


class GraduallyDissolvingAir(Effect):
    """Air that dissolves with a first-order lag: α θ p_atm/p², dθ/dt = (1/(1 + (p_d − p_atm)/0.2 MPa) − θ)/τ, θ(0) = 1.

    Source: Yu, Chen, Lu, J. Dyn. Syst. Meas. Control 116 (1994) 146, for the delay; its dependence is chosen.
    """

    charged_air: float = par(0.006, "-", (1e-7, 0.2), "α", plausible=(4e-4, 0.03))
    dissolving_time: float = par(0.1, "s", (1e-3, 100.0), "τ", plausible=(0.04, 0.3))

    free_share = state("-", "share of the air that is still free", 1.0)

    def oil_gas(self, s, z):
        return self.charged_air * s.atmospheric_pressure

    def oil_compressibility(self, s, z):
        return self.oil_gas(s, z) * z.free_share / jnp.square(s.pressure)

    def rates(self, s, z):
        gauge = jnp.maximum(s.outlet_pressure - s.atmospheric_pressure, 0.0)
        return {"free_share": (1.0 / (1.0 + gauge / 0.2e6) - z.free_share) / self.dissolving_time}


class LogarithmicModulus(Effect):
    """Bulk modulus of aerated oil by an empirical formula.

    1/β = 1/β_f + κ (1/m − 1)/β_f, m = 0.5 lg(1 + 99 p/28 MPa), 1 at 28 MPa

    Source: Lee's formula, in Kajaste, Kauranne, Ellman, Pietola, Proc. 9th SICFP (2005); the factor κ is of this study.
    """

    aeration: float = par(2.0, "-", (1e-6, 1e3), "κ", plausible=(0.03, 8.0))

    def oil_gas(self, s, z):
        return 100.0 * self.aeration  # the compressibility at 0.1 MPa, as that of a gas

    def oil_compressibility(self, s, z):
        modulus = 0.5 / jnp.log(10.0) * jnp.log1p(99.0 * s.pressure / 28e6)
        return self.aeration * jnp.maximum(1.0 / modulus - 1.0, 0.0) / s.oil_bulk_modulus


class LinearModulusHose(Effect):
    """A hose whose modulus increases linearly with pressure: C/(1 + p/0.25 MPa), p above ambient.

    Source: fits to measured hoses, as in Hružík, Vašina, Bureček, EPJ Web of Conferences 45 (2013); pressure chosen.
    """

    hose_expansion: float = par(5e-13, "m^3/Pa", (0.0, 1e-8), "C", plausible=(5e-15, 2e-11))

    def outlet_capacity(self, s, z):
        gauge = jnp.maximum(s.outlet_pressure - s.atmospheric_pressure, 0.0)
        return self.hose_expansion / (1.0 + gauge / 0.25e6)


class BallooningHose(Effect):
    """A thin rubber tube, which becomes softer as it expands.

    C (1 − p/2 MPa)^(−3/2), p above ambient, constant beyond 1.6 MPa

    Source: thin tube of neo-Hookean rubber and constant length; Green, Adkins, Large Elastic Deformations (1960).
    """

    tube_expansion: float = par(2e-13, "m^3/Pa", (0.0, 1e-8), "C", plausible=(2e-15, 1e-11))

    def outlet_capacity(self, s, z):
        gauge = jnp.maximum(s.outlet_pressure - s.atmospheric_pressure, 0.0)
        return self.tube_expansion * jnp.maximum(1.0 - gauge / 2e6, 0.2) ** (-1.5)


class AcceleratedLineInertance(Effect):
    """A line with unsteady friction in accelerated flow: I (1 + k φ) dQ/dt = Δp − R Q.

    φ = (1 + tanh(Q (Δp − R Q)/0.2 W))/2 is 1 while the flow grows.

    Source: Brunone, Golia, Greco, Proc. Int. Conf. on Hydraulic Transients with Water Column Separation (1991) 293.
    """

    steady_inertance: float = par(1e7, "kg/m^4", (1e3, 1e12), "I", plausible=(2e5, 5e7))
    steady_resistance: float = par(5e7, "Pa*s/m^3", (0.0, 1e15), "R", plausible=(1e7, 3e8))
    added_inertia: float = par(0.5, "-", (0.0, 10.0), "k", plausible=(0.2, 1.0))

    column_flow = state("m^3/s", "flow through the line")

    def outlet_line_resistance(self, s, z):
        return self.steady_resistance

    def outlet_line_flow(self, s, z):
        return z.column_flow

    def rates(self, s, z):
        drop = outlet_line_drop(s, z.column_flow)
        growing = 0.5 * (1.0 + jnp.tanh(z.column_flow * drop / 0.2))
        return {"column_flow": drop / (self.steady_inertance * (1.0 + self.added_inertia * growing))}


class BlendedLineInertance(Effect):
    """A line with inertance, laminar up to about 0.6 L/min, then turbulent: R Q (1 + (Q/0.6 L/min)⁴)^(1/4).

    Source: blending of asymptotes by Churchill, Usagi, AIChE J. 18 (1972) 1121; its exponent is chosen.
    """

    blended_inertance: float = par(1e7, "kg/m^4", (1e3, 1e12), "I", plausible=(2e5, 5e7))
    laminar_resistance: float = par(5e7, "Pa*s/m^3", (0.0, 1e15), "R", plausible=(1e7, 3e8))

    column_flow = state("m^3/s", "flow through the line")

    def outlet_line_resistance(self, s, z):
        square = jnp.square(z.column_flow / 1e-5)
        return self.laminar_resistance * jnp.sqrt(jnp.sqrt(1.0 + jnp.square(square)))

    def outlet_line_flow(self, s, z):
        return z.column_flow

    def rates(self, s, z):
        drop = outlet_line_drop(s, z.column_flow)
        return {"column_flow": drop / self.blended_inertance}


class CakeFilter(Effect):
    """A filter whose cake grows with the volume that has passed since the start: R (1 + V/4 mL), dV/dt = Q.

    Source: cake filtration at constant specific resistance; Ruth, Ind. Eng. Chem. 27 (1935) 708.
    """

    clean_resistance: float = par(7e8, "Pa*s/m^3", (0.0, 1e15), "R", plausible=(2e7, 7e9))

    passed_volume = state("m^3", "oil that has passed")

    def outlet_line_resistance(self, s, z):
        return self.clean_resistance * (1.0 + z.passed_volume / 4e-6)

    def rates(self, s, z):
        return {"passed_volume": jnp.maximum(s.outlet_flow, 0.0)}


class TransitionLine(Effect):
    """A line with a sharp transition from laminar to turbulent flow.

    R (1 + 0.75 (1 + tanh((p − p_s − 0.2 MPa)/50 kPa)))

    Source: jump of the friction factor at the critical Reynolds number; Nikuradse (1933); the pressure is chosen.
    """

    smooth_resistance: float = par(1e9, "Pa*s/m^3", (0.0, 1e15), "R", plausible=(3e7, 1e10))

    def outlet_line_resistance(self, s, z):
        beyond = s.outlet_pressure - s.accumulator_pressure - 0.2e6
        return self.smooth_resistance * (1.0 + 0.75 * (1.0 + jnp.tanh(beyond / 50e3)))


LAWS = (
    Law(library.PistonLeakage, OverlapLeakage), Law(library.PistonLeakage, LeaningPlungerLeakage),
    Law(library.PistonLeakage, CupSealLeakage), Law(library.EntrainedAir, SigmoidDissolvingAir),
    Law(library.EntrainedAir, GraduallyDissolvingAir), Law(library.EntrainedAir, LogarithmicModulus),
    Law(library.HoseCompliance, LinearModulusHose), Law(library.HoseCompliance, BallooningHose),
    Law(library.OutletLineInertance, AcceleratedLineInertance), Law(library.OutletLineInertance, BlendedLineInertance),
    Law(library.OutletLineResistance, CakeFilter), Law(library.OutletLineResistance, TransitionLine),
)  # fmt: skip
