"""Laws at coil, amplifier and supply, for judging."""

import math

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect, state
from edhas_jax.machine.effects.reference_scales import REFERENCE_TRAVEL
from studies.hidden_effects.generators.functions import smooth_positive
from studies.hidden_effects.generators.laws import Law


class OffCentreDroop(Effect):
    """A force constant whose maximum is not at mid-stroke: Km (1 − κ (x² − 2 x x_0)/x_m²), x_m = 5 mm.

    Source: offset of the rest position of voice coils; Klippel, J. Audio Eng. Soc. 54 (2006) 907.
    """

    offset_droop: float = par(0.08, "-", (-1.0, 1.0), "κ", plausible=(0.02, 0.25))
    field_centre: float = par(1.2e-3, "m", (-1.0, 1.0), "x_0", plausible=(0.7e-3, 2.5e-3))

    def force_constant_factor(self, s, z):
        x = s.piston_position
        return 1.0 - self.offset_droop * x * (x - 2.0 * self.field_centre) / REFERENCE_TRAVEL**2


class PoleEdgeDroop(Effect):
    """A force constant that falls at the edges of the poles, at ±e.

    Km (1 − (κ/2) (2 + tanh((x − e)/w) − tanh((x + e)/w)))

    Source: stray field at the edges of a gap, w = 0.7 mm; the form is chosen.
    """

    edge_droop: float = par(0.1, "-", (-1.0, 1.0), "κ", plausible=(0.03, 0.3))
    edge_position: float = par(2e-3, "m", (0.0, 1.0), "e", plausible=(1.6e-3, 2.8e-3))

    def force_constant_factor(self, s, z):
        x, e = s.piston_position, self.edge_position
        return 1.0 - 0.5 * self.edge_droop * (2.0 + jnp.tanh((x - e) / 0.7e-3) - jnp.tanh((x + e) / 0.7e-3))


class BiasedSaturation(Effect):
    """Saturation at positive currents only: F_e = Km i (1 − b (i + √(i² + 1 A²))/2), at least 0.4 Km i.

    Source: flux of the coil that adds to that of the magnets or weakens it; Klippel, J. Audio Eng. Soc. 54 (2006) 907.
    The form is chosen.
    """

    biased_loss: float = par(0.03, "1/A", (0.0, 10.0), "b", plausible=(0.001, 0.1))

    def motor_force_factor(self, s, z):
        return jnp.maximum(1.0 - self.biased_loss * smooth_positive(s.current, 1.0), 0.4)


class RibSaturation(Effect):
    """Saturation of a thin rib, at small currents only: F_e = Km i (1 − b i²/(i² + i_r²)).

    Source: bridges and ribs of permanent-magnet machines, which saturate first; the form is chosen.
    """

    rib_share: float = par(0.05, "-", (0.0, 1.0), "b", plausible=(0.01, 0.3))
    rib_current: float = par(1.2, "A", (1e-3, 1e3), "i_r", plausible=(0.6, 2.5))

    def motor_force_factor(self, s, z):
        square = jnp.square(s.current)
        return 1.0 - self.rib_share * square / (square + self.rib_current * self.rib_current)


class SidedSaturation(Effect):
    """Saturation on one side of the stroke only: F_e = Km i (1 − b i² (1 + tanh(x/2 mm))/2), at least half of Km i.

    Source: force factor over current and position; Klippel, J. Audio Eng. Soc. 54 (2006) 907; the form is chosen.
    """

    sided_loss: float = par(2e-3, "1/A^2", (0.0, 10.0), "b", plausible=(2e-4, 2e-2))

    def motor_force_factor(self, s, z):
        over_iron = 0.5 * (1.0 + jnp.tanh(s.piston_position / 2e-3))
        return 1.0 - jnp.minimum(self.sided_loss * jnp.square(s.current) * over_iron, 0.5)


class LateCompensationDeadTime(Effect):
    """Dead time that is compensated by a filtered current: V (0.7 tanh(i_f/50 mA) − tanh(i/50 mA)).

    τ di_f/dt = i − i_f

    Source: compensation by the measured current; Muñoz, Lipo, IEEE Trans. Power Electron. 14 (1999) 683; share chosen.
    """

    late_voltage: float = par(1.0, "V", (0.0, 100.0), "V", plausible=(0.3, 4.0))
    current_filter_time: float = par(1e-3, "s", (1e-6, 1.0), "τ", plausible=(0.5e-3, 3e-3))

    filtered_current = state("A", "current that the compensation knows")

    def coil_voltage_change(self, s, z):
        return self.late_voltage * (0.7 * jnp.tanh(z.filtered_current / 0.05) - jnp.tanh(s.current / 0.05))

    def rates(self, s, z):
        return {"filtered_current": (s.current - z.filtered_current) / self.current_filter_time}


