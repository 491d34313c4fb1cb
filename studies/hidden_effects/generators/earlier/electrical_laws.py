"""Laws at coil, amplifier and supply, for the earlier judging set."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect, state
from edhas_jax.machine.effects.reference_scales import REFERENCE_TRAVEL
from studies.hidden_effects.generators.laws import Law


class QuarticDroop(Effect):
    """A force constant that is flat at mid-stroke and falls steeply at the ends: Km (1 − κ (x/x_m)⁴).

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
    """Saturation with the square of the current: F_e = Km i (1 − b i²), at most a half.

    Source: force factor of voice coils over current; Klippel, J. Audio Eng. Soc. 54 (2006) 907.
    """

    loss_per_square: float = par(1e-3, "1/A^2", (0.0, 10.0), "b", plausible=(1e-4, 1e-2))

    def motor_force_factor(self, s, z):
        return 1.0 - jnp.minimum(self.loss_per_square * jnp.square(s.current), 0.5)


class KneeSaturation(Effect):
    """Saturation by a magnetisation curve of two straight lines: F_e = Km (i − b (|i| − 1.5 A) sgn i) beyond 1.5 A.

    Source: piecewise linear magnetisation curves; Fitzgerald, Kingsley, Umans, Electric Machinery.
    """

    knee_loss: float = par(0.05, "-", (0.0, 1.0), "b", plausible=(0.01, 0.6))

    def motor_force_factor(self, s, z):
        size = jnp.abs(s.current)
        return 1.0 - self.knee_loss * jnp.maximum(size - 1.5, 0.0) / jnp.maximum(size, 1.5)


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


class CapacitorSag(Effect):
    """A supply with a buffer capacitor and a source resistance: τ dU/dt = −R |i| − U.

    Source: a rectifier with a bus capacitor.
    """

    bus_resistance: float = par(0.5, "ohm", (0.0, 1e3), "R", plausible=(0.05, 2.0))
    bus_time: float = par(5e-3, "s", (1e-5, 10.0), "τ", plausible=(1e-3, 2e-2))

    bus_change = state("V", "change of the voltage of the capacitor")

    def supply_voltage_change(self, s, z):
        return jnp.maximum(z.bus_change, -s.supply_voltage)

    def rates(self, s, z):
        return {"bus_change": (-self.bus_resistance * jnp.abs(s.current) - z.bus_change) / self.bus_time}


class ThresholdSag(Effect):
    """A voltage drop of the supply above 2 A only: R max(|i| − 2 A, 0), at most the supply voltage.

    Source: a supply with current limit.
    """

    bus_resistance: float = par(0.5, "ohm", (0.0, 1e3), "R", plausible=(0.05, 3.0))

    def supply_voltage_change(self, s, z):
        return -jnp.minimum(self.bus_resistance * jnp.maximum(jnp.abs(s.current) - 2.0, 0.0), s.supply_voltage)


class DeadTimeAmplifier(Effect):
    """An amplifier with a pure delay T, as a first-order Padé approximation: u_a = 2 w − u, dw/dt = 2 (u − w)/T.

    Source: Padé's approximation of e^(−sT); computing and modulation of a digital amplifier.
    """

    amplifier_delay: float = par(0.2e-3, "s", (1e-6, 1.0), "T", plausible=(0.05e-3, 2e-3))

    delayed = state("V", "inner state")

    def coil_voltage_change(self, s, z):
        return 2.0 * (z.delayed - s.voltage)

    def rates(self, s, z):
        return {"delayed": 2.0 * (s.voltage - z.delayed) / self.amplifier_delay}


class TwoStageAmplifier(Effect):
    """An amplifier of two equal lags in series: τ du_1/dt = u − u_1, τ du_2/dt = u_1 − u_2.

    Source: a modulator and an output filter of the same bandwidth.
    """

    stage_time: float = par(0.15e-3, "s", (1e-6, 1.0), "τ", plausible=(0.03e-3, 1e-3))

    first = state("V", "voltage behind the first stage")
    second = state("V", "voltage behind the second stage")

    def coil_voltage_change(self, s, z):
        return z.second - s.voltage

    def rates(self, s, z):
        return {"first": (s.voltage - z.first) / self.stage_time, "second": (z.first - z.second) / self.stage_time}


