"""The small disturbances of the demo's bench, which are not in the library of effects."""

import jax.numpy as jnp

from edhas_jax.machine.effects import Effect
from edhas_jax.machine.effects.reference_scales import REFERENCE_TRAVEL
from studies.hidden_effects.generators.disturbances import PHASE, Disturbance, shape_par, size_par
from studies.hidden_effects.generators.functions import wrapped
from studies.hidden_effects.generators.places import valve_of


class BenchDisturbances(Effect):
    """Small disturbances of coil, amplifier and mover, each with one size."""

    supply_hum: float = size_par("V", "hum of the rectifier on the coil voltage")
    hum_frequency: float = shape_par(100.0, "Hz", "its frequency", (99.8, 100.2))
    hum_phase: float = shape_par(0.0, "rad", "its phase", PHASE)
    weak_spring: float = size_par("N", "spring of the cables at 5 mm, with the cube of position")
    fan_weight: float = size_par("N", "force of an unbalanced fan on the frame")
    fan_frequency: float = shape_par(23.0, "Hz", "its speed", (21.0, 47.0))
    fan_phase: float = shape_par(0.0, "rad", "its phase", PHASE)
    magnet_warming: float = size_par("1/s", "relative fall of the force constant per time")
    cable_resistance: float = size_par("-", "relative change of the resistance over 5 mm")
    switching_ripple: float = size_par("V", "ripple of the amplifier")
    ripple_frequency: float = shape_par(1900.0, "Hz", "its frequency", (1200.0, 2200.0))
    set_point_steps: float = size_par("m", "resolution of the set point")

    def coil_voltage_change(self, s, z):
        hum = self.supply_hum * jnp.sin(2.0 * jnp.pi * self.hum_frequency * s.time + self.hum_phase)
        ripple = self.switching_ripple * jnp.sin(2.0 * jnp.pi * self.ripple_frequency * s.time)
        # what is missing of the set point, times the gain of the controller; within the controller it acts the same
        step = jnp.abs(self.set_point_steps) + 1e-9
        rounding = -step / (2.0 * jnp.pi) * wrapped(2.0 * jnp.pi * s.reference / step)
        return hum + ripple + jnp.where(self.set_point_steps == 0.0, 0.0, s.position_gain * rounding)

    def mover_force(self, s, z):
        u = s.piston_position / REFERENCE_TRAVEL
        fan = self.fan_weight * jnp.sin(2.0 * jnp.pi * self.fan_frequency * s.time + self.fan_phase)
        return fan - self.weak_spring * u * u * u

    def force_constant_factor(self, s, z):
        return 1.0 - self.magnet_warming * s.time

    def coil_resistance_factor(self, s, z):
        return 1.0 + self.cable_resistance * s.piston_position / REFERENCE_TRAVEL


class BenchPumpDisturbances(Effect):
    """Small disturbances of oil and valves, each with one size."""

    stiffer_oil: float = size_par("-", "relative fall of the compressibility per MPa")
    valve_asymmetry: float = size_par("N/m", "spring of suction valve A beyond the others")
    orifice_rise: float = size_par("-", "relative rise of the valves' flow coefficient per MPa")

    def oil_compressibility(self, s, z):
        return -self.stiffer_oil * (s.pressure - s.atmospheric_pressure) / 1e6 / s.oil_bulk_modulus

    def check_valve_force(self, s, z):
        return -self.valve_asymmetry * s.lift if valve_of(s) == "suction_a" else 0.0 * s.lift

    def suction_valve_area(self, s, z):
        return self.orifice_rise * s.valve_area * jnp.abs(s.pressure_drop) / 1e6

    def delivery_valve_area(self, s, z):
        return self.orifice_rise * s.valve_area * jnp.abs(s.pressure_drop) / 1e6


DISTURBANCES = (
    Disturbance(BenchDisturbances, "supply_hum", 0.1, ("hum_frequency", "hum_phase")),
    Disturbance(BenchDisturbances, "weak_spring", 0.2),
    Disturbance(BenchDisturbances, "fan_weight", 0.1, ("fan_frequency", "fan_phase")),
    Disturbance(BenchDisturbances, "magnet_warming", 0.01),
    Disturbance(BenchDisturbances, "cable_resistance", 0.01),
    Disturbance(BenchDisturbances, "switching_ripple", 0.5, ("ripple_frequency",)),
    Disturbance(BenchDisturbances, "set_point_steps", 5e-6),
    Disturbance(BenchPumpDisturbances, "stiffer_oil", 0.05),
    Disturbance(BenchPumpDisturbances, "valve_asymmetry", 10.0),
    Disturbance(BenchPumpDisturbances, "orifice_rise", 0.05),
)  # fmt: skip
