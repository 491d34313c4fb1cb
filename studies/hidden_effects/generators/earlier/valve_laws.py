"""Laws of check valves and suction line, for the earlier judging set."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect, state
from studies.hidden_effects.generators.functions import suction_line_drop
from studies.hidden_effects.generators.laws import Law

SEATED_LIFT = 30e-6  # m, within which the valve counts as seated


class LiftedFlowForce(Effect):
    """A flow force that grows with the lift: −K A Δp y/(y + 0.3 mm).

    Source: at small openings the jet attaches to the seat; Johnston, Edge, Vaughan, Proc. IMechE I 205 (1991) 263.
    """

    jet_force: float = par(0.7, "-", (0.0, 10.0), "K", plausible=(0.15, 2.0))

    def check_valve_force(self, s, z):
        y = jnp.maximum(s.lift, 0.0)
        return -self.jet_force * s.valve_area * s.pressure_drop * y / (y + 0.3e-3)


class RecoveringFlowForce(Effect):
    """A flow force that grows less than the pressure drop: −K A Δp/(1 + |Δp|/20 kPa).

    Source: pressure recovery behind the seat; the form is chosen.
    """

    jet_force: float = par(0.7, "-", (0.0, 10.0), "K", plausible=(0.15, 2.5))

    def check_valve_force(self, s, z):
        return -self.jet_force * s.valve_area * s.pressure_drop / (1.0 + jnp.abs(s.pressure_drop) / 20e3)


class SqueezeFilm(Effect):
    """Squeeze-film damping between ball and seat, while the valve opens: −c ẏ/(1 + y/25 µm)³ for ẏ > 0.

    Source: Stefan (1874): force on plates that are pulled apart in a liquid, ∝ speed/gap³.
    """

    film_damping: float = par(50.0, "N*s/m", (0.0, 1e6), "c", plausible=(3.0, 1000.0))

    def check_valve_force(self, s, z):
        gap = 1.0 + jnp.maximum(s.lift, 0.0) / 25e-6
        return -self.film_damping * jnp.maximum(s.lift_velocity, 0.0) / (gap * gap * gap)


class AttractedBall(Effect):
    """An attraction to the seat that does not depend on speed: −F/(1 + (y/60 µm)²)².

    Source: a magnetised ball; attraction over a gap, the form is chosen.
    """

    attraction: float = par(0.5, "N", (0.0, 1e4), "F", plausible=(0.05, 3.0))

    def check_valve_force(self, s, z):
        return -self.attraction / jnp.square(1.0 + jnp.square(jnp.maximum(s.lift, 0.0) / 60e-6))


def _seated(s):
    """1 while a valve is closed, falling to 0 within `SEATED_LIFT`."""
    return jnp.exp(-jnp.maximum(s.lift, 0.0) / SEATED_LIFT)


def _closing(s):
    """The share of a leak that is left under pressure, by which the seat closes."""
    return 1.0 / (1.0 + jnp.abs(s.pressure_drop) / 0.15e6)


class SeatedSuctionLeak(Effect):
    """A particle on the seat of the suction valves: an area only while the valve is seated.

    Source: chosen; the particle is washed away while the valve is open.
    """

    particle_area: float = par(3e-8, "m^2", (0.0, 1e-3), "area", plausible=(1e-9, 3e-7))

    def suction_valve_area(self, s, z):
        return self.particle_area * _seated(s)


class SeatedDeliveryLeak(Effect):
    """A particle on the seat of the delivery valves: an area only while the valve is seated.

    Source: chosen; the particle is washed away while the valve is open.
    """

    particle_area: float = par(3e-8, "m^2", (0.0, 1e-3), "area", plausible=(1e-9, 3e-7))

    def delivery_valve_area(self, s, z):
        return self.particle_area * _seated(s)


class ClosingSuctionSeat(Effect):
    """A soft seat of the suction valves, which closes under pressure: A/(1 + |Δp|/0.15 MPa).

    Source: polymer seats, whose leakage falls as the contact pressure grows; the form is chosen.
    """

    soft_area: float = par(5e-8, "m^2", (0.0, 1e-3), "area without pressure", plausible=(2e-9, 6e-7))

    def suction_valve_area(self, s, z):
        return self.soft_area * _closing(s)


class ClosingDeliverySeat(Effect):
    """A soft seat of the delivery valves, which closes under pressure: A/(1 + |Δp|/0.15 MPa).

    Source: polymer seats, whose leakage falls as the contact pressure grows; the form is chosen.
    """

    soft_area: float = par(5e-8, "m^2", (0.0, 1e-3), "area without pressure", plausible=(2e-9, 6e-7))

    def delivery_valve_area(self, s, z):
        return self.soft_area * _closing(s)


class CollapsingSuctionHose(Effect):
    """A suction hose that collapses as the flow grows: R (0.3 + (v/0.25 m/s)²), v the speed of the plungers.

    Source: collapsible tubes; Shapiro, J. Biomech. Eng. 99 (1977) 126; the form is chosen.
    """

    hose_resistance: float = par(3e8, "Pa*s/m^3", (1e3, 1e13), "R", plausible=(1e7, 3e9))

    def suction_line_resistance(self, s, z):
        return self.hose_resistance * (0.3 + jnp.square(s.sliding_velocity / 0.25))


class SuctionStrainer(Effect):
    """A strainer whose mesh lifts as the flow grows: R/(1 + |v|/0.08 m/s), v the speed of the plungers.

    Source: relief of strainers by a spring-loaded cage; the form is chosen.
    """

    strainer_resistance: float = par(5e8, "Pa*s/m^3", (1e3, 1e13), "R", plausible=(2e7, 5e9))

    def suction_line_resistance(self, s, z):
        return self.strainer_resistance / (1.0 + jnp.abs(s.sliding_velocity) / 0.08)


class UnsteadySuctionInertance(Effect):
    """A suction line with inertance and unsteady friction: I dQ/dt = Δp − R Q − 2 R (Q − Q_s), dQ_s/dt = (Q − Q_s)/τ.

    Source: Zielke, J. Basic Eng. 90 (1968) 109; Trikha, J. Fluids Eng. 97 (1975) 97, with one term.
    """

    suction_column: float = par(1e7, "kg/m^4", (1e3, 1e12), "I", plausible=(1e6, 5e7))
    wall_time: float = par(5e-3, "s", (1e-4, 10.0), "τ", plausible=(2e-3, 2e-2))

    line_flow = state("m^3/s", "flow through the line")
    slow_flow = state("m^3/s", "its part in equilibrium with the wall")

    def suction_line_resistance(self, s, z):
        return 3e7

    def suction_line_flow(self, s, z):
        return z.line_flow

    def rates(self, s, z):
        lag = z.line_flow - z.slow_flow
        drop = suction_line_drop(s, z.line_flow + 2.0 * lag)
        return {"line_flow": drop / self.suction_column, "slow_flow": lag / self.wall_time}


class BlasiusSuctionInertance(Effect):
    """A smooth suction line with inertance and a loss ∝ Q^1.75.

    Source: Blasius' friction factor (1913).
    """

    suction_column: float = par(1e7, "kg/m^4", (1e3, 1e12), "I", plausible=(1e6, 5e7))
    wall_loss: float = par(5e7, "Pa*s/m^3", (0.0, 1e15), "resistance at 1 L/min", plausible=(1e7, 2e8))

    line_flow = state("m^3/s", "flow through the line")

    def suction_line_resistance(self, s, z):
        return self.wall_loss * (jnp.square(z.line_flow / 1.67e-5) + 1e-3) ** 0.375

    def suction_line_flow(self, s, z):
        return z.line_flow

    def rates(self, s, z):
        drop = suction_line_drop(s, z.line_flow)
        return {"line_flow": drop / self.suction_column}


LAWS = (
    Law(library.ValveFlowForce, LiftedFlowForce), Law(library.ValveFlowForce, RecoveringFlowForce),
    Law(library.ValveAdhesion, SqueezeFilm), Law(library.ValveAdhesion, AttractedBall),
    Law(library.SuctionSeatLeakage, SeatedSuctionLeak), Law(library.SuctionSeatLeakage, ClosingSuctionSeat),
    Law(library.DeliverySeatLeakage, SeatedDeliveryLeak), Law(library.DeliverySeatLeakage, ClosingDeliverySeat),
    Law(library.SuctionLineResistance, CollapsingSuctionHose), Law(library.SuctionLineResistance, SuctionStrainer),
    Law(library.SuctionLineInertance, UnsteadySuctionInertance),
    Law(library.SuctionLineInertance, BlasiusSuctionInertance),
)  # fmt: skip
