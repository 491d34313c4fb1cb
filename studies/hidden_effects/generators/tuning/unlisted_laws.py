"""Laws of mechanisms that the library does not have, for tuning."""

import math

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects import Effect, state
from studies.hidden_effects.generators.laws import Law


class CrossLeakage(Effect):
    """Leakage between the two chambers, past the seal of a common plunger: Q = k (p_A − p_B).

    Source: laminar gap flow.
    """

    confused_with = ("piston_leakage", "suction_seat_leakage", "delivery_seat_leakage")

    cross_conductance: float = par(1e-13, "m^3/(s*Pa)", (0.0, 1e-6), "k", plausible=(5e-15, 2e-12))

    def chamber_leakage(self, s, z):
        return self.cross_conductance * (2.0 * s.chamber_pressure - s.chamber_pressure_a - s.chamber_pressure_b)


class ForceRipple(Effect):
    """A force constant that is periodic in the position: Km (1 + ε sin(2π x/τ + φ)).

    Source: harmonics of the field of a magnet array; Gieras, Piech, Tomczuk, Linear Synchronous Motors (2011).
    """

    confused_with = ("force_constant_droop", "cogging_force")

    ripple_share: float = par(0.02, "-", (-1.0, 1.0), "ε", plausible=(0.005, 0.15))
    ripple_length: float = par(4e-3, "m", (1e-5, 1.0), "τ", plausible=(2e-3, 4e-3))
    ripple_shift: float = par(0.0, "rad", (-7.0, 7.0), "φ", plausible=(-math.pi, math.pi))

    def force_constant_factor(self, s, z):
        return 1.0 + self.ripple_share * jnp.sin(
            2.0 * jnp.pi * s.piston_position / self.ripple_length + self.ripple_shift
        )


class BallFriction(Effect):
    """Dry friction of the balls in their guides: −F tanh(ẏ/10 mm/s).

    Source: Coulomb.
    """

    confused_with = ("valve_adhesion", "valve_flow_force")

    ball_friction: float = par(0.05, "N", (0.0, 1e4), "F", plausible=(0.005, 0.5))

    def check_valve_force(self, s, z):
        return -self.ball_friction * jnp.tanh(s.lift_velocity / 0.01)


class EddyPathCoil(Effect):
    """Eddy currents in the iron beside the coil, a resistance that is shorted at low frequency: −R_e (i − i_s).

    di_s/dt = (i − i_s)/τ, τ = 0.8 ms

    Source: semi-inductance of voice coils; Vanderkooy, J. Audio Eng. Soc. 37 (1989) 119, with one time constant.
    """

    confused_with = ("amplifier_lag", "inverter_dead_time", "reluctance_force")

    iron_resistance: float = par(0.5, "ohm", (0.0, 1e3), "R_e", plausible=(0.02, 3.0))

    slow_current = state("A", "current that the iron follows")

    def coil_voltage_change(self, s, z):
        return -self.iron_resistance * (s.current - z.slow_current)

    def rates(self, s, z):
        return {"slow_current": (s.current - z.slow_current) / 0.8e-3}


class TunedMass(Effect):
    """A mass on a spring that the motor force excites, as of a housing: F = 0.12 kg s (ω² x + 0.2 ω v), ω = 2π f.

    ẍ = −F_e/0.2 kg − ω² x − 0.2 ω v

    Source: Den Hartog, Mechanical Vibrations (1934).
    """

    confused_with = ("coupling_compliance", "backlash", "parasitic_spring")

    mass_share: float = par(0.05, "-", (0.0, 1.0), "s", plausible=(0.01, 0.5))
    tuned_frequency: float = par(90.0, "Hz", (1.0, 1e4), "f", plausible=(50.0, 150.0))

    displacement = state("m", "of the mass")
    speed = state("m/s", "its rate")

    def _force(self, s, z):
        omega = 2.0 * jnp.pi * self.tuned_frequency
        return omega * omega * z.displacement + 0.2 * omega * z.speed

    def mover_force(self, s, z):
        return 0.12 * self.mass_share * self._force(s, z)

    def rates(self, s, z):
        return {"displacement": z.speed, "speed": -s.motor_force / 0.2 - self._force(s, z)}


LAWS = tuple(Law(None, kind) for kind in (CrossLeakage, ForceRipple, BallFriction, EddyPathCoil, TunedMass))
