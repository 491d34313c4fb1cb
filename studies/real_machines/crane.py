"""A hydraulic actuator that moves the arm of a crane: valve, oil as a spring, a mass; all quantities scaled."""

import jax.numpy as jnp

from edhas_jax import Effect, Rig, drive, par, signal, slot, state


class Crane(Rig):
    """The valve passes oil in proportion to its opening; the oil is a spring between it and a mass with viscous drag.

    Source: Sjöberg et al., Nonlinear black-box modeling in system identification, Automatica 31 (1995), which uses the
    record.
    """

    time_step, duration = 0.01, 50.0  # s

    opening = drive("-", "opening of the valve", 0.0)

    flow_gain: float = par(0.5, "1/s", (0.01, 10.0), "steady speed of the arm per opening")
    stiffness: float = par(10.0, "-", (0.1, 1000.0), "pressure per travel of the arm that the oil prevents")
    acceleration: float = par(2.7, "1/s^2", (0.01, 100.0), "acceleration per pressure")
    drag: float = par(3.5, "s", (0.0, 100.0), "pressure per steady speed")
    leak: float = par(0.01, "1/s", (1e-5, 1.0), "speed lost per pressure, past the piston")

    travel = state("-", "travel of the arm")
    speed = state("1/s", "speed of the arm")
    pressure = state("-", "pressure of the oil")
    flow = signal("1/s", "flow of the valve, as speed of the arm")

    valve_flow = slot("valve", "1/s", "flow beyond that in proportion to the opening", "opening", 0.1)
    friction = slot("arm", "-", "pressure lost to friction", ("speed", "travel"), 0.3)
    leakage = slot("piston", "1/s", "speed lost past the piston", "pressure", 0.05)

    def equations(self, y, s):
        """The rates of travel, speed and pressure; sets the flow."""
        s.set(flow=-self.flow_gain * s.opening + self.valve_flow.apply(0.0, s))
        push = y.pressure - self.friction.apply(self.drag * y.speed, s)
        lost = self.leakage.apply(self.leak * y.pressure, s)
        return {
            "travel": y.speed,
            "speed": self.acceleration * push,
            "pressure": self.stiffness * (s.flow - lost - y.speed),
        }


class TwoSidedValve(Effect, rig=Crane):
    """Both directions of the valve have a gain of their own, and the opening saturates.

    Source: the curve that `edhas diagnose` finds is steeper on one side and flattens at both ends.
    """

    ratio: float = par(2.0, "-", (0.1, 10.0), "gain of positive openings over that of negative ones",
                       plausible=(0.3, 5.0))  # fmt: skip
    limit: float = par(0.8, "-", (0.1, 5.0), "opening at which the flow saturates", plausible=(0.2, 3.0))

    def valve_flow(self, s, z):
        """The flow beyond that in proportion to the opening [1/s]."""
        u = self.limit * jnp.tanh(s.opening / self.limit)
        return s.flow_gain * (s.opening - jnp.where(u > 0.0, self.ratio * u, u))
