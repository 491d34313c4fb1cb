"""The coil of the linear actuator and the amplifier that feeds it."""

from edhas_jax.core.structs import par, struct
from edhas_jax.machine.components import PAPER
from edhas_jax.machine.interface.signals import Signals
from edhas_jax.machine.interface.slots import (
    COIL_INDUCTANCE,
    COIL_RESISTANCE,
    COIL_VOLTAGE,
    FORCE_CONSTANT,
    MOTOR_FORCE,
    apply_slot,
)


@struct
class Coil:
    """Moving coil: resistance, inductance and a force constant that is also the back-EMF constant.

    L di/dt = u − R i − Km v,   F_e = Km i

    Source: Actuators 2022, 11(10), 281, Eq. (1); `VoltageAmplifier.rates` solves it for di/dt.
    """

    coil_resistance: float = par(1.41, "ohm", (1e-3, 1e4), "resistance R", PAPER)
    coil_inductance: float = par(1.1e-3, "H", (1e-7, 10.0), "inductance L", PAPER)
    force_constant: float = par(24.61, "N/A", (1e-3, 1e4), "force constant and back-EMF constant Km", PAPER)

    def set_signals(self, s: Signals) -> None:
        """Set resistance, inductance and force constant with the contributions of effects, motor force and back-EMF."""
        s.define(
            resistance=apply_slot(COIL_RESISTANCE, self.coil_resistance, s),
            inductance=apply_slot(COIL_INDUCTANCE, self.coil_inductance, s),
            motor_constant=apply_slot(FORCE_CONSTANT, self.force_constant, s),
        )
        s.define(
            motor_force=apply_slot(MOTOR_FORCE, s.motor_constant * s.current, s),
            back_emf=s.motor_constant * s.piston_velocity,
        )


@struct
class VoltageAmplifier:
    """A voltage source: the command is the voltage at the coil, and the current is a state."""

    def initial(self) -> dict:
        """The current at the start of a run [A]."""
        return {"current": 0.0}

    def current(self, y: dict, s: Signals):
        """The coil current [A]."""
        return y["current"]

    def coil_voltage(self, s: Signals):
        """The voltage at the coil [V]: the command with the contributions of effects."""
        return apply_slot(COIL_VOLTAGE, s.voltage, s)

    def rates(self, s: Signals) -> dict:
        """The rate of the current di/dt = (u − R i − Km v)/L [A/s], Eq. (1)."""
        return {"current": (s.coil_voltage - s.resistance * s.current - s.back_emf) / s.inductance}


@struct
class CurrentAmplifier:
    """A current source: an internal current loop, much faster than the machine, gives current = gain × command."""

    amplifier_gain: float = par(1.0, "A/V", (-1e4, 1e4), "current per volt of command")

    def initial(self) -> dict:
        """No state: the current follows from the command."""
        return {}

    def current(self, y: dict, s: Signals):
        """The coil current [A]."""
        return self.amplifier_gain * s.voltage

    def coil_voltage(self, s: Signals):
        """The voltage [V] at the coil, without that of the inductance; voltage effects do not change the current."""
        return s.resistance * s.current + s.back_emf

    def rates(self, s: Signals) -> dict:
        """No rate, as there is no state."""
        return {}
