"""Laws of check valves and suction line, for judging."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect, state
from studies.hidden_effects.generators.laws import Law
from studies.hidden_effects.generators.places import valve_of

NEAR_SEAT = 30e-6  # m, lift within which a valve is on its seat or close to it
BOND_HEIGHT, BOND_TIME = 25e-6, 4e-3  # m and s, of an adhesion that builds up at rest
SILTING_TIME, SILTED_SHARE = 15e-3, 0.8  # s, and the largest share of a gap that silts up


class TransientFlowForce(Effect):
    """Flow force with its transient part: −K A Δp − l Cd π d sin θ √(2 ρ |Δp|) ẏ, l the damping length.

    Source: Merritt, Hydraulic Control Systems (1967), steady and transient flow forces.
    """

    steady_share: float = par(0.5, "-", (0.0, 10.0), "K", plausible=(0.1, 1.5))
    damping_length: float = par(6e-3, "m", (0.0, 1.0), "l", plausible=(2e-3, 2e-2))

    def check_valve_force(self, s, z):
        width = jnp.pi * s.valve_seat_diameter * jnp.sin(s.valve_seat_angle)
        size = jnp.sqrt(jnp.square(s.pressure_drop) + 1e6)
        transient = self.damping_length * s.discharge_coefficient * width * jnp.sqrt(2.0 * s.oil_density * size)
        return -self.steady_share * s.valve_area * s.pressure_drop - transient * s.lift_velocity


class BoreLimitedFlowForce(Effect):
    """A flow force of a valve whose bore limits the flow at large lift: −K A Δp/(1 + (2 A/A_s)²), A_s area of the seat.

    Source: two restrictions in series, as in Stone, J. Basic Eng. 82 (1960) 144, for poppets; the factor 2 is chosen.
    """

    poppet_force: float = par(0.7, "-", (0.0, 10.0), "K", plausible=(0.15, 2.0))

    def check_valve_force(self, s, z):
        share = 2.0 * s.valve_area / (0.25 * jnp.pi * jnp.square(s.valve_seat_diameter))
        return -self.poppet_force * s.valve_area * s.pressure_drop / (1.0 + jnp.square(share))


class ReynoldsFlowForce(Effect):
    """A flow force that is weak in laminar flow: −K A Δp Re/(Re + 60), Re = 2 y √(2 ρ |Δp|)/μ.

    Source: Wu, Burton, Schoenau, Int. J. Fluid Power 3 (2002) 27, for the dependence on Re; the form is chosen.
    """

    turbulent_force: float = par(0.8, "-", (0.0, 10.0), "K", plausible=(0.15, 2.5))

    def check_valve_force(self, s, z):
        speed = jnp.sqrt(2.0 * s.oil_density * jnp.sqrt(jnp.square(s.pressure_drop) + 1e4))
        reynolds = 2.0 * jnp.maximum(s.lift, 0.0) * speed / s.viscosity
        return -self.turbulent_force * s.valve_area * s.pressure_drop * reynolds / (reynolds + 60.0)


class TearingFilm(Effect):
    """A film that tears where the tension is too large: −F u/√(1 + u²), u = ẏ/(2 mm/s)/(1 + y/30 µm)³ for ẏ > 0.

    Source: cavitation in films that are pulled apart; Resch, Scheidl, Proc. IMechE C 228 (2014) 226; form chosen.
    """

    film_strength: float = par(0.8, "N", (0.0, 1e4), "F", plausible=(0.01, 3.0))

    def check_valve_force(self, s, z):
        gap = 1.0 + jnp.maximum(s.lift, 0.0) / 30e-6
        u = jnp.maximum(s.lift_velocity, 0.0) / 2e-3 / (gap * gap * gap)
        return -self.film_strength * u / jnp.sqrt(1.0 + jnp.square(u))


class RestingAdhesion(Effect):
    """Adhesion that builds up while the ball rests: −F b n(y), db/dt = (n(y) − b)/4 ms, n = exp(−max(y, 0)/25 µm).

    Source: adhesion that grows with the time at rest; Rabinowicz, Friction and Wear of Materials (1965); form chosen.
    """

    bond_force: float = par(0.8, "N", (0.0, 1e4), "F", plausible=(0.01, 3.0))

    suction_a = state("-", "bond of the ball of suction valve A")
    suction_b = state("-", "bond of the ball of suction valve B")
    delivery_a = state("-", "bond of the ball of delivery valve A")
    delivery_b = state("-", "bond of the ball of delivery valve B")

    def _nearness(self, lift):
        return jnp.exp(-jnp.maximum(lift, 0.0) / BOND_HEIGHT)

    def check_valve_force(self, s, z):
        return -self.bond_force * getattr(z, valve_of(s)) * self._nearness(s.lift)

    def rates(self, s, z):
        lifts = {
            "suction_a": s.suction_lift_a, "suction_b": s.suction_lift_b,
            "delivery_a": s.delivery_lift_a, "delivery_b": s.delivery_lift_b,
        }  # fmt: skip
        return {name: (self._nearness(lift) - getattr(z, name)) / BOND_TIME for name, lift in lifts.items()}


class LineContactFilm(Effect):
    """The film between ball and cone resists motion both ways: −c ẏ/(1 + y/15 µm)^1.5.

    Source: squeeze film of a line contact, ∝ gap^(−3/2); Hamrock, Fundamentals of Fluid Film Lubrication (1991).
    """

    contact_drag: float = par(10.0, "N*s/m", (0.0, 1e6), "c", plausible=(0.3, 200.0))

    def check_valve_force(self, s, z):
        gap = 1.0 + jnp.maximum(s.lift, 0.0) / 15e-6
        return -self.contact_drag * s.lift_velocity / (gap * jnp.sqrt(gap))


def _narrow(s):
    """What is left of the flow through a narrow gap, laminar far below 0.3 MPa, relative to an orifice."""
    size = jnp.abs(s.pressure_drop)
    return jnp.sqrt(size / (size + 0.3e6) + 1e-6)


def _silting(lift, silt):
    """The rate of the silt in the gap of a seat, which is flushed while the valve is open."""
    seated = 1.0 / (1.0 + jnp.square(jnp.maximum(lift, 0.0) / NEAR_SEAT))
    return (seated - silt) / SILTING_TIME


class NarrowSuctionGap(Effect):
    """Narrow gaps in the seats of the suction valves: an area A √(|Δp|/(|Δp| + 0.3 MPa)), laminar at small drops.

    Source: discharge coefficient ∝ √Re at small Re, constant at large; Merritt (1967); the pressure is chosen.
    """

    gap_area: float = par(5e-8, "m^2", (0.0, 1e-3), "A", plausible=(2e-9, 6e-7))

    def suction_valve_area(self, s, z):
        return self.gap_area * _narrow(s)


class SiltingSuctionSeat(Effect):
    """Gaps in the seats of the suction valves that silt up while they are closed: A (1 − 0.8 σ), σ follows in 15 ms.

    Source: silting of narrow gaps by fine particles, which the next opening flushes away; the form is chosen.
    """

    flushed_area: float = par(5e-8, "m^2", (0.0, 1e-3), "A", plausible=(2e-9, 6e-7))

    silt_a = state("-", "silt in the seat of valve A")
    silt_b = state("-", "silt in the seat of valve B")

    def suction_valve_area(self, s, z):
        silt = z.silt_a if valve_of(s) == "suction_a" else z.silt_b
        return self.flushed_area * (1.0 - SILTED_SHARE * silt)

    def rates(self, s, z):
        return {"silt_a": _silting(s.suction_lift_a, z.silt_a), "silt_b": _silting(s.suction_lift_b, z.silt_b)}


class NarrowDeliveryGap(Effect):
    """Narrow gaps in the seats of the delivery valves: an area A √(|Δp|/(|Δp| + 0.3 MPa)), laminar at small drops.

    Source: discharge coefficient ∝ √Re at small Re, constant at large; Merritt (1967); the pressure is chosen.
    """

    gap_area: float = par(5e-8, "m^2", (0.0, 1e-3), "A", plausible=(2e-9, 6e-7))

    def delivery_valve_area(self, s, z):
        return self.gap_area * _narrow(s)


class SiltingDeliverySeat(Effect):
    """Gaps in the seats of the delivery valves that silt up while they are closed: A (1 − 0.8 σ), σ follows in 15 ms.

    Source: silting of narrow gaps by fine particles, which the next opening flushes away; the form is chosen.
    """

    flushed_area: float = par(5e-8, "m^2", (0.0, 1e-3), "A", plausible=(2e-9, 6e-7))

    silt_a = state("-", "silt in the seat of valve A")
    silt_b = state("-", "silt in the seat of valve B")

    def delivery_valve_area(self, s, z):
        silt = z.silt_a if valve_of(s) == "delivery_a" else z.silt_b
        return self.flushed_area * (1.0 - SILTED_SHARE * silt)

    def rates(self, s, z):
        return {"silt_a": _silting(s.delivery_lift_a, z.silt_a), "silt_b": _silting(s.delivery_lift_b, z.silt_b)}


class SuckedInHose(Effect):
    """A suction hose that flattens within 3 ms as its pressure falls: R (1 + u/40 kPa), du/dt = (p_s − p_m − u)/3 ms.

    Source: limited flow through collapsible tubes; Shapiro, J. Biomech. Eng. 99 (1977) 126; the form is chosen.
    """

    round_resistance: float = par(2e8, "Pa*s/m^3", (1e3, 1e13), "R", plausible=(1e7, 1e9))

    suction_drop = state("Pa", "pressure drop that the wall has followed")

    def suction_line_resistance(self, s, z):
        return self.round_resistance * (1.0 + jnp.maximum(z.suction_drop, 0.0) / 40e3)

    def rates(self, s, z):
        return {"suction_drop": (s.accumulator_pressure - s.suction_pressure - z.suction_drop) / 3e-3}


class ColdSuctionLine(Effect):
    """A suction line full of cold oil, which warm oil displaces: R (0.3 + 0.7 exp(−V/4 mL)), dV/dt = Q.

    Source: Hagen-Poiseuille, with the viscosity of well-mixed oil; the volume and the change are chosen.
    """

    cold_resistance: float = par(4e8, "Pa*s/m^3", (1e3, 1e13), "R", plausible=(2e7, 4e9))

    drawn_volume = state("m^3", "oil that has been drawn in")

    def suction_line_resistance(self, s, z):
        return self.cold_resistance * (0.3 + 0.7 * jnp.exp(-jnp.maximum(z.drawn_volume, 0.0) / 4e-6))

    def rates(self, s, z):
        return {"drawn_volume": s.suction_line_flow}


class FootValveLine(Effect):
    """A suction line with a spring-loaded foot valve: R = R_0 + p_0/√(Q_v² + (0.1 L/min)²), R_0 = 3e7 Pa·s/m³.

    The valve follows the flow late: dQ_v/dt = (Q − Q_v)/2 ms.

    Source: a valve with a soft spring, whose pressure drop is that of opening at any flow.
    """

    opening_pressure: float = par(5e3, "Pa", (0.0, 1e6), "p_0", plausible=(200.0, 5e4))

    valve_flow = state("m^3/s", "flow for which the foot valve is open")

    def suction_line_resistance(self, s, z):
        return 3e7 + self.opening_pressure / jnp.sqrt(jnp.square(z.valve_flow) + (1.67e-6) ** 2)

    def rates(self, s, z):
        return {"valve_flow": (s.suction_line_flow - z.valve_flow) / 2e-3}


class ProfiledSuctionInertance(Effect):
    """A suction line whose velocity profile adds to its inertia: I (1 + 1/(3 (1 + (Q/0.9 L/min)²))) dQ/dt = Δp − R Q.

    Source: momentum factor of 4/3 for laminar and 1 for turbulent flow; the blending is chosen.
    """

    flat_inertance: float = par(1e7, "kg/m^4", (1e3, 1e12), "I", plausible=(2e5, 5e7))
    drawn_resistance: float = par(3e7, "Pa*s/m^3", (0.0, 1e15), "R", plausible=(5e6, 1.5e8))

    drawn_flow = state("m^3/s", "flow through the line")

    def suction_line_resistance(self, s, z):
        return self.drawn_resistance

    def suction_line_flow(self, s, z):
        return z.drawn_flow

    def rates(self, s, z):
        drop = s.accumulator_pressure - s.suction_pressure - s.suction_line_resistance * z.drawn_flow
        profile = 1.0 + 1.0 / (3.0 * (1.0 + jnp.square(z.drawn_flow / 1.5e-5)))
        return {"drawn_flow": drop / (self.flat_inertance * profile)}


class CoiledSuctionInertance(Effect):
    """A coiled suction line, with inertia and secondary flow: I dQ/dt = Δp − R Q (1 + (Q/0.24 L/min)²)^(1/4).

    Source: loss of coils ∝ √De at large Dean numbers; White, Proc. R. Soc. A 123 (1929) 645; the blending is chosen.
    """

    coil_inertance: float = par(1e7, "kg/m^4", (1e3, 1e12), "I", plausible=(2e5, 5e7))
    coil_loss: float = par(3e7, "Pa*s/m^3", (0.0, 1e15), "R", plausible=(5e6, 1e8))

    drawn_flow = state("m^3/s", "flow through the line")

    def suction_line_resistance(self, s, z):
        return self.coil_loss * jnp.sqrt(jnp.sqrt(1.0 + jnp.square(z.drawn_flow / 4e-6)))

    def suction_line_flow(self, s, z):
        return z.drawn_flow

    def rates(self, s, z):
        drop = s.accumulator_pressure - s.suction_pressure - s.suction_line_resistance * z.drawn_flow
        return {"drawn_flow": drop / self.coil_inertance}


LAWS = tuple(
    Law(mechanism, kind)
    for mechanism, kinds in (
        (library.ValveFlowForce, (TransientFlowForce, BoreLimitedFlowForce, ReynoldsFlowForce)),
        (library.ValveAdhesion, (TearingFilm, RestingAdhesion, LineContactFilm)),
        (library.SuctionSeatLeakage, (NarrowSuctionGap, SiltingSuctionSeat)),
        (library.DeliverySeatLeakage, (NarrowDeliveryGap, SiltingDeliverySeat)),
        (library.SuctionLineResistance, (SuckedInHose, ColdSuctionLine, FootValveLine)),
        (library.SuctionLineInertance, (ProfiledSuctionInertance, CoiledSuctionInertance)),
    )
    for kind in kinds
)
