"""Laws at coil, amplifier and supply, for tuning."""

import math

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect, state
from edhas_jax.machine.effects.reference_scales import REFERENCE_TRAVEL
from studies.hidden_effects.generators.functions import arctan
from studies.hidden_effects.generators.laws import Law


class CosineDroop(Effect):
    """A force constant that falls as a cosine: Km (1 − 2 κ (1 − cos(π x/(2 x_m)))), x_m = 5 mm.

    Source: fundamental of the field of a magnet array.
    """

    droop_size: float = par(0.05, "-", (-1.0, 1.0), "κ", plausible=(0.015, 0.15))

    def force_constant_factor(self, s, z):
        angle = 0.5 * jnp.pi * s.piston_position / REFERENCE_TRAVEL
        return 1.0 - 2.0 * self.droop_size * (1.0 - jnp.cos(angle))


class RationalSaturation(Effect):
    """Saturation from the first ampere on: F_e = Km i/(1 + |i| b).

    Source: Fröhlich's magnetisation curve B = H/(a + b H), ETZ 2 (1881).
    """

    saturation_slope: float = par(0.02, "1/A", (0.0, 10.0), "b", plausible=(0.002, 0.1))

    def motor_force_factor(self, s, z):
        return 1.0 / (1.0 + jnp.abs(s.current) * self.saturation_slope)


class ArctanDeadTime(Effect):
    """Dead time with a wide transition: −V (2/π) atan(i/0.1 A).

    Source: clamping of the current around zero; Jeong, Park, IEEE Trans. Ind. Electron. 38 (1991) 108.
    """

    lost_voltage: float = par(1.0, "V", (0.0, 100.0), "V", plausible=(0.2, 3.0))

    def coil_voltage_change(self, s, z):
        return -self.lost_voltage * (2.0 / math.pi) * arctan(s.current / 0.1)


class OffsetDeadTime(Effect):
    """Dead time with a hard step where the current is not zero: −V sgn(i − i_0), as of unequal switches.

    Source: unequal device drops of a half bridge; Choi, Sul, IEEE Trans. Power Electron. 11 (1996) 221.
    """

    lost_voltage: float = par(1.0, "V", (0.0, 100.0), "V", plausible=(0.2, 3.0))
    step_current: float = par(0.1, "A", (-10.0, 10.0), "i_0", plausible=(-0.15, 0.15))

    def coil_voltage_change(self, s, z):
        return -self.lost_voltage * jnp.tanh((s.current - self.step_current) / 5e-3)


class SecondOrderAmplifier(Effect):
    """An amplifier with a second-order low-pass of damping 0.7: ü_a = ω² (u − u_a) − 1.4 ω u̇_a, τ = 1.4/ω.

    Source: output filter of a switching amplifier; Erickson, Maksimović, Fundamentals of Power Electronics.
    """

    filter_time: float = par(0.3e-3, "s", (1e-6, 1.0), "τ", plausible=(0.05e-3, 2e-3))

    filtered = state("V", "voltage behind the filter")
    slope = state("V", "its rate times 1/ω")

    def coil_voltage_change(self, s, z):
        return z.filtered - s.voltage

    def rates(self, s, z):
        omega = 1.4 / self.filter_time
        return {"filtered": omega * z.slope, "slope": omega * (s.voltage - z.filtered - 1.4 * z.slope)}


class MagnetHeating(Effect):
    """A coil that heats up together with its magnets: R (1 + 0.0039 ϑ), Km (1 − 0.0011 ϑ), C dϑ/dt = R i² − ϑ/3 K/W.

    Source: temperature coefficient of the remanence of NdFeB magnets, −0.11 %/K; IEC 60404-8-1.
    """

    heating_rate: float = par(0.1, "K/J", (1e-6, 100.0), "1/C", plausible=(0.02, 1.0))

    warmth = state("K", "temperature above that at the start")

    def coil_resistance_factor(self, s, z):
        return 1.0 + 0.0039 * z.warmth

    def force_constant_factor(self, s, z):
        return 1.0 - 0.0011 * z.warmth

    def rates(self, s, z):
        return {"warmth": self.heating_rate * (s.resistance * jnp.square(s.current) - z.warmth / 3.0)}


class SquaredSag(Effect):
    """A supply whose voltage drops with the square of the current: R i²/10 A, at most the whole voltage.

    Source: a supply in current limit folds back progressively; the form is chosen.
    """

    sag_size: float = par(0.5, "ohm", (0.0, 1e3), "R", plausible=(0.05, 2.0))

    def supply_voltage_change(self, s, z):
        return -jnp.minimum(self.sag_size * jnp.square(s.current) / 10.0, s.supply_voltage)


class ParabolicInductance(Effect):
    """An inductance that is largest at mid-stroke: L (1 − λ (x/x_m)²), with its force and voltage.

    Source: Klippel, J. Audio Eng. Soc. 54 (2006) 907: inductance of a voice coil over displacement.
    """

    inductance_curvature: float = par(0.2, "-", (-1.0, 1.0), "λ", plausible=(-0.5, 0.5))

    def _gradient(self, s):
        return -2.0 * s.coil_inductance * self.inductance_curvature * s.piston_position / REFERENCE_TRAVEL**2

    def coil_inductance_factor(self, s, z):
        return 1.0 - self.inductance_curvature * jnp.square(s.piston_position / REFERENCE_TRAVEL)

    def coil_voltage_change(self, s, z):
        return -s.current * s.piston_velocity * self._gradient(s)

    def mover_force(self, s, z):
        return 0.5 * jnp.square(s.current) * self._gradient(s)


LAWS = (
    Law(library.ForceConstantDroop, CosineDroop), Law(library.MagneticSaturation, RationalSaturation),
    Law(library.InverterDeadTime, ArctanDeadTime), Law(library.InverterDeadTime, OffsetDeadTime),
    Law(library.AmplifierLag, SecondOrderAmplifier), Law(library.CoilHeating, MagnetHeating),
    Law(library.SupplySag, SquaredSag), Law(library.ReluctanceForce, ParabolicInductance),
)  # fmt: skip
