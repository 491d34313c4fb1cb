"""Oil that holds the ball of a check valve to its seat."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect

FILM = 20e-6  # m, the lift within which the film of oil holds
RISE = 1e-3  # m/s, the speed above which it does


class ValveAdhesion(Effect):
    """The film of oil in the seat resists the opening of the valve.

    F = −F_ad exp(−(max(y, 0)/20 µm)²) (1 + tanh(ẏ / 1 mm/s))/2

    Source: studies of oil stiction in seat valves for the phenomenon; the formula is chosen.
    """

    looks_like = "chamber pressure beyond that of the outlet, or below suction, before each opening, at any frequency"
    confused_with = ("valve_preload", "air_fraction", "backlash", "valve_damping")

    adhesion_force: float = par(1.0, "N", (0.0, 1e4), "largest force F_ad", plausible=(0.1, 5.0))

    def check_valve_force(self, s, z):
        near = jnp.exp(-jnp.square(jnp.maximum(s.lift, 0.0) / FILM))
        return -self.adhesion_force * near * 0.5 * (1.0 + jnp.tanh(s.lift_velocity / RISE))
