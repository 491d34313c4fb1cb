"""The controllers of the piston, and the coordination of pump and reversing valve."""

import jax.numpy as jnp

from edhas_jax.core.structs import par, struct
from edhas_jax.machine.interface.controller_base import Controller
from edhas_jax.machine.interface.signals import Signals
from edhas_jax.machine.interface.slots import SUPPLY_VOLTAGE, apply_slot


def clip_to_supply(command, s: Signals):
    """The command limited to the supply voltage [V], which effects may change."""
    limit = apply_slot(SUPPLY_VOLTAGE, s.supply_voltage, s)
    return jnp.clip(command, -limit, limit)


@struct
class Supply:
    """The DC supply, which limits the command of any controller."""

    supply_voltage: float = par(48.0, "V", (1e-2, 1e4), "limit of the command U_max", "Actuators 2022, 11(10), 281")


class PositionController(Controller):
    """PID with back-EMF feedforward and back-calculation anti-windup.

    u_c = Kp (r − x) + Ki ξ + Kd (ṙ − v) + k_ff Km ṙ,   u = clip(u_c, ±U_max),   ξ̇ = (r − x) + Kaw (u − u_c)/Kp

    Km in the feedforward is the parameter `force_constant`; effects on the motor do not change it.
    """

    position_gain: float = par(1.5e4, "V/m", (1e-3, 1e8), "proportional gain Kp")
    integral_gain: float = par(2e4, "V/(m*s)", (0.0, 1e9), "integral gain Ki")
    velocity_gain: float = par(40.0, "V*s/m", (0.0, 1e6), "velocity gain Kd")
    antiwindup_gain: float = par(0.01, "-", (0.0, 1e3), "anti-windup gain Kaw")
    emf_feedforward: float = par(0.96, "-", (0.0, 10.0), "share of the back-EMF fed forward k_ff")

    def initial(self) -> dict:
        """The integral of the error [m·s]."""
        return {"control_integral": 0.0}

    def command(self, y: dict, s: Signals):
        """The command u_c [V] before the supply limit."""
        return (
            self.position_gain * (s.reference - s.piston_position)
            + self.integral_gain * y["control_integral"]
            + self.velocity_gain * (s.reference_velocity - s.piston_velocity)
            + self.emf_feedforward * s.force_constant * s.reference_velocity
        )

    def rates(self, y: dict, s: Signals) -> dict:
        """dξ/dt [m]."""
        excess = s.voltage - s.unlimited_voltage
        return {
            "control_integral": s.reference - s.piston_position + self.antiwindup_gain * excess / self.position_gain
        }


class CascadeController(Controller):
    """Position loop around a velocity loop: u = kv (kp (r − x) − v)."""

    cascade_position_gain: float = par(160.0, "1/s", (0.0, 1e6), "gain of the position loop kp")
    cascade_velocity_gain: float = par(240.0, "V*s/m", (0.0, 1e7), "gain of the velocity loop kv")

    def command(self, y: dict, s: Signals):
        """The command u_c [V] before the supply limit."""
        velocity_set_point = self.cascade_position_gain * (s.reference - s.piston_position)
        return self.cascade_velocity_gain * (velocity_set_point - s.piston_velocity)


class OpenLoop(Controller):
    """No feedback: the reference, in volts, is the command; a current amplifier multiplies it by its gain."""

    def command(self, y: dict, s: Signals):
        """The reference as command [V]."""
        return s.reference


@struct
class Coordination:
    """Coordination of pump and reversing valve by the position error e of the cylinder.

    pump amplitude: amplitude · min(|e|/e_band, 1),   spool command: w = clip(e/e_dead, ±1)
    """

    amplitude_band: float = par(1e-3, "m", (1e-6, 1.0), "error at which the pump runs at full amplitude e_band")
    deadband: float = par(0.1e-3, "m", (1e-7, 1.0), "error at which the spool is fully open e_dead")

    def pump_share(self, error):
        """The share of the pump's amplitude, 0 … 1."""
        return jnp.minimum(jnp.abs(error) / self.amplitude_band, 1.0)

    def spool_command(self, error):
        """The spool's set point, −1 … 1."""
        return jnp.clip(error / self.deadband, -1.0, 1.0)
