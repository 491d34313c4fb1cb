"""Small disturbances whose functions have random parameters, for varied cases.

None of them acts like an effect of the library, which a diagnosis would then be right to name. Judging cases have
other disturbances.
"""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects import Effect
from studies.hidden_effects.generators.disturbances import PHASE, Disturbance, size_par

PITCH = (0.6, 2.5)  # half periods over the typical range of the variable


def _pitch():
    return par(1.0, "-", (0.0, 1e3), "half periods over the typical range", plausible=PITCH)


def _phase():
    return par(0.0, "rad", (-1e3, 1e3), "phase", plausible=PHASE)


def _wave(u, pitch, phase):
    """A sine and its second harmonic, shifted vertically so that the curve is 0 at u = 0."""
    angle = jnp.pi * pitch * u
    second = 0.4 * (jnp.sin(2.0 * angle + 2.3 * phase) - jnp.sin(2.3 * phase))
    return jnp.sin(angle + phase) - jnp.sin(phase) + second


class VariedDisturbances(Effect):
    """Small unlisted effects of coil, amplifier and mover; one parameter sets the size of each."""

    rocking_frame: float = size_par("N", "slow rocking of the frame")
    rocking_frequency: float = par(5.0, "Hz", (0.0, 1e4), "its frequency", plausible=(2.0, 9.0))
    rocking_phase: float = _phase()
    amplifier_curve: float = size_par("V", "curvature of the amplifier over the current, at 5 A")
    amplifier_curve_pitch: float = _pitch()
    amplifier_curve_phase: float = _phase()
    contact_resistance: float = size_par("-", "resistance that falls with the current, at 5 A")
    beating_supply: float = size_par("V", "beat of two switched supplies")
    beat_frequency: float = par(80.0, "Hz", (0.0, 1e4), "its frequency", plausible=(40.0, 400.0))
    speed_loss: float = size_par("-", "force constant that falls with the speed, far above 0.1 m/s")
    pulsed_supply: float = size_par("V", "short dips of the supply")
    pulse_frequency: float = par(30.0, "Hz", (0.0, 1e4), "their frequency", plausible=(15.0, 90.0))
    shaken_frame: float = size_par("N", "vibration of the frame")
    shaken_frame_frequency: float = par(60.0, "Hz", (0.0, 1e4), "its frequency", plausible=(30.0, 300.0))
    shaken_frame_phase: float = _phase()

    def coil_voltage_change(self, s, z):
        u = s.current / 5.0
        beat = self.beating_supply * jnp.sin(2.0 * jnp.pi * self.beat_frequency * s.time)
        pulses = self.pulsed_supply * jnp.exp(20.0 * (jnp.cos(2.0 * jnp.pi * self.pulse_frequency * s.time) - 1.0))
        return beat - pulses + self.amplifier_curve * _wave(u, self.amplifier_curve_pitch, self.amplifier_curve_phase)

    def coil_resistance_factor(self, s, z):
        return 1.0 - self.contact_resistance * jnp.abs(s.current) / (jnp.abs(s.current) + 5.0)

    def force_constant_factor(self, s, z):
        square = jnp.square(s.piston_velocity / 0.1)
        return 1.0 - self.speed_loss * square / (1.0 + square)

    def mover_force(self, s, z):
        shaking = 2.0 * jnp.pi * self.shaken_frame_frequency * s.time + self.shaken_frame_phase
        rocking = 2.0 * jnp.pi * self.rocking_frequency * s.time + self.rocking_phase
        return self.shaken_frame * jnp.sin(shaking) + self.rocking_frame * jnp.sin(rocking)


class VariedPumpDisturbances(Effect):
    """Small unlisted effects of oil, gaps and valves; one parameter sets the size of each."""

    shear_thinning: float = size_par("-", "viscosity that falls with the speed, at 0.3 m/s")
    gap_turbulence: float = size_par("m^3/s", "leakage with the root of the pressure, at 0.5 MPa")
    rounded_seat: float = size_par("-", "relative change of the valves' area over the lift, at 0.5 mm")

    def oil_viscosity_factor(self, s, z):
        return 1.0 - self.shear_thinning * jnp.abs(s.piston_velocity) / (jnp.abs(s.piston_velocity) + 0.3)

    def chamber_leakage(self, s, z):
        over = (s.chamber_pressure - s.atmospheric_pressure) / 0.5e6
        return self.gap_turbulence * over / jnp.sqrt(jnp.sqrt(over * over + 1e-4))

    def suction_valve_area(self, s, z):
        return self.rounded_seat * s.valve_area * jnp.tanh(s.lift / 0.5e-3)

    def delivery_valve_area(self, s, z):
        return self.rounded_seat * s.valve_area * jnp.tanh(s.lift / 0.5e-3)


DISTURBANCES = (
    Disturbance(VariedDisturbances, "rocking_frame", 0.1, ("rocking_frequency", "rocking_phase")),
    Disturbance(VariedDisturbances, "amplifier_curve", 0.1, ("amplifier_curve_pitch", "amplifier_curve_phase")),
    Disturbance(VariedDisturbances, "contact_resistance", 0.02),
    Disturbance(VariedDisturbances, "beating_supply", 0.1, ("beat_frequency",)),
    Disturbance(VariedDisturbances, "speed_loss", 0.005),
    Disturbance(VariedDisturbances, "pulsed_supply", 0.2, ("pulse_frequency",)),
    Disturbance(VariedDisturbances, "shaken_frame", 0.1, ("shaken_frame_frequency", "shaken_frame_phase")),
    Disturbance(VariedPumpDisturbances, "shear_thinning", 0.05),
    Disturbance(VariedPumpDisturbances, "gap_turbulence", 1e-8),
    Disturbance(VariedPumpDisturbances, "rounded_seat", 0.02),
)
