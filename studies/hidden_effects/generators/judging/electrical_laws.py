"""Laws at coil, amplifier and supply, for judging."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.effects.reference_scales import REFERENCE_TRAVEL
from studies.hidden_effects.generators.laws import Law


class QuarticDroop(Effect):
    """A flat field with steep edges: Km (1 − κ (x/x_m)⁴).

    Source: force factor of voice coils with a long uniform field; Klippel, J. Audio Eng. Soc. 54 (2006) 907.
    """

    field_loss: float = par(0.1, "-", (-1.0, 1.0), "κ", plausible=(0.03, 0.4))

    def force_constant_factor(self, s, z):
        return 1.0 - self.field_loss * jnp.square(jnp.square(s.piston_position / REFERENCE_TRAVEL))


class TentDroop(Effect):
    """A force constant that falls linearly from mid-stroke: Km (1 − κ |x|/x_m), its tip rounded within 0.3 mm.

    Source: a coil as long as the gap, which leaves it in proportion to the displacement.
    """

    field_loss: float = par(0.1, "-", (-1.0, 1.0), "κ", plausible=(0.03, 0.3))

    def force_constant_factor(self, s, z):
        distance = jnp.sqrt(jnp.square(s.piston_position) + 9e-8) - 3e-4
        return 1.0 - self.field_loss * distance / REFERENCE_TRAVEL


class QuadraticSaturation(Effect):
    """Loss with the square of the current: F_e = Km i (1 − b i²), at most a half.

    Source: force factor of voice coils over current; Klippel, J. Audio Eng. Soc. 54 (2006) 907.
    """

    loss_per_square: float = par(1e-3, "1/A^2", (0.0, 10.0), "b", plausible=(1e-4, 1e-2))

    def motor_force_factor(self, s, z):
        return 1.0 - jnp.minimum(self.loss_per_square * jnp.square(s.current), 0.5)


class HyperbolicSaturation(Effect):
    """F_e = Km tanh(b i)/b.

    Source: hyperbolic magnetisation curves; Rivas, Zamarro, Martín, Pereira, IEEE Trans. Magn. 17 (1981) 1498.
    """

    bend: float = par(0.05, "1/A", (1e-9, 10.0), "b", plausible=(0.02, 0.3))

    def motor_force_factor(self, s, z):
        u = self.bend * s.current
        square = jnp.square(u)
        # tanh u/u has no value at 0
        return jnp.where(square < 1e-6, 1.0 - square / 3.0, jnp.tanh(u) / jnp.where(square < 1e-6, 1.0, u))


class RationalDeadTime(Effect):
    """Dead time as −V i/(|i| + c).

    Source: curve fits of measured inverter distortion; Guerrero, Leetmaa, Briz, IEEE Trans. Ind. Appl. 41 (2005) 487.
    """

    bridge_loss: float = par(1.0, "V", (0.0, 100.0), "V", plausible=(0.2, 3.0))
    bridge_current: float = par(0.1, "A", (1e-4, 10.0), "c", plausible=(0.03, 0.3))

    def coil_voltage_change(self, s, z):
        return -self.bridge_loss * s.current / (jnp.abs(s.current) + self.bridge_current)


class TrapezoidalDeadTime(Effect):
    """Dead time that rises linearly up to a current: −V clip(i/c, ±1).

    Source: Cichowski, Nieznanski, IEEE Power Electron. Letters 3 (2005) 72: trapezoidal compensation.
    """

    bridge_loss: float = par(1.0, "V", (0.0, 100.0), "V", plausible=(0.2, 3.0))
    bridge_current: float = par(0.3, "A", (1e-4, 10.0), "c", plausible=(0.1, 0.6))

    def coil_voltage_change(self, s, z):
        return -self.bridge_loss * jnp.clip(s.current / self.bridge_current, -1.0, 1.0)


LAWS = (
    Law(library.ForceConstantDroop, QuarticDroop), Law(library.ForceConstantDroop, TentDroop),
    Law(library.MagneticSaturation, QuadraticSaturation), Law(library.MagneticSaturation, HyperbolicSaturation),
    Law(library.InverterDeadTime, RationalDeadTime), Law(library.InverterDeadTime, TrapezoidalDeadTime),
)  # fmt: skip
