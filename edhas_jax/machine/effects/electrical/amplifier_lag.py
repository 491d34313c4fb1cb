"""First-order lag of the amplifier."""

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect, state


class AmplifierLag(Effect):
    """A first-order lag between the command and the voltage at the coil.

    τ du_a/dt = u − u_a,   u_a the voltage at the coil

    Source: switching period, filter and dead time of a drive as one time constant.
    """

    looks_like = "current later than the command by a fixed time, so that its phase falls in proportion to frequency"
    confused_with = ("coil_inductance", "sensor_lag", "sensor_delay")
    memory_of = "voltage"

    amplifier_time: float = par(0.3e-3, "s", (1e-6, 1.0), "time constant τ", plausible=(0.05e-3, 2e-3))

    output = state("V", "voltage of the amplifier")

    def coil_voltage_change(self, s, z):
        return z.output - s.voltage

    def rates(self, s, z):
        return {"output": (s.voltage - z.output) / self.amplifier_time}
