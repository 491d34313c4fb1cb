"""Laws of the suction line, for judging."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect, state
from studies.hidden_effects.generators.functions import suction_line_drop
from studies.hidden_effects.generators.laws import Law


class SuckedInHose(Effect):
    """A suction hose that collapses as its pressure falls: R (1 + u/40 kPa), du/dt = (p_s − p_m − u)/3 ms.

    Source: limited flow through collapsible tubes; Shapiro, J. Biomech. Eng. 99 (1977) 126; the form is chosen.
    """

    round_resistance: float = par(2e8, "Pa*s/m^3", (1e3, 1e13), "R", plausible=(1e7, 1e9))

    suction_drop = state("Pa", "pressure drop that the wall has followed")

    def suction_line_resistance(self, s, z):
        return self.round_resistance * (1.0 + jnp.maximum(z.suction_drop, 0.0) / 40e3)

    def rates(self, s, z):
        return {"suction_drop": (s.accumulator_pressure - s.suction_pressure - z.suction_drop) / 3e-3}


class ColdSuctionLine(Effect):
    """A suction line filled with cold oil, which warm oil displaces: R (0.3 + 0.7 exp(−V/4 mL)), dV/dt = Q.

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
    """A suction line with a momentum factor that depends on the flow.

    I (1 + 1/(3 (1 + (Q/0.9 L/min)²))) dQ/dt = Δp − R Q

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
        drop = suction_line_drop(s, z.drawn_flow)
        profile = 1.0 + 1.0 / (3.0 * (1.0 + jnp.square(z.drawn_flow / 1.5e-5)))
        return {"drawn_flow": drop / (self.flat_inertance * profile)}


class CoiledSuctionInertance(Effect):
    """A coiled suction line with inertance and secondary flow: I dQ/dt = Δp − R Q (1 + (Q/0.24 L/min)²)^(1/4).

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
        drop = suction_line_drop(s, z.drawn_flow)
        return {"drawn_flow": drop / self.coil_inertance}


LAWS = tuple(
    Law(mechanism, kind)
    for mechanism, kinds in (
        (library.SuctionLineResistance, (SuckedInHose, ColdSuctionLine, FootValveLine)),
        (library.SuctionLineInertance, (ProfiledSuctionInertance, CoiledSuctionInertance)),
    )
    for kind in kinds
)