class ResidualDeadTime(Effect):
    """Dead time that is compensated except near zero current: −2 V (i/c)/(1 + (i/c)²), largest at c.

    Source: distortion that compensation leaves where the sign of the current is uncertain; the form is chosen.
    """

    residual_voltage: float = par(1.0, "V", (0.0, 100.0), "V", plausible=(0.2, 4.0))
    residual_current: float = par(0.3, "A", (1e-4, 10.0), "c", plausible=(0.12, 0.7))

    def coil_voltage_change(self, s, z):
        u = s.current / self.residual_current
        return -2.0 * self.residual_voltage * u / (1.0 + u * u)


class UnequalDeadTime(Effect):
    """Dead time of two unequal switches: −V at i > 0, +0.4 V at i < 0, −V (0.7 q + 0.3 q²) with q = tanh(i/40 mA).

    Source: unequal delays and drops of both switches of a half bridge; the ratio is chosen.
    """

    upper_voltage: float = par(1.0, "V", (0.0, 100.0), "V", plausible=(0.2, 3.0))

    def coil_voltage_change(self, s, z):
        q = jnp.tanh(s.current / 0.04)
        return -self.upper_voltage * (0.7 * q + 0.3 * q * q)


class ResonantSag(Effect):
    """A supply with an input filter that rings at f: L di_l/dt = −U − R i_l, C dU/dt = i_l − |i|, damping ratio 0.25.

    Source: Middlebrook, Proc. IEEE IAS (1976) 366: input filters of switching amplifiers.
    """

    feed_resistance: float = par(0.2, "ohm", (1e-6, 1e3), "R", plausible=(0.01, 1.0))
    feed_frequency: float = par(150.0, "Hz", (1.0, 1e4), "f", plausible=(60.0, 300.0))

    feed_change = state("V", "change of the voltage behind the filter, U")
    feed_current = state("A", "current of the filter i_l")

    def supply_voltage_change(self, s, z):
        return jnp.maximum(z.feed_change, -s.supply_voltage)

    def rates(self, s, z):
        omega = 2.0 * jnp.pi * self.feed_frequency
        return {
            "feed_change": self.feed_resistance * omega / 0.5 * (z.feed_current - jnp.abs(s.current)),
            "feed_current": -0.5 * omega * (z.feed_change / self.feed_resistance + z.feed_current),
        }


class PowerBalanceSag(Effect):
    """A voltage drop by the supply current of a switching amplifier: R i_s, i_s = max(R_c i² + Km i v, 0)/U_max.

    Source: power balance of a switching amplifier, whose supply current is less than that of the coil; Erickson,
    Maksimović, Fundamentals of Power Electronics. R_c is the coil resistance; the drop is at most the whole voltage.
    """

    source_resistance: float = par(0.2, "ohm", (0.0, 1e3), "R", plausible=(0.01, 1.5))

    def supply_voltage_change(self, s, z):
        power = s.coil_resistance * jnp.square(s.current) + s.force_constant * s.current * s.piston_velocity
        drop = self.source_resistance * jnp.maximum(power, 0.0) / s.supply_voltage
        return -jnp.minimum(drop, s.supply_voltage)


class RectifiedSag(Effect):
    """A voltage drop of a rectified supply with ripple: R |i| (1 + sin(2π 100 Hz t + φ)), at most the supply voltage.

    Source: ripple of a loaded rectifier, which grows with the current; fundamental of the ripple only.
    """

    mains_resistance: float = par(0.2, "ohm", (0.0, 1e3), "R", plausible=(0.01, 1.0))
    mains_phase: float = par(0.0, "rad", (-7.0, 7.0), "φ", plausible=(-math.pi, math.pi))

    def supply_voltage_change(self, s, z):
        ripple = 1.0 + jnp.sin(200.0 * jnp.pi * s.time + self.mains_phase)
        return -jnp.minimum(self.mains_resistance * jnp.abs(s.current) * ripple, s.supply_voltage)


