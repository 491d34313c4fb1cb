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

    L di/dt = u − R i − Km v,   F_e = Km i                                     (Actuators 2022, 11(10), 281, Eq. 1)
    """

    coil_resistance: float = par(1.41, "ohm", (1e-3, 1e4), "resistance R", PAPER)
    coil_inductance: float = par(1.1e-3, "H", (1e-7, 10.0), "inductance L", PAPER)
    force_constant: float = par(24.61, "N/A", (1e-3, 1e4), "force constant and back-EMF constant Km", PAPER)

    def set_signals(self, s: Signals) -> None:
        """Resistance, inductance and force constant as they are now, and the motor force."""
        s.set(
            resistance=apply_slot(COIL_RESISTANCE, self.coil_resistance, s),
            inductance=apply_slot(COIL_INDUCTANCE, self.coil_inductance, s),
            motor_constant=apply_slot(FORCE_CONSTANT, self.force_constant, s),
        )
        s.set(
            motor_force=apply_slot(MOTOR_FORCE, s.motor_constant * s.current, s),
            back_emf=s.motor_constant * s.piston_velocity,
        )


@struct
class VoltageAmplifier:
    """The amplifier puts the command on the coil as a voltage; the current is a state."""

    def initial(self) -> dict:
        """No current at the start."""
        return {"current": 0.0}

    def current(self, y: dict, s: Signals):
        """The coil current [A]."""
        return y["current"]

    def coil_voltage(self, s: Signals):
        """The voltage at the coil [V]: the command and what effects add to it."""
        return apply_slot(COIL_VOLTAGE, s.voltage, s)

    def rates(self, s: Signals) -> dict:
        """di/dt [A/s]."""
        return {"current": (s.coil_voltage - s.resistance * s.current - s.back_emf) / s.inductance}


@struct
class CurrentAmplifier:
    """The amplifier has its own current loop, much faster than the rest: current = gain × command."""

    amplifier_gain: float = par(1.0, "A/V", (-1e4, 1e4), "current per volt of command")

    def initial(self) -> dict:
        """The current is no state."""
        return {}

    def current(self, y: dict, s: Signals):
        """The coil current [A]."""
        return self.amplifier_gain * s.voltage

    def coil_voltage(self, s: Signals):
        """The voltage [V] that the loop puts on the coil, inductance aside; what effects add changes no current."""
        return s.resistance * s.current + s.back_emf

    def rates(self, s: Signals) -> dict:
        """No state, no rate."""
        return {}