class WindingAndFormer(Effect):
    """Heating of a winding that is coupled to its former: C_w dϑ/dt = R i² − (ϑ − ϑ_f)/R_th, C_f = 3 C_w.

    Source: two-mass thermal models of voice coils; Button, J. Audio Eng. Soc. 40 (1992) 32.
    """

    winding_rate: float = par(0.4, "K/J", (1e-6, 100.0), "1/C_w", plausible=(0.1, 3.0))

    winding = state("K", "temperature of the winding above that at the start")
    former = state("K", "temperature of the former above that at the start")

    def coil_resistance_factor(self, s, z):
        return 1.0 + 0.00393 * z.winding

    def rates(self, s, z):
        # time constant of a winding of thin wire on its former: 0.04 s
        flow = (z.winding - z.former) / 0.04 / self.winding_rate
        heat = s.resistance * jnp.square(s.current)
        return {"winding": self.winding_rate * (heat - flow), "former": self.winding_rate / 3.0 * flow}


class EddyLossHeating(Effect):
    """Heating of the coil by copper loss and by eddy currents in its former: R i² + 60 W (v/0.2 m/s)².

    Source: Joule's law for the former, whose loss grows with the square of speed.
    """

    former_rate: float = par(0.1, "K/J", (1e-6, 100.0), "1/C", plausible=(0.02, 0.8))

    warmth = state("K", "temperature above that at the start")

    def coil_resistance_factor(self, s, z):
        return 1.0 + 0.00393 * z.warmth

    def rates(self, s, z):
        heat = s.resistance * jnp.square(s.current) + 60.0 * jnp.square(s.piston_velocity / 0.2)
        return {"warmth": self.former_rate * (heat - z.warmth / 3.0)}


class EndedInductance(Effect):
    """An inductance that changes near mid-stroke only: L (1 + λ tanh(x/1.5 mm)), with its force and voltage.

    Source: Klippel, J. Audio Eng. Soc. 54 (2006) 907: inductance over displacement is a step from out to in.
    """

    inductance_step: float = par(0.1, "-", (-1.0, 1.0), "λ", plausible=(-0.3, 0.3))

    def _gradient(self, s):
        level = jnp.tanh(s.piston_position / 1.5e-3)
        return s.coil_inductance * self.inductance_step * (1.0 - jnp.square(level)) / 1.5e-3

    def coil_inductance_factor(self, s, z):
        return 1.0 + self.inductance_step * jnp.tanh(s.piston_position / 1.5e-3)

    def coil_voltage_change(self, s, z):
        return -s.current * s.piston_velocity * self._gradient(s)

    def mover_force(self, s, z):
        return 0.5 * jnp.square(s.current) * self._gradient(s)


class SlottedInductance(Effect):
    """An inductance that is periodic in the position: L (1 + λ sin(2π x/8 mm + 0.6)), with its force and voltage.

    Source: reluctance of a slotted yoke, first harmonic; Gieras, Piech, Tomczuk, Linear Synchronous Motors (2011).
    """

    slot_inductance: float = par(0.1, "-", (-1.0, 1.0), "λ", plausible=(-0.3, 0.3))

    def _angle(self, s):
        return 2.0 * jnp.pi * s.piston_position / 8e-3 + 0.6

    def _gradient(self, s):
        return s.coil_inductance * self.slot_inductance * jnp.cos(self._angle(s)) * 2.0 * jnp.pi / 8e-3

    def coil_inductance_factor(self, s, z):
        return 1.0 + self.slot_inductance * jnp.sin(self._angle(s))

    def coil_voltage_change(self, s, z):
        return -s.current * s.piston_velocity * self._gradient(s)

    def mover_force(self, s, z):
        return 0.5 * jnp.square(s.current) * self._gradient(s)


LAWS = (
    Law(library.ForceConstantDroop, QuarticDroop), Law(library.ForceConstantDroop, TentDroop),
    Law(library.MagneticSaturation, QuadraticSaturation), Law(library.MagneticSaturation, KneeSaturation),
    Law(library.InverterDeadTime, RationalDeadTime), Law(library.InverterDeadTime, TrapezoidalDeadTime),
    Law(library.SupplySag, CapacitorSag), Law(library.SupplySag, ThresholdSag),
    Law(library.AmplifierLag, DeadTimeAmplifier), Law(library.AmplifierLag, TwoStageAmplifier),
    Law(library.CoilHeating, WindingAndFormer), Law(library.CoilHeating, EddyLossHeating),
    Law(library.ReluctanceForce, EndedInductance), Law(library.ReluctanceForce, SlottedInductance),
)  # fmt: skip
