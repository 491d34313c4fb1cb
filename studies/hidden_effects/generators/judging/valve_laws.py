"""Laws of check valves, for judging."""

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
    """A flow force that falls at large lift, where the bore limits the flow.

    −K A Δp/(1 + (2 A/A_s)²), A_s area of the seat

    Source: two restrictions in series, as in Stone, J. Basic Eng. 82 (1960) 144, for poppets; the factor 2 is chosen.
    """

    poppet_force: float = par(0.7, "-", (0.0, 10.0), "K", plausible=(0.15, 2.0))

    def check_valve_force(self, s, z):
        share = 2.0 * s.valve_area / (0.25 * jnp.pi * jnp.square(s.valve_seat_diameter))
        return -self.poppet_force * s.valve_area * s.pressure_drop / (1.0 + jnp.square(share))


class ReynoldsFlowForce(Effect):
    """A flow force that is smaller at low Reynolds numbers: −K A Δp Re/(Re + 60), Re = 2 y √(2 ρ |Δp|)/μ.

    Source: Wu, Burton, Schoenau, Int. J. Fluid Power 3 (2002) 27, for the dependence on Re; the form is chosen.
    """

    turbulent_force: float = par(0.8, "-", (0.0, 10.0), "K", plausible=(0.15, 2.5))

    def check_valve_force(self, s, z):
        speed = jnp.sqrt(2.0 * s.oil_density * jnp.sqrt(jnp.square(s.pressure_drop) + 1e4))
        reynolds = 2.0 * jnp.maximum(s.lift, 0.0) * speed / s.viscosity
        return -self.turbulent_force * s.valve_area * s.pressure_drop * reynolds / (reynolds + 60.0)


class TearingFilm(Effect):
    """Adhesion by a film of limited tensile strength: −F u/√(1 + u²), u = ẏ/(2 mm/s)/(1 + y/30 µm)³ for ẏ > 0.

    Source: cavitation in films that are pulled apart; Resch, Scheidl, Proc. IMechE C 228 (2014) 226; form chosen.
    """

    film_strength: float = par(0.8, "N", (0.0, 1e4), "F", plausible=(0.01, 3.0))

    def check_valve_force(self, s, z):
        gap = 1.0 + jnp.maximum(s.lift, 0.0) / 30e-6
        u = jnp.maximum(s.lift_velocity, 0.0) / 2e-3 / (gap * gap * gap)
        return -self.film_strength * u / jnp.sqrt(1.0 + jnp.square(u))


class RestingAdhesion(Effect):
    """Adhesion that grows while the ball rests on its seat.

    −F b n(y), n = exp(−max(y, 0)/25 µm); the bond b follows n with a first-order lag of 4 ms

    Source: static friction grows with the time at rest; Rabinowicz, Friction and Wear of Materials (1965); form chosen.
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
    """Squeeze-film damping between ball and conical seat in both directions: −c ẏ/(1 + y/15 µm)^1.5.

    Source: squeeze film of a line contact, ∝ gap^(−3/2); Hamrock, Fundamentals of Fluid Film Lubrication (1991).
    """

    contact_drag: float = par(10.0, "N*s/m", (0.0, 1e6), "c", plausible=(0.3, 200.0))

    def check_valve_force(self, s, z):
        gap = 1.0 + jnp.maximum(s.lift, 0.0) / 15e-6
        return -self.contact_drag * s.lift_velocity / (gap * jnp.sqrt(gap))


def _narrow(s):
    """The flow through a narrow gap, laminar far below 0.3 MPa, over that through an orifice of the same area."""
    size = jnp.abs(s.pressure_drop)
    return jnp.sqrt(size / (size + 0.3e6) + 1e-6)


def _silting(lift, silt):
    """The rate of the particles in the gap of a seat, which the flow removes while the valve is open."""
    seated = 1.0 / (1.0 + jnp.square(jnp.maximum(lift, 0.0) / NEAR_SEAT))
    return (seated - silt) / SILTING_TIME


class NarrowSuctionGap(Effect):
    """Leaking seats of the suction valves, laminar at small pressure drops: effective area A √(|Δp|/(|Δp| + 0.3 MPa)).

    Source: discharge coefficient ∝ √Re at small Re, constant at large; Merritt (1967); the pressure is chosen.
    """

    gap_area: float = par(5e-8, "m^2", (0.0, 1e-3), "A", plausible=(2e-9, 6e-7))

    def suction_valve_area(self, s, z):
        return self.gap_area * _narrow(s)


class SiltingSuctionSeat(Effect):
    """Leaking seats of the suction valves, which particles clog while they are closed: A (1 − 0.8 σ), σ within 15 ms.

    Source: silting of narrow gaps by fine particles, which the open valve flushes out; the form is chosen.
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
    """Leaking seats of the delivery valves, laminar at small pressure drops: effective area A √(|Δp|/(|Δp| + 0.3 MPa)).

    Source: discharge coefficient ∝ √Re at small Re, constant at large; Merritt (1967); the pressure is chosen.
    """

    gap_area: float = par(5e-8, "m^2", (0.0, 1e-3), "A", plausible=(2e-9, 6e-7))

    def delivery_valve_area(self, s, z):
        return self.gap_area * _narrow(s)


class SiltingDeliverySeat(Effect):
    """Leaking seats of the delivery valves, which particles clog while they are closed: A (1 − 0.8 σ), σ within 15 ms.

    Source: silting of narrow gaps by fine particles, which the open valve flushes out; the form is chosen.
    """

    flushed_area: float = par(5e-8, "m^2", (0.0, 1e-3), "A", plausible=(2e-9, 6e-7))

    silt_a = state("-", "silt in the seat of valve A")
    silt_b = state("-", "silt in the seat of valve B")

    def delivery_valve_area(self, s, z):
        silt = z.silt_a if valve_of(s) == "delivery_a" else z.silt_b
        return self.flushed_area * (1.0 - SILTED_SHARE * silt)

    def rates(self, s, z):
        return {"silt_a": _silting(s.delivery_lift_a, z.silt_a), "silt_b": _silting(s.delivery_lift_b, z.silt_b)}


LAWS = tuple(
    Law(mechanism, kind)
    for mechanism, kinds in (
        (library.ValveFlowForce, (TransientFlowForce, BoreLimitedFlowForce, ReynoldsFlowForce)),
        (library.ValveAdhesion, (TearingFilm, RestingAdhesion, LineContactFilm)),
        (library.SuctionSeatLeakage, (NarrowSuctionGap, SiltingSuctionSeat)),
        (library.DeliverySeatLeakage, (NarrowDeliveryGap, SiltingDeliverySeat)),
    )
    for kind in kinds
)
