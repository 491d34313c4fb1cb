"""Karnopp friction of the cylinder."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect


class KarnoppFriction(Effect):
    """Dry friction of the cylinder with a true standstill.

    |v_c| > v_min: F = F_d sgn(v_c). Within the band, with F_rem the sum of all other forces: if |F_rem| ≤ F_m the
    cylinder stands (v_c is set to 0 and stays 0), otherwise F = F_m sgn(F_rem). In the step that stops the cylinder
    the friction force is F_rem + M v_c/h, so that the energy balance contains the kinetic energy taken out.

    Source: Karnopp, J. Dyn. Sys. Meas. Control 107 (1985) 100; Actuators 2022, 11(10), 281, Eq. (12), with min for
    the max printed there.
    """

    looks_like = "a late start and a dead stop of the cylinder, a step of the head pressure between the two"
    confused_with = ("cylinder_seal_friction", "load_force", "cylinder_damping")

    cylinder_sliding_friction: float = par(10.0, "N", (0.0, 1e5), "friction while sliding, F_d", plausible=(3.0, 60.0))
    cylinder_breakaway_friction: float = par(
        15.0, "N", (0.0, 1e5), "friction at break-away, F_m", plausible=(3.0, 150.0),
        at_least="cylinder_sliding_friction",
    )  # fmt: skip
    karnopp_velocity: float = par(1e-3, "m/s", (1e-6, 0.1), "half-width of the standstill band, v_min")

    def cylinder_friction_force(self, s, z):
        """Friction force [N] by Eq. (12), positive when it opposes v_c > 0."""
        v, other_forces = s.cylinder_velocity, s.cylinder_free_force
        sliding = self.cylinder_sliding_friction + s.cylinder_friction_level
        breakaway = self.cylinder_breakaway_friction + s.cylinder_friction_level
        stopping = other_forces + s.load_mass * s.cylinder_velocity_at_step_start / s.time_step
        standing = jnp.where(jnp.abs(other_forces) <= breakaway, stopping, breakaway * jnp.sign(other_forces))
        return jnp.where(jnp.abs(v) > self.karnopp_velocity, sliding * jnp.sign(v), standing)
