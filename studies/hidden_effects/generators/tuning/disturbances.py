"""Small disturbances, for the tuning cases."""

import jax.numpy as jnp

from edhas_jax.machine.effects import Effect, state
from edhas_jax.machine.effects.reference_scales import REFERENCE_TRAVEL
from studies.hidden_effects.generators.disturbances import PHASE, Disturbance, shape_par, size_par
from studies.hidden_effects.generators.places import is_chamber_b, valve_of


class TuningDisturbances(Effect):
    """Small effects of coil, amplifier and mover that the library lacks; one parameter sets the size of each."""

    floor_tremor: float = size_par("N", "force of three slow vibrations of the floor at once")
    tremor_rate: float = shape_par(3.1, "Hz", "frequency of the slowest of them", (2.4, 4.6))
    tremor_phase: float = shape_par(0.0, "rad", "its phase", PHASE)
    settling_bench: float = size_par("N", "component of the weight as the bench slowly tilts, at 0.4 s")
    oil_puddle: float = size_par("N", "drag of an oil puddle, proportional to the cube of the speed, at 0.2 m/s")
    passing_screw: float = size_par("N", "force where the mover passes a screw head")
    screw_position: float = shape_par(1e-3, "m", "position of the screw head", (-2e-3, 2.5e-3))
    clock_leak: float = size_par("-", "relative modulation of the voltage by a clock signal")
    clock_rate: float = shape_par(610.0, "Hz", "its frequency", (420.0, 880.0))
    dither: float = size_par("V", "amplitude of the dither of the amplifier")
    dither_rate: float = shape_par(333.0, "Hz", "its frequency", (240.0, 390.0))
    ground_step: float = size_par("V", "step of the ground potential of the amplifier")
    step_time: float = shape_par(0.1, "s", "time of the step", (0.05, 0.2))
    warm_field: float = size_par("-", "relative loss of the force constant under load, at 5 A; it recovers")

    loaded = state("-", "square of the current over 5 A, smoothed with a time constant of 30 ms")

    def coil_voltage_change(self, s, z):
        clock = self.clock_leak * s.voltage * jnp.sin(2.0 * jnp.pi * self.clock_rate * s.time)
        dither = self.dither * jnp.tanh(4.0 * jnp.sin(2.0 * jnp.pi * self.dither_rate * s.time))
        return clock + dither + self.ground_step * 0.5 * (1.0 + jnp.tanh((s.time - self.step_time) / 2e-3))

    def mover_force(self, s, z):
        angle = 2.0 * jnp.pi * self.tremor_rate * s.time + self.tremor_phase
        tremor = jnp.sin(angle) + jnp.sin(2.48 * angle) + jnp.sin(4.16 * angle)
        screw = jnp.exp(-jnp.square((s.piston_position - self.screw_position) / 0.25e-3))
        puddle = (s.piston_velocity / 0.2) * jnp.square(s.piston_velocity / 0.2)
        slow = self.floor_tremor * tremor + self.settling_bench * s.time / 0.4
        return slow + self.passing_screw * screw - self.oil_puddle * puddle

    def force_constant_factor(self, s, z):
        return 1.0 - self.warm_field * z.loaded

    def rates(self, s, z):
        return {"loaded": (jnp.square(s.current / 5.0) - z.loaded) / 0.03}


class TuningPumpDisturbances(Effect):
    """Small effects of oil, gaps and valves that the library lacks; one parameter sets the size of each."""

    bubble_train: float = size_par("-", "relative change of the compressibility as bubbles pass")
    bubble_rate: float = shape_par(4.0, "Hz", "their frequency", (2.5, 9.0))
    singing_valve: float = size_par("-", "relative oscillation of the flow area of the suction valves")
    singing_rate: float = shape_par(140.0, "Hz", "its frequency", (110.0, 230.0))
    tight_spring: float = size_par("N", "additional preload of delivery valve B")
    loose_plug: float = size_par("m^3/s", "twice the leakage past a loose plug of chamber B at 0.5 MPa gauge")
    conical_bore: float = size_par("-", "relative change of the viscosity in a conical gap along the stroke")

    def oil_compressibility(self, s, z):
        return self.bubble_train * jnp.sin(2.0 * jnp.pi * self.bubble_rate * s.time) / s.oil_bulk_modulus

    def suction_valve_area(self, s, z):
        return self.singing_valve * s.valve_area * jnp.sin(2.0 * jnp.pi * self.singing_rate * s.time)

    def check_valve_force(self, s, z):
        return -self.tight_spring + 0.0 * s.lift if valve_of(s) == "delivery_b" else 0.0 * s.lift

    def chamber_leakage(self, s, z):
        over = (s.chamber_pressure - s.atmospheric_pressure) / 0.5e6
        return self.loose_plug * over * jnp.abs(over) / (1.0 + jnp.abs(over)) if is_chamber_b(s) else 0.0 * over

    def gap_viscosity_factor(self, s, z):
        return 1.0 + self.conical_bore * jnp.tanh(s.piston_position / (0.5 * REFERENCE_TRAVEL))


DISTURBANCES = (
    Disturbance(TuningDisturbances, "floor_tremor", 0.05, ("tremor_rate", "tremor_phase")),
    Disturbance(TuningDisturbances, "settling_bench", 0.1),
    Disturbance(TuningDisturbances, "oil_puddle", 0.1),
    Disturbance(TuningDisturbances, "passing_screw", 0.1, ("screw_position",)),
    Disturbance(TuningDisturbances, "clock_leak", 0.02, ("clock_rate",)),
    Disturbance(TuningDisturbances, "dither", 0.2, ("dither_rate",)),
    Disturbance(TuningDisturbances, "ground_step", 0.05, ("step_time",)),
    Disturbance(TuningDisturbances, "warm_field", 0.01),
    Disturbance(TuningPumpDisturbances, "bubble_train", 0.1, ("bubble_rate",)),
    Disturbance(TuningPumpDisturbances, "singing_valve", 0.05, ("singing_rate",)),
    Disturbance(TuningPumpDisturbances, "tight_spring", 0.02),
    Disturbance(TuningPumpDisturbances, "loose_plug", 5e-9),
    Disturbance(TuningPumpDisturbances, "conical_bore", 0.05),
)
