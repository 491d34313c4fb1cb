"""The mover of the linear actuator and its end stops."""

import jax.numpy as jnp

from edhas_jax.core.structs import par, struct
from edhas_jax.machine.components import PAPER


@struct
class Mover:
    """Coil carrier: a mass with viscous damping."""

    mover_mass: float = par(0.12, "kg", (1e-4, 1e4), "moving mass of the actuator M", PAPER)
    mover_damping: float = par(20.0, "N*s/m", (0.0, 1e5), "viscous damping of the actuator c", PAPER)


@struct
class EndStops:
    """Elastic stops with damping, never adhesive: F = max(0, k δ (1 + d δ̇)), δ the penetration.

    Source: Hunt and Crossley, J. Appl. Mech. 42 (1975) 440.
    """

    pump_stroke: float = par(10e-3, "m", (1e-5, 10.0), "free travel between the stops", PAPER)
    stop_stiffness: float = par(2e6, "N/m", (0.0, 1e10), "stiffness of an end stop k_stop")
    stop_damping: float = par(2.0, "s/m", (0.0, 1e4), "damping of an end stop d_stop")

    def force(self, x, v, low, high):
        """The force [N] of stops at `low` and `high` [m] at position `x` [m] and velocity `v` [m/s]."""
        return self._contact_force(x - high, v) - self._contact_force(low - x, -v)

    def _contact_force(self, depth, speed):
        """Force [N] of one stop at a penetration [m] that grows at `speed` [m/s]."""
        return jnp.maximum(0.0, self.stop_stiffness * jnp.maximum(depth, 0.0) * (1.0 + self.stop_damping * speed))
