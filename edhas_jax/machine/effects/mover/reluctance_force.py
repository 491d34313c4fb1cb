"""Reluctance force: an inductance that depends on the position of the coil."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect
from edhas_jax.machine.effects.reference_scales import REFERENCE_TRAVEL


class ReluctanceForce(Effect):
    """The coil is pulled towards the position of larger inductance.

    L(x) = L (1 + λ x/x_m), x_m = 5 mm:   L(x) di/dt = u − R i − Km v − i v dL/dx,   force + ½ i² dL/dx

    A current amplifier compensates the voltage; the force remains.

    Source: Modelica.Magnetic.FluxTubes, moving-coil actuator; energy of the field at constant flux.
    """

    looks_like = "a force of one sign whatever the sign of the current, growing with its square; even harmonics"
    confused_with = ("constant_bias_force", "cogging_force", "coil_inductance", "asymmetric_friction")

    inductance_slope: float = par(
        0.2, "-", (-1.0, 1.0), "relative change of the inductance over 5 mm of travel, λ", plausible=(-0.4, 0.4)
    )

    def _inductance_gradient(self, s):
        """dL/dx [H/m]."""
        return s.coil_inductance * self.inductance_slope / REFERENCE_TRAVEL

    def coil_inductance_factor(self, s, z):
        return 1.0 + self.inductance_slope * s.piston_position / REFERENCE_TRAVEL

    def coil_voltage_change(self, s, z):
        return -s.current * s.piston_velocity * self._inductance_gradient(s)

    def mover_force(self, s, z):
        return 0.5 * jnp.square(s.current) * self._inductance_gradient(s)
