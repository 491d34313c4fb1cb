"""Cogging force: periodic in the position of the mover."""

import math

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect


class CoggingForce(Effect):
    """Attraction of the mover to the positions of teeth or magnet edges.

    F = −A sin(2π x/τ + φ)

    Source: measured on linear motors, −7.7 … +16 N, Complexity 2018, 9647257, Table 3; near zero in an ideal coil.
    """

    looks_like = "ripple of the current tied to the position, the same in both directions, at any speed and load"
    confused_with = ("stroke_dependent_friction", "parasitic_spring", "reluctance_force", "force_constant_droop")

    cogging_amplitude: float = par(1.0, "N", (0.0, 1e4), "amplitude A", plausible=(0.2, 5.0))
    cogging_pitch: float = par(6e-3, "m", (1e-5, 1.0), "pitch τ", plausible=(2e-3, 20e-3))
    cogging_phase: float = par(
        0.0, "rad", (-2.0 * math.pi, 2.0 * math.pi), "phase at mid-stroke φ", plausible=(-math.pi, math.pi)
    )

    def mover_force(self, s, z):
        angle = 2.0 * jnp.pi * s.piston_position / self.cogging_pitch + self.cogging_phase
        return -self.cogging_amplitude * jnp.sin(angle)
