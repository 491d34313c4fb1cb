"""Laws of chambers, valves, oil and lines for practice cases, which are a second set of development cases."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect
from studies.hidden_effects.generators.laws import Law


class WideningLeakage(Effect):
    """Laminar leakage through a gap that pressure widens: π d δ³ Δp (1 + Δp/3 MPa)/(12 μ L).

    Source: Ivantysyn, Ivantysynova, Hydrostatic Pumps and Motors (2001): bores that widen under pressure.
    """

    widening_gap: float = par(22e-6, "m", (0.0, 1e-3), "δ", plausible=(14e-6, 35e-6))

    def chamber_leakage(self, s, z):
        drop = s.chamber_pressure - s.accumulator_pressure
        conductance = jnp.pi * s.piston_diameter * self.widening_gap**3 / (12.0 * s.viscosity * 20e-3)
        return conductance * drop * (1.0 + jnp.maximum(drop, 0.0) / 3e6)


class DissolvingAir(Effect):
    """Free air that dissolves under pressure: its compressibility is α p_atm/(p² (1 + p/2 MPa)).

    Source: Henry's law with a rate; Zhou, Vacca, Manhartsgruber, J. Dyn. Syst. Meas. Control 135 (2013); form chosen.
    """

    soluble_air: float = par(0.005, "-", (1e-7, 0.2), "air per volume of oil at 1 atm", plausible=(0.002, 0.02))

    def oil_gas(self, s, z):
        return self.soluble_air * s.atmospheric_pressure

    def oil_compressibility(self, s, z):
        return self.soluble_air * s.atmospheric_pressure / jnp.square(s.pressure) / (1.0 + s.pressure / 2e6)


class SwellingHose(Effect):
    """A hose that is softest at medium pressure: C (0.4 + u exp(1 − u)), u = p/0.8 MPa.

    Source: hoses whose layers settle before they carry; the form is chosen.
    """

    swelling_size: float = par(3e-13, "m^3/Pa", (0.0, 1e-8), "C", plausible=(3e-14, 1e-11))

    def outlet_capacity(self, s, z):
        u = jnp.maximum(s.outlet_pressure, 0.0) / 0.8e6
        return self.swelling_size * (0.4 + u * jnp.exp(1.0 - u))


class OpeningFlowForce(Effect):
    """A flow force that sets in as the valve opens: −K A Δp y/(y + 0.2 mm).

    Source: momentum of the jet, which grows with the flow; Merritt, Hydraulic Control Systems (1967); form chosen.
    """

    jet_share: float = par(0.6, "-", (0.0, 10.0), "K", plausible=(0.15, 1.5))

    def check_valve_force(self, s, z):
        lift = jnp.maximum(s.lift, 0.0)
        return -self.jet_share * s.valve_area * s.pressure_drop * lift / (lift + 0.2e-3)


class ViscousAdhesion(Effect):
    """Squeeze-film force of the oil between ball and seat: −c ẏ/(1 + y/20 µm)³ while the ball lifts.

    Source: Stefan, Sitzungsber. Akad. Wiss. Wien 69 (1874) 713: force inversely proportional to the cube of the gap.
    """

    film_drag: float = par(20.0, "N*s/m", (0.0, 1e6), "c", plausible=(2.0, 100.0))

    def check_valve_force(self, s, z):
        film = 1.0 + jnp.maximum(s.lift, 0.0) / 20e-6
        return -self.film_drag * jnp.maximum(s.lift_velocity, 0.0) / (film * film * film)


class ClosingSuctionLeak(Effect):
    """Leakage of the suction seats that decreases with pressure: area A/(1 + |Δp|/0.5 MPa).

    Source: soft seats that the pressure presses on; the form is chosen.
    """

    open_area: float = par(3e-8, "m^2", (0.0, 1e-3), "A", plausible=(2e-9, 3e-7))

    def suction_valve_area(self, s, z):
        return self.open_area / (1.0 + jnp.abs(s.pressure_drop) / 0.5e6)


class ClosingDeliveryLeak(Effect):
    """Leakage of the delivery seats that decreases with pressure: area A/(1 + |Δp|/0.5 MPa).

    Source: soft seats that the pressure presses on; the form is chosen.
    """

    open_area: float = par(3e-8, "m^2", (0.0, 1e-3), "A", plausible=(2e-9, 3e-7))

    def delivery_valve_area(self, s, z):
        return self.open_area / (1.0 + jnp.abs(s.pressure_drop) / 0.5e6)


class MixedLine(Effect):
    """A line with laminar and turbulent resistance, as a function of pressure: R (0.3 + 0.7 (p − p_s)/0.5 MPa).

    Source: Darcy-Weisbach friction with a transition; Merritt (1967).
    """

    mixed_size: float = par(1e9, "Pa*s/m^3", (0.0, 1e15), "R", plausible=(1e8, 1e10))

    def outlet_line_resistance(self, s, z):
        drop = jnp.maximum(s.outlet_pressure - s.accumulator_pressure, 0.0)
        return self.mixed_size * (0.3 + 0.7 * drop / 0.5e6)


class StrainerSuctionLine(Effect):
    """A suction line with a strainer, whose resistance grows with the square of the flow: R (0.5 + (v/0.2 m/s)²).

    Source: losses of woven screens at moderate Reynolds numbers; Idelchik, Handbook of Hydraulic Resistance.
    """

    strainer_size: float = par(3e8, "Pa*s/m^3", (1e3, 1e13), "R", plausible=(2e7, 3e9))

    def suction_line_resistance(self, s, z):
        return self.strainer_size * (0.5 + jnp.square(s.sliding_velocity / 0.2))


LAWS = (
    Law(library.PistonLeakage, WideningLeakage), Law(library.EntrainedAir, DissolvingAir),
    Law(library.HoseCompliance, SwellingHose), Law(library.ValveFlowForce, OpeningFlowForce),
    Law(library.ValveAdhesion, ViscousAdhesion), Law(library.SuctionSeatLeakage, ClosingSuctionLeak),
    Law(library.DeliverySeatLeakage, ClosingDeliveryLeak), Law(library.OutletLineResistance, MixedLine),
    Law(library.SuctionLineResistance, StrainerSuctionLine),
)  # fmt: skip
