"""The dead time of the inverter."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect

SIGN_SMOOTHING_CURRENT = 0.05  # A, current at which tanh has nearly reached the sign


class InverterDeadTime(Effect):
    """While both switches of a half bridge are off, the current and not the command determines the voltage.

    u → u − V_dt tanh(i / 50 mA)

    Source: V_dt = 2 U t_d f_s and the drop of the devices; 1.9 V at 48 V, 1 µs, 20 kHz.
    """

    looks_like = "a step of the voltage where the current changes sign, of the same size at every load"
    confused_with = ("lugre_friction", "coulomb_friction", "coil_resistance")

    dead_time_voltage: float = par(1.0, "V", (0.0, 100.0), "voltage that is lost V_dt", plausible=(0.3, 3.0))

    def coil_voltage_change(self, s, z):
        return -self.dead_time_voltage * jnp.tanh(s.current / SIGN_SMOOTHING_CURRENT)
