"""Flow force on the ball of a check valve."""

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect


class ValveFlowForce(Effect):
    """The momentum of the jet closes the valve.

    F = −K A(y) Δp,   K = 2 Cd² cos(jet angle) in theory

    Source: flow forces on poppets after Rundo and Altare; Shu, Burrows, Edge, Proc. IMechE I 211 (1997).
    """

    looks_like = "valves that open less and close earlier; more pressure drop at large flow"
    confused_with = ("valve_spring_rate", "valve_damping", "discharge_coefficient", "valve_preload")

    flow_force_coefficient: float = par(0.5, "-", (0.0, 10.0), "force over A Δp, K", plausible=(0.1, 1.5))

    def check_valve_force(self, s, z):
        return -self.flow_force_coefficient * s.valve_area * s.pressure_drop
