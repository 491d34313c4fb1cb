"""Laws of coil, amplifier and supply for practice cases, which are a second set of development cases."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect, state
from edhas_jax.machine.effects.reference_scales import REFERENCE_TRAVEL
from studies.hidden_effects.generators.laws import Law


class FlatTopDroop(Effect):
    """A force constant that falls towards the ends only: Km (1 − κ (x/x_m)⁴), x_m = 5 mm.

    Source: overhung coils, flat over the mid-range; Klippel, J. Audio Eng. Soc. 54 (2006) 907; the form is chosen.
    """

    end_droop: float = par(0.1, "-", (-1.0, 1.0), "κ", plausible=(0.05, 0.4))

    def force_constant_factor(self, s, z):
        return 1.0 - self.end_droop * jnp.square(jnp.square(s.piston_position / REFERENCE_TRAVEL))


class CubicSaturation(Effect):
    """Saturation that sets in late: F_e = Km i/(1 + |i/i_s|³)^(1/3).

    Source: sharp knee of pole steel; the form is chosen.
    """

    knee_slope: float = par(0.07, "1/A", (0.0, 10.0), "1/i_s", plausible=(0.02, 0.25))

    def motor_force_factor(self, s, z):
        share = jnp.abs(s.current) * self.knee_slope
        return (1.0 + share * share * share) ** (-1.0 / 3.0)


class RampDeadTime(Effect):
    """Dead time with a wide, gradual transition: −V i/√(i² + (0.15 A)²).

    Source: soft switching around zero current; the form is chosen.
    """

    flank_voltage: float = par(1.0, "V", (0.0, 100.0), "V", plausible=(0.3, 3.0))

    def coil_voltage_change(self, s, z):
        return -self.flank_voltage * s.current / jnp.sqrt(jnp.square(s.current) + 0.0225)


class DelayedAmplifier(Effect):
    """An amplifier that is late by its switching period: Padé's first approximation of a dead time τ.

    Source: zero-order hold of a digital modulator; Buso, Mattavelli, Digital Control in Power Electronics (2006).
    """

    hold_time: float = par(0.3e-3, "s", (1e-6, 1.0), "τ", plausible=(0.08e-3, 2e-3))

    held = state("V", "mean of the voltage before")

    def coil_voltage_change(self, s, z):
        return 2.0 * (z.held - s.voltage)

    def rates(self, s, z):
        return {"held": 2.0 * (s.voltage - z.held) / self.hold_time}


class RootSag(Effect):
    """A supply whose voltage drops at small currents already: R √(|i| 5 A), at most the whole voltage.

    Source: rectifiers with commutation overlap drop most at light load; the form is chosen.
    """

    rectifier_sag: float = par(0.4, "ohm", (0.0, 1e3), "R", plausible=(0.05, 1.5))

    def supply_voltage_change(self, s, z):
        drop = self.rectifier_sag * jnp.sqrt(5.0 * jnp.abs(s.current) + 1e-6)
        return -jnp.minimum(drop, s.supply_voltage)


class SteppedInductance(Effect):
    """An inductance that changes where the coil leaves the iron: L (1 + λ x/√(x² + (2 mm)²)), force and voltage too.

    Source: Klippel, J. Audio Eng. Soc. 54 (2006) 907: inductance of a voice coil over displacement.
    """

    iron_step: float = par(0.2, "-", (-1.0, 1.0), "λ", plausible=(-0.4, 0.4))

    def _gradient(self, s):
        distance = jnp.square(s.piston_position) + 4e-6
        return s.coil_inductance * self.iron_step * 4e-6 / (distance * jnp.sqrt(distance))

    def coil_inductance_factor(self, s, z):
        return 1.0 + self.iron_step * s.piston_position / jnp.sqrt(jnp.square(s.piston_position) + 4e-6)

    def coil_voltage_change(self, s, z):
        return -s.current * s.piston_velocity * self._gradient(s)

    def mover_force(self, s, z):
        return 0.5 * jnp.square(s.current) * self._gradient(s)


LAWS = (
    Law(library.ForceConstantDroop, FlatTopDroop), Law(library.MagneticSaturation, CubicSaturation),
    Law(library.InverterDeadTime, RampDeadTime), Law(library.AmplifierLag, DelayedAmplifier),
    Law(library.SupplySag, RootSag), Law(library.ReluctanceForce, SteppedInductance),
)  # fmt: skip