class ShelfAmplifier(Effect):
    """An amplifier with a lag network, which passes 0.4 of the command at once: u_a = 0.4 u + 0.6 w, τ dw/dt = u − w.

    Source: lag networks in drives; Franklin, Powell, Emami-Naeini, Feedback Control of Dynamic Systems; share chosen.
    """

    shelf_time: float = par(0.4e-3, "s", (1e-6, 1.0), "τ", plausible=(0.1e-3, 4e-3))

    late_part = state("V", "command that the late part has reached")

    def coil_voltage_change(self, s, z):
        return 0.6 * (z.late_part - s.voltage)

    def rates(self, s, z):
        return {"late_part": (s.voltage - z.late_part) / self.shelf_time}


class SlewLimitedAmplifier(Effect):
    """An amplifier with a limited slew rate: du_a/dt = S tanh((u − u_a)/(S 60 µs)), S = 10 V/T.

    Source: differential stage that charges a capacitor; Solomon, IEEE J. Solid-State Circuits 9 (1974) 314.
    """

    slew_time: float = par(1e-3, "s", (1e-6, 1.0), "T, for 10 V", plausible=(0.2e-3, 3e-3))

    slewing = state("V", "voltage of the amplifier")

    def coil_voltage_change(self, s, z):
        return z.slewing - s.voltage

    def rates(self, s, z):
        rate = 10.0 / self.slew_time
        return {"slewing": rate * jnp.tanh((s.voltage - z.slewing) / (rate * 60e-6))}


class AirCooledHeating(Effect):
    """Heating of a coil that its own motion cools: dϑ/dt = R i²/C − (ϑ/0.15 s) (0.2 + |v|/0.1 m/s).

    Source: forced convection in the gap of voice coils; Klippel, J. Audio Eng. Soc. 52 (2004) 3. The time is chosen, of
    a thin winding in a narrow gap.
    """

    cooled_rate: float = par(0.5, "K/J", (1e-6, 100.0), "1/C", plausible=(0.1, 5.0))

    heat_up = state("K", "temperature above that at the start")

    def coil_resistance_factor(self, s, z):
        return 1.0 + 0.00393 * z.heat_up

    def rates(self, s, z):
        cooling = z.heat_up / 0.15 * (0.2 + jnp.abs(s.piston_velocity) / 0.1)
        return {"heat_up": self.cooled_rate * s.resistance * jnp.square(s.current) - cooling}


class ConductedHeating(Effect):
    """Heating of a coil whose heat diffuses into a thick former: ϑ = (2 h/√π) P √t.

    The root of time as a sum of three first-order parts of 3, 30 and 300 ms.

    Source: heated half-space; Carslaw, Jaeger, Conduction of Heat in Solids (1959).
    """

    diffusion_rate: float = par(0.5, "K/(W*s^0.5)", (1e-6, 100.0), "h", plausible=(0.1, 5.0))

    early_heat = state("K", "part of 3 ms")
    middle_heat = state("K", "part of 30 ms")
    late_heat = state("K", "part of 300 ms")

    def coil_resistance_factor(self, s, z):
        return 1.0 + 0.00393 * (z.early_heat + z.middle_heat + z.late_heat)

    def rates(self, s, z):
        power = self.diffusion_rate * s.resistance * jnp.square(s.current)
        parts = {"early_heat": 3e-3, "middle_heat": 30e-3, "late_heat": 0.3}
        # 1/√(π t) as a sum of exponentials a decade apart
        return {n: math.log(10.0) / math.pi * power / math.sqrt(t) - getattr(z, n) / t for n, t in parts.items()}


LAWS = (
    Law(library.ForceConstantDroop, OffCentreDroop), Law(library.ForceConstantDroop, PoleEdgeDroop),
    Law(library.MagneticSaturation, BiasedSaturation), Law(library.MagneticSaturation, RibSaturation),
    Law(library.MagneticSaturation, SidedSaturation),
    Law(library.InverterDeadTime, LateCompensationDeadTime), Law(library.InverterDeadTime, ResidualDeadTime),
    Law(library.InverterDeadTime, UnequalDeadTime),
    Law(library.SupplySag, ResonantSag), Law(library.SupplySag, PowerBalanceSag), Law(library.SupplySag, RectifiedSag),
    Law(library.AmplifierLag, ShelfAmplifier), Law(library.AmplifierLag, SlewLimitedAmplifier),
    Law(library.CoilHeating, AirCooledHeating), Law(library.CoilHeating, ConductedHeating),
)  # fmt: skip
