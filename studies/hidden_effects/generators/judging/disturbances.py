"""Small disturbances, for the judging cases."""

import jax.numpy as jnp

from edhas_jax.machine.effects import Effect
from studies.hidden_effects.generators.disturbances import PHASE, Disturbance, shape_par, size_par
from studies.hidden_effects.generators.places import valve_of


def _turn(rate, s, phase=0.0):
    return jnp.sin(2.0 * jnp.pi * rate * s.time + phase)


def _pulse(s, start, width):
    return jnp.exp(-jnp.square((s.time - start) / width))


class JudgingDisturbances(Effect):
    """Small effects of coil, amplifier and mover that the library lacks; one parameter sets the size of each."""

    compressor: float = size_par("N", "force of a piston compressor beside the bench, at once and twice its speed")
    compressor_rate: float = shape_par(24.0, "Hz", "rotational frequency of the compressor", (19.0, 29.0))
    compressor_phase: float = shape_par(0.0, "rad", "its phase", PHASE)
    slammed_door: float = size_par("N", "force pulse from a slammed door, about 20 ms long")
    door_time: float = shape_par(0.1, "s", "time of the pulse", (0.06, 0.18))
    swinging_cable: float = size_par("N", "force of a swinging cable, which decays with a time constant of 0.25 s")
    swing_rate: float = shape_par(7.0, "Hz", "its frequency", (5.0, 13.0))
    guide_ledge: float = size_par("N", "step of the force at the joint between two parts of the guide")
    ledge_position: float = shape_par(0.5e-3, "m", "position of the joint", (-2e-3, 2e-3))
    scale_error: float = size_par("m", "periodic error of the position encoder, period 0.4 mm")
    scale_phase: float = shape_par(0.0, "rad", "its phase", PHASE)
    bridge_balance: float = size_par("-", "gain error of the amplifier, opposite for positive and negative voltage")
    start_offset: float = size_par("V", "offset of the amplifier that decays with a time constant of 60 ms")
    shared_supply: float = size_par("V", "voltage change as another load at the same supply switches on and off")
    sharing_rate: float = shape_par(11.0, "Hz", "switching frequency of that load", (8.0, 19.0))

    def coil_voltage_change(self, s, z):
        scale = jnp.sin(2.0 * jnp.pi * s.piston_position / 0.4e-3 + self.scale_phase)
        bridge = self.bridge_balance * jnp.sqrt(jnp.square(s.voltage) + 0.04)
        load = self.shared_supply * jnp.tanh(6.0 * _turn(self.sharing_rate, s))
        offset = self.start_offset * jnp.exp(-s.time / 0.06)
        return s.position_gain * self.scale_error * scale + bridge + load + offset

    def mover_force(self, s, z):
        turn = 2.0 * jnp.pi * self.compressor_rate * s.time + self.compressor_phase
        shaking = self.compressor * (jnp.sin(turn) + 0.5 * jnp.sin(2.0 * turn))
        swing = self.swinging_cable * jnp.exp(-s.time / 0.25) * _turn(self.swing_rate, s)
        ledge = self.guide_ledge * jnp.tanh((s.piston_position - self.ledge_position) / 0.15e-3)
        return shaking + swing + ledge + self.slammed_door * _pulse(s, self.door_time, 20e-3)


class JudgingPumpDisturbances(Effect):
    """Small effects of oil, gaps and valves that the library lacks; one parameter sets the size of each."""

    air_slug: float = size_par("-", "compressibility added while a slug of air passes, relative to the oil, at 0.2 MPa")
    slug_time: float = shape_par(0.12, "s", "time at which the slug passes", (0.06, 0.18))
    oil_streaks: float = size_par("-", "relative change of the viscosity as streaks of cold oil pass")
    streak_rate: float = shape_par(3.5, "Hz", "their frequency", (2.2, 7.0))
    odd_spring: float = size_par("N/m", "spring rate by which delivery valve A exceeds the other valves")
    odd_seat: float = size_par("-", "relative flow area by which suction valve B exceeds the other valves")
    case_whistle: float = size_par("m^3/s", "oscillating leakage of both chambers into the drain, at 0.5 MPa gauge")
    whistle_rate: float = shape_par(75.0, "Hz", "its frequency", (50.0, 105.0))
    buzzing_balls: float = size_par("N", "oscillating force of vortices on the valve balls, at 0.1 MPa pressure drop")
    buzz_rate: float = shape_par(190.0, "Hz", "its frequency", (130.0, 260.0))

    def oil_compressibility(self, s, z):
        return self.air_slug * _pulse(s, self.slug_time, 25e-3) * jnp.square(0.2e6 / s.pressure) / s.oil_bulk_modulus

    def oil_viscosity_factor(self, s, z):
        return 1.0 + self.oil_streaks * _turn(self.streak_rate, s)

    def check_valve_force(self, s, z):
        shaken = self.buzzing_balls * s.pressure_drop / 0.1e6 * _turn(self.buzz_rate, s)
        return shaken - self.odd_spring * s.lift if valve_of(s) == "delivery_a" else shaken

    def suction_valve_area(self, s, z):
        return self.odd_seat * s.valve_area if valve_of(s) == "suction_b" else 0.0 * s.valve_area

    def chamber_leakage(self, s, z):
        over = (s.chamber_pressure - s.atmospheric_pressure) / 0.5e6
        return self.case_whistle * over * _turn(self.whistle_rate, s)


DISTURBANCES = (
    Disturbance(JudgingDisturbances, "compressor", 0.1, ("compressor_rate", "compressor_phase")),
    Disturbance(JudgingDisturbances, "slammed_door", 0.2, ("door_time",)),
    Disturbance(JudgingDisturbances, "swinging_cable", 0.1, ("swing_rate",)),
    Disturbance(JudgingDisturbances, "guide_ledge", 0.1, ("ledge_position",)),
    Disturbance(JudgingDisturbances, "scale_error", 1e-6, ("scale_phase",)),
    Disturbance(JudgingDisturbances, "bridge_balance", 0.005),
    Disturbance(JudgingDisturbances, "start_offset", 0.1),
    Disturbance(JudgingDisturbances, "shared_supply", 0.05, ("sharing_rate",)),
    Disturbance(JudgingPumpDisturbances, "air_slug", 1.0, ("slug_time",)),
    Disturbance(JudgingPumpDisturbances, "oil_streaks", 0.03, ("streak_rate",)),
    Disturbance(JudgingPumpDisturbances, "odd_spring", 10.0),
    Disturbance(JudgingPumpDisturbances, "odd_seat", 0.05),
    Disturbance(JudgingPumpDisturbances, "case_whistle", 1e-8, ("whistle_rate",)),
    Disturbance(JudgingPumpDisturbances, "buzzing_balls", 0.02, ("buzz_rate",)),
)
