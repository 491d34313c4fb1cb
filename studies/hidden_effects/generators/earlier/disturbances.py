"""Small disturbances, for the earlier judging set."""

import jax.numpy as jnp

from edhas_jax.machine.effects import Effect, state
from edhas_jax.machine.effects.reference_scales import REFERENCE_TRAVEL
from studies.hidden_effects.generators.disturbances import PHASE, Disturbance, shape_par, size_par
from studies.hidden_effects.generators.places import is_chamber_b, valve_of

FRAME_DAMPING = 0.03  # damping ratio of the frame


class EarlierDisturbances(Effect):
    """Small disturbances of coil, amplifier and mover, each with one size."""

    stray_field: float = size_par("N", "force of a transformer's stray field")
    field_phase: float = shape_par(0.0, "rad", "its phase at 50 Hz", PHASE)
    one_sided_boot: float = size_par("N", "force at 5 mm of a rubber boot that pulls at x > 0 only")
    tilted_field: float = size_par("-", "relative change of the force constant over 5 mm")
    inductance_fall: float = size_par("1/A", "relative fall of the inductance per ampere")
    frame_motion: float = size_par("N/(m/s^2)", "force per acceleration of the elastic frame")
    frame_frequency: float = shape_par(60.0, "Hz", "natural frequency of the frame", (45.0, 120.0))
    amplifier_drift: float = size_par("V", "offset of the amplifier that vanishes while it warms up")
    drift_time: float = shape_par(0.1, "s", "its time constant", (0.05, 0.3))

    frame_position = state("m", "of the frame per force constant and current, scaled")
    frame_velocity = state("m/s", "of the frame")

    def _frame_acceleration(self, s, z):
        omega = 2.0 * jnp.pi * self.frame_frequency
        # driven by the reaction of the motor force on a frame of 10 kg
        drive = -s.force_constant * s.current / 10.0
        return drive - 2.0 * FRAME_DAMPING * omega * z.frame_velocity - omega * omega * z.frame_position

    def rates(self, s, z):
        return {"frame_position": z.frame_velocity, "frame_velocity": self._frame_acceleration(s, z)}

    def mover_force(self, s, z):
        u = s.piston_position / REFERENCE_TRAVEL
        field = self.stray_field * jnp.sin(100.0 * jnp.pi * s.time + self.field_phase)
        boot = -self.one_sided_boot * jnp.square(jnp.maximum(u, 0.0))
        return field + boot - self.frame_motion * self._frame_acceleration(s, z)

    def force_constant_factor(self, s, z):
        return 1.0 + self.tilted_field * s.piston_position / REFERENCE_TRAVEL

    def coil_inductance_factor(self, s, z):
        return 1.0 - self.inductance_fall * jnp.abs(s.current)

    def coil_voltage_change(self, s, z):
        return self.amplifier_drift * jnp.exp(-s.time / self.drift_time)


class EarlierPumpDisturbances(Effect):
    """Small disturbances of chambers, oil and valves, each with one size."""

    larger_plunger: float = size_par("-", "relative excess of the area of plunger B")
    larger_chamber: float = size_par("m^3", "further volume of chamber B")
    progressive_valve: float = size_par("N/m^2", "spring of the valves with the square of lift")
    warming_oil: float = size_par("1/s", "relative fall of the viscosity per time")

    def mover_force(self, s, z):
        return self.larger_plunger * s.piston_area * (s.chamber_pressure_b - s.accumulator_pressure)

    def chamber_leakage(self, s, z):
        if s.chamber_pressure is not s.chamber_pressure_b:
            return 0.0 * s.plunger_velocity
        return -self.larger_plunger * s.piston_area * s.plunger_velocity

    def oil_compressibility(self, s, z):
        if not is_chamber_b(s):
            return 0.0 * s.pressure
        volume = s.pump_dead_volume + s.piston_area * (0.5 * s.pump_stroke + s.sliding_position)
        return self.larger_chamber / volume / s.oil_bulk_modulus

    def check_valve_force(self, s, z):
        return -self.progressive_valve * jnp.square(s.lift) if valve_of(s).startswith("delivery") else 0.0 * s.lift

    def oil_viscosity_factor(self, s, z):
        return 1.0 - self.warming_oil * s.time


DISTURBANCES = (
    Disturbance(EarlierDisturbances, "stray_field", 0.1, ("field_phase",)),
    Disturbance(EarlierDisturbances, "one_sided_boot", 0.3),
    Disturbance(EarlierDisturbances, "tilted_field", 0.005),
    Disturbance(EarlierDisturbances, "inductance_fall", 0.02),
    Disturbance(EarlierDisturbances, "frame_motion", 0.05, ("frame_frequency",)),
    Disturbance(EarlierDisturbances, "amplifier_drift", 0.05, ("drift_time",)),
    Disturbance(EarlierPumpDisturbances, "larger_plunger", 0.002),
    Disturbance(EarlierPumpDisturbances, "larger_chamber", 2e-8),
    Disturbance(EarlierPumpDisturbances, "progressive_valve", 5e4),
    Disturbance(EarlierPumpDisturbances, "warming_oil", 0.1),
)  # fmt: skip
