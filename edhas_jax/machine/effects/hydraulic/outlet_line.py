"""Line between outlet node and load orifice: its inertance, and its resistance."""

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect, state


class OutletLineInertance(Effect):
    """Inertia of the oil in the line to the load; the flow is a state.

    I dQ/dt = p_d − p_s − R Q − Δp_load(Q),   Δp_load the pressure drop of the load orifice at Q

    Source: I = ρ l/A of a line.
    """

    looks_like = (
        "outlet flow smoother and later than the outlet pressure implies; pressure ripple that grows with frequency"
    )
    confused_with = ("hose_compliance", "sensor_lag", "outlet_volume")

    line_inertance: float = par(1e7, "kg/m^4", (1e3, 1e12), "inertance I", plausible=(1e6, 5e7))
    line_resistance: float = par(0.0, "Pa*s/m^3", (0.0, 1e15), "resistance R")

    flow = state("m^3/s", "flow through the line")

    def outlet_line_resistance(self, s, z):
        return self.line_resistance

    def outlet_line_flow(self, s, z):
        return z.flow

    def rates(self, s, z):
        drop = s.outlet_pressure - s.accumulator_pressure - s.outlet_line_resistance * z.flow - s.load_drop
        return {"flow": drop / self.line_inertance}


class OutletLineResistance(Effect):
    """A line or filter with laminar flow in series with the load orifice: a further drop R Q.

    Source: Hagen-Poiseuille, R = 128 μ l/(π d⁴).
    """

    looks_like = "outlet pressure higher in proportion to the flow, where an orifice would make it grow with the square"
    confused_with = ("load_orifice_area", "discharge_coefficient", "outlet_line_inertance")

    line_resistance: float = par(1e9, "Pa*s/m^3", (0.0, 1e15), "resistance R", plausible=(1e8, 1e10))

    def outlet_line_resistance(self, s, z):
        return self.line_resistance
