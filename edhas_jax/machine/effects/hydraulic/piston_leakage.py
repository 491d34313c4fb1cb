"""Leakage past an inclined, eccentric plunger."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect


class PistonLeakage(Effect):
    """Laminar flow through the gap of an inclined plunger: pressure flow, and shear flow due to its motion.

    Q_L = π d δ³ (p − p_s) / (8.68 μ L_fit) − (π d δ / 2) v_p,   v_p the plunger's speed into the chamber

    Assumed: the plunger is tilted about its middle until it touches the bore at both ends. At a distance x from the
    middle the gap is then eccentric by ε = 2 x/L_fit of its width, Eq. (6) and Eq. (7), and passes 1 + 1.5 ε² times
    the flow of a concentric one. The pressure drop integrated over the length, Eq. (8), has the factor
    12 atan(√1.5)/√1.5 = 8.68, which a concentric gap has as 12. Valid for Re < 1000.

    Source: Actuators 2022, 11(10), 281, Eq. (9), with the sign of the shear term such that it follows the plunger.
    """

    looks_like = "mean flow lower by an amount that grows with pressure and not with frequency"
    confused_with = ("suction_seat_leakage", "delivery_seat_leakage", "oil_viscosity")

    piston_clearance: float = par(
        20e-6, "m", (0.0, 1e-3), "radial gap between plunger and bore, δ", plausible=(5e-6, 40e-6)
    )
    piston_fit_length: float = par(20e-3, "m", (1e-4, 1.0), "length of the gap, L_fit", plausible=(5e-3, 50e-3))

    def chamber_leakage(self, s, z):
        """Leakage out of one chamber [m³/s] by Eq. (9)."""
        gap_area = jnp.pi * s.piston_diameter * self.piston_clearance
        conductance = gap_area * jnp.square(self.piston_clearance) / (8.68 * s.viscosity * self.piston_fit_length)
        return conductance * (s.chamber_pressure - s.accumulator_pressure) - 0.5 * gap_area * s.plunger_velocity
