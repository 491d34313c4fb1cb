"""Adaptive non-singular terminal sliding-mode controller with a disturbance observer."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.interface.controller_base import Controller
from edhas_jax.machine.interface.signals import Signals

SURFACE_LENGTH = 1e-3  # m, error ℓ at which `surface_rate` is the rate of the sliding motion


class AdaptiveSlidingMode(Controller):
    """Adaptive non-singular terminal sliding mode with disturbance observer and tracking differentiator (ANTSMC).

    Tracking differentiator, which turns the set point r into a smooth one r̂ with acceleration ≤ r₀:
        dr̂/dt = v̂,   dv̂/dt = a = fhan(r̂ − r, v̂ − ṙ, r₀, h₀)
    Sliding surface of e = x − r̂, with terminal motion ė = −β ℓ |e/ℓ|^(1/γ) sgn e, ℓ = 1 mm, 1 < γ < 2:
        s = e + ℓ |ė/(β ℓ)|^γ sgn ė
    Force, with the disturbance estimate d̂ and a switching gain κ̂ adapted to the remaining error:
        F = M (a − (β ℓ)^γ/(γ ℓ) |ė|^(2−γ) sgn ė − k s − κ̂ sat(s/φ)) + c v + d̂,   dκ̂/dt = a₊ |s| − a₋ κ̂
    (without a₊ |s| while the supply limits the voltage)
    Disturbance observer of second order with both poles at −l, for M dv/dt = Km i − c v − d:
        d̂ = z − 2 l M v,   dz/dt = 2 l (Km i − c v − d̂) + ŵ,   ŵ = w − l² M v,   dw/dt = l² (Km i − c v − d̂)
    Voltage by a current loop with the time constant τ:
        u = R i* + Km v + L (i* − i)/τ,   i* = F/Km

    M, c, Km, R, L are nominal values of the controller, not those of the machine. sat is smooth, sat(a) = a/√(1 + a²).
    A power |ė|^p sgn ė is computed as ė (ė² + v₀²)^((p − 1)/2), whose slope is finite at standstill.

    Source: fhan: Han, IEEE Trans. Ind. Electron. 56(3), 2009; surface: Feng, Yu, Man, Automatica 38(12), 2002;
    observer: Kim, Rew, Kim, IEEE Trans. Autom. Control 55(8), 2010; structure: Micromachines 2022, 13(8), 1294.
    """

    tracking_acceleration: float = par(2e3, "m/s^2", (1.0, 1e6), "largest acceleration of the smooth set point r₀")
    tracking_time: float = par(2e-4, "s", (1e-5, 1.0), "filter time of the tracking differentiator h₀")
    surface_rate: float = par(300.0, "1/s", (1.0, 1e5), "rate of the sliding motion at an error of 1 mm β")
    surface_exponent: float = par(1.4, "-", (1.01, 1.99), "exponent of the sliding surface γ")
    smoothing_velocity: float = par(0.02, "m/s", (1e-5, 10.0), "speed below which powers of the speed are smooth v₀")
    reaching_gain: float = par(4e5, "1/s^2", (0.0, 1e9), "gain of the linear reaching law k")
    boundary_layer: float = par(50e-6, "m", (1e-8, 1e-1), "boundary layer of switching φ")
    adaptation_gain: float = par(1e7, "1/s^3", (0.0, 1e12), "growth rate of the switching gain a₊")
    adaptation_leak: float = par(20.0, "1/s", (0.0, 1e5), "decay of the switching gain a₋")
    observer_rate: float = par(1000.0, "1/s", (1.0, 1e5), "poles of the disturbance observer l")
    current_time: float = par(3e-4, "s", (1e-6, 1.0), "time constant of the current loop τ")
    nominal_mass: float = par(0.2, "kg", (1e-3, 1e3), "nominal mass of the controller M")
    nominal_damping: float = par(25.0, "N*s/m", (0.0, 1e5), "nominal damping of the controller c")
    nominal_force_constant: float = par(24.61, "N/A", (1e-3, 1e4), "nominal force constant of the controller Km")
    nominal_resistance: float = par(1.41, "ohm", (1e-3, 1e4), "nominal resistance of the controller R")
    nominal_inductance: float = par(1.1e-3, "H", (0.0, 10.0), "nominal inductance of the controller L")

    def initial(self) -> dict:
        """Smooth set point [m] and its rate [m/s], switching gain [m/s²], z [N] and w [N/s] of the observer."""
        names = ("smooth_reference", "smooth_velocity", "switching_gain", "observed_force", "observed_force_rate")
        return dict.fromkeys(names, 0.0)

    def command(self, y: dict, s: Signals):
        """The command u [V] before the supply limit."""
        v, gamma = s.piston_velocity, self.surface_exponent
        speed = v - y["smooth_velocity"]
        surface = self._surface(y, s)
        scale = (self.surface_rate * SURFACE_LENGTH) ** gamma / (gamma * SURFACE_LENGTH)
        terminal = scale * self._power(speed, 2.0 - gamma)
        reaching = self.reaching_gain * surface + y["switching_gain"] * _saturated(surface / self.boundary_layer)
        force = self.nominal_mass * (self._acceleration(y, s) - terminal - reaching)
        force = force + self.nominal_damping * v + self._disturbance(y, v)
        current = force / self.nominal_force_constant
        inductive_voltage = self.nominal_inductance / self.current_time * (current - s.current)
        return self.nominal_resistance * current + self.nominal_force_constant * v + inductive_voltage

    def rates(self, y: dict, s: Signals) -> dict:
        """Rates of the tracking differentiator, of the switching gain and of the observer."""
        v, l = s.piston_velocity, self.observer_rate  # noqa: E741
        nominal_force = self.nominal_force_constant * s.current - self.nominal_damping * v
        observer_error = nominal_force - self._disturbance(y, v)
        disturbance_rate = y["observed_force_rate"] - l * l * self.nominal_mass * v
        # at the supply limit a larger gain has no effect: the switching gain would wind up
        unlimited = s.voltage == s.unlimited_voltage
        growth = jnp.where(unlimited, self.adaptation_gain * jnp.abs(self._surface(y, s)), 0.0)
        return {
            "smooth_reference": y["smooth_velocity"],
            "smooth_velocity": self._acceleration(y, s),
            "switching_gain": growth - self.adaptation_leak * y["switching_gain"],
            "observed_force": 2.0 * l * observer_error + disturbance_rate,
            "observed_force_rate": l * l * observer_error,
        }

    def _power(self, speed, exponent):
        """|ė|^p sgn ė, smooth at standstill."""
        return speed * (jnp.square(speed) + jnp.square(self.smoothing_velocity)) ** (0.5 * (exponent - 1.0))

    def _surface(self, y: dict, s: Signals):
        """The sliding surface s [m]."""
        speed = s.piston_velocity - y["smooth_velocity"]
        scale = SURFACE_LENGTH / (self.surface_rate * SURFACE_LENGTH) ** self.surface_exponent
        return s.piston_position - y["smooth_reference"] + scale * self._power(speed, self.surface_exponent)

    def _acceleration(self, y: dict, s: Signals):
        """fhan [m/s²]: time-optimal acceleration towards the set point, linear close to it."""
        offset, speed = y["smooth_reference"] - s.reference, y["smooth_velocity"] - s.reference_velocity
        h, limit = self.tracking_time, self.tracking_acceleration
        d = limit * h * h
        predicted = offset + h * speed
        parabolic = 0.5 * (jnp.sqrt(d * (d + 8.0 * jnp.abs(predicted))) - d)
        nonlinear = jnp.where(predicted < 0.0, -parabolic, parabolic)
        switching = h * speed + jnp.where(jnp.abs(predicted) < d, predicted, nonlinear)
        return -limit * jnp.clip(switching / d, -1.0, 1.0)

    def _disturbance(self, y: dict, v):
        """The disturbance estimate d̂ [N]."""
        return y["observed_force"] - 2.0 * self.observer_rate * self.nominal_mass * v


def _saturated(a):
    """sat(a) = a/√(1 + a²)."""
    return a / jnp.sqrt(1.0 + jnp.square(a))
