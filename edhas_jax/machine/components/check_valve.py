"""The ball check valve."""

import jax.numpy as jnp

from edhas_jax.core.structs import par, struct
from edhas_jax.machine.interface.signals import Signals
from edhas_jax.machine.interface.slots import CHECK_VALVE_FORCE, apply_slot


@struct
class CheckValve:
    """A spring-loaded ball on a conical seat, with inertia, seat contact and lift stop; the pump has four of them.

    A(y) = π d_seat max(y, 0) sin θ
    m_v ÿ = (π d_seat²/4) Δp − F_0 − k_v y − c_v ẏ + contact
    contact: k_c (−y)(1 − d_c ẏ) at y < 0, −k_c (y − y_max)(1 + d_c ẏ) at y > y_max, never adhesive

    Source: Shu, Burrows, Edge, Proc. IMechE I 211 (1997), for the structure; contact after Hunt and Crossley 1975.
    """

    valve_mass: float = par(4.0e-3, "kg", (1e-6, 10.0), "mass of ball and moving oil m_v")
    valve_seat_diameter: float = par(5.2e-3, "m", (1e-4, 0.2), "diameter of the seat d_seat")
    valve_spring_rate: float = par(150.0, "N/m", (0.0, 1e6), "spring rate k_v")
    valve_preload: float = par(0.28, "N", (0.0, 1e4), "spring force at zero lift F_0")
    valve_damping: float = par(1.4, "N*s/m", (0.0, 1e4), "damping c_v")
    valve_max_lift: float = par(3.0e-3, "m", (1e-5, 0.1), "lift at the stop y_max")
    valve_seat_angle: float = par(jnp.pi / 4, "rad", (0.05, 1.5707), "half angle of the seat θ")
    valve_contact_stiffness: float = par(5e5, "N/m", (1.0, 1e9), "stiffness of seat and lift stop k_c")
    valve_contact_damping: float = par(5.0, "s/m", (0.0, 1e4), "damping of seat and lift stop d_c")

    def area(self, lift):
        """The area A(y) [m²] between ball and seat."""
        return jnp.pi * self.valve_seat_diameter * jnp.sin(self.valve_seat_angle) * jnp.maximum(lift, 0.0)

    def acceleration(self, ball: Signals):
        """The acceleration ÿ [m/s²] of a ball.

        Args:
            ball: signals with the local ones `lift` [m], `lift_velocity` [m/s] and `pressure_drop` [Pa], positive in
                flow direction.
        """
        k, d = self.valve_contact_stiffness, self.valve_contact_damping
        lift, velocity = ball.lift, ball.lift_velocity
        seat_depth, stop_depth = jnp.maximum(-lift, 0.0), jnp.maximum(lift - self.valve_max_lift, 0.0)
        seat = k * seat_depth * jnp.maximum(1.0 - d * velocity, 0.0)
        stop = k * stop_depth * jnp.maximum(1.0 + d * velocity, 0.0)
        force = (
            0.25 * jnp.pi * jnp.square(self.valve_seat_diameter) * ball.pressure_drop
            - self.valve_preload
            - self.valve_spring_rate * lift
            - self.valve_damping * velocity
            + seat
            - stop
        )
        return apply_slot(CHECK_VALVE_FORCE, force, ball) / self.valve_mass
