"""Adhesion of the check valve ball to its seat by the oil film."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect

FILM_HEIGHT = 20e-6  # m, lift within which the film acts
OPENING_SPEED = 1e-3  # m/s, lift velocity above which it acts fully


class ValveAdhesion(Effect):
    """The oil film in the seat resists the opening of the valve.

    F = −F_ad exp(−(max(y, 0)/20 µm)²) (1 + tanh(ẏ / 1 mm/s))/2

    Source: studies of oil stiction in seat valves for the phenomenon; the formula is chosen.
    """

    looks_like = "chamber pressure beyond that of the outlet, or below suction, before each opening, at any frequency"
    confused_with = ("valve_preload", "air_fraction", "backlash", "valve_damping")

    adhesion_force: float = par(1.0, "N", (0.0, 1e4), "largest force F_ad", plausible=(0.1, 5.0))

    def check_valve_force(self, s, z):
        film = jnp.exp(-jnp.square(jnp.maximum(s.lift, 0.0) / FILM_HEIGHT))
        return -self.adhesion_force * film * 0.5 * (1.0 + jnp.tanh(s.lift_velocity / OPENING_SPEED))
