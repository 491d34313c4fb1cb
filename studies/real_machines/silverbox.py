"""Silverbox: an electronic circuit that behaves like a mass on a spring whose stiffness grows with the position."""

import jax.numpy as jnp

from edhas_jax import Effect, Rig, drive, par, signal, slot, state


class Oscillator(Rig):
    """A mass on a linear spring with a linear damper; force and position in volts.

    Source: Wigren, Schoukens, Three free data sets for development and benchmarking in nonlinear system identification,
    2013.
    """

    time_step, duration = 4e-4, 5.0  # s

    force = drive("V", "voltage that stands for the force", 0.0)

    natural_frequency: float = par(69.0, "Hz", (10.0, 300.0), "natural frequency without damping")
    damping_ratio: float = par(0.05, "-", (1e-4, 1.0), "damping ratio")
    gain: float = par(1.0, "-", (0.1, 10.0), "position over force at rest")
    zero: float = par(0.0, "V", (-0.1, 0.1), "reading of the position sensor at rest")

    position = state("V", "position")
    velocity = state("V/s", "velocity")
    reading = signal("V", "position as the recorder sees it")

    spring = slot("spring", "V/s^2", "what pulls beyond the linear spring", "position", 500.0)
    damper = slot("damper", "V/s^2", "what brakes beyond the linear damper", "velocity", 500.0)

    def equations(self, y, s):
        """The rates of position and velocity; sets the reading."""
        w = 2.0 * jnp.pi * self.natural_frequency
        s.set(reading=y.position + self.zero)
        pull = w**2 * (self.gain * s.force - y.position) - 2.0 * self.damping_ratio * w * y.velocity
        return {"position": y.velocity, "velocity": pull - self.spring.apply(0.0, s) - self.damper.apply(0.0, s)}


class CubicSpring(Effect, rig=Oscillator):
    """A spring that hardens: a force with the cube of the position.

    Source: the curve that `edhas diagnose` finds is odd and grows faster than the position.
    """

    hardening: float = par(4e5, "1/(s^2*V^2)", (1e2, 1e9), "force over mass and position³", plausible=(1e4, 1e8))

    def spring(self, s, z):
        """The additional force over the mass [V/s²]."""
        return self.hardening * s.position**3
