"""Line between accumulator and suction valves: its resistance, and its inertance."""

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect, state


class SuctionLineResistance(Effect):
    """A laminar resistance (narrow line, filter, cold oil) before a manifold of 10 mL.

    Q_l = (p_s − p_m)/R,   10 mL/β(p_m) dp_m/dt = Q_l − Q_sA − Q_sB; leakage still drains to p_s

    Source: Hagen-Poiseuille, R = 128 μ l/(π d⁴); 3.8e8 Pa·s/m³ for 0.3 m of 6 mm at 46 mm²/s.
    """

    looks_like = "chambers that do not fill: late and sudden rise of pressure, flow that falls above some frequency"
    confused_with = ("suction_line_inertance", "accumulator_pressure", "valve_preload", "valve_damping")

    line_resistance: float = par(3e8, "Pa*s/m^3", (1e3, 1e13), "resistance R", plausible=(1e7, 3e9))

    def suction_line_resistance(self, s, z):
        return self.line_resistance


class SuctionLineInertance(Effect):
    """Inertia of the oil in the line to the manifold of 10 mL; the flow is a state.

    I dQ_l/dt = p_s − p_m − R Q_l,   10 mL/β(p_m) dp_m/dt = Q_l − Q_sA − Q_sB

    Source: I = ρ l/A; 9.2e6 kg/m⁴ for 0.3 m of 6 mm.
    """

    looks_like = "suction pressure that swings with the square of frequency: ram filling first, then a collapse of flow"
    confused_with = ("suction_line_resistance", "mover_mass", "accumulator_pressure")

    line_inertance: float = par(1e7, "kg/m^4", (1e3, 1e12), "inertance I", plausible=(1e6, 5e7))
    line_resistance: float = par(1e7, "Pa*s/m^3", (0.0, 1e13), "resistance R")

    flow = state("m^3/s", "flow through the line")

    def suction_line_resistance(self, s, z):
        return self.line_resistance

    def suction_line_flow(self, s, z):
        return z.flow

    def rates(self, s, z):
        drop = s.accumulator_pressure - s.suction_pressure - s.suction_line_resistance * z.flow
        return {"flow": drop / self.line_inertance}
