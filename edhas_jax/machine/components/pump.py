"""The opposed plungers and their chambers."""

import jax.numpy as jnp

from edhas_jax.core.structs import par, struct
from edhas_jax.machine.components import PAPER


@struct
class Pump:
    """Two plungers on one rod: S_p = π d_p²/4, V_A = V_dead + S_p (stroke/2 − x), V_B with −x."""

    piston_diameter: float = par(12e-3, "m", (1e-4, 1.0), "diameter of the plungers d_p", PAPER)
    pump_dead_volume: float = par(10e-9, "m^3", (1e-12, 1e-2), "volume of a chamber at full travel V_dead", PAPER)
    plunger_mass: float = par(0.08, "kg", (0.0, 1e3), "mass of the plungers m_add")
    pump_damping: float = par(5.0, "N*s/m", (0.0, 1e5), "viscous damping of the plungers c_p")

    def area(self):
        """The area of a plunger S_p [m²]."""
        return 0.25 * jnp.pi * jnp.square(self.piston_diameter)

    def volume(self, travel_left):
        """The volume [m³] of a chamber whose plunger is `travel_left` [m] from its end stop; at least V_dead/10.

        End stops are elastic; the lower limit keeps the volume positive when a plunger penetrates one.
        """
        return jnp.maximum(self.pump_dead_volume + self.area() * travel_left, 0.1 * self.pump_dead_volume)
