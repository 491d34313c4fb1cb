"""Small disturbances, for judging."""

import jax.numpy as jnp

from edhas_jax.machine.effects import Effect, state
from studies.hidden_effects.generators.disturbances import PHASE, Disturbance, shape_par, size_par
from studies.hidden_effects.generators.places import valve_of

MAINS = 50.0  # Hz
SHOCK_FREQUENCY = 55.0  # Hz, at which the floor rings


class JudgingDisturbances(Effect):
    """Small disturbances of coil, amplifier and mover, each with one size.

    Source: interpolation errors of encoders: Heydemann, Appl. Opt. 20 (1981) 3382; supply rejection, compression and
    soft start of amplifiers: Self, Audio Power Amplifier Design (2013); drag of air with the square of speed: Hoerner,
    Fluid-Dynamic Drag (1965); Coulomb's law for the side pull of a coil off centre; damping by air that flows through
    a leak, of first order; the forms of shocks and grease are chosen.
    """

    encoder_error: float = size_par("m", "interpolation error of the encoder that gives the controller the position")
    encoder_period: float = shape_par(1e-3, "m", "its period", (0.5e-3, 1.6e-3))
    encoder_phase: float = shape_par(0.0, "rad", "its phase", PHASE)
    supply_rejection: float = size_par("-", "relative ripple of the amplifier's gain at twice the mains frequency")
    rejection_phase: float = shape_par(0.0, "rad", "its phase", PHASE)
    amplifier_compression: float = size_par("V", "loss of the amplifier at 10 V, with the cube of its voltage")
    soft_start: float = size_par("-", "relative lack of gain of the amplifier when it is switched on")
    soft_start_time: float = shape_par(0.06, "s", "time constant with which it vanishes", (0.02, 0.15))
    floor_shocks: float = size_par("N", "force of a press nearby, whose shocks let the floor ring")
    shock_rate: float = shape_par(7.0, "Hz", "strokes of the press per second", (5.0, 13.0))
    shock_phase: float = shape_par(0.0, "rad", "its phase", PHASE)
    windage: float = size_par("N", "drag of the air at 0.3 m/s, with the square of speed")
    stiff_grease: float = size_par("N*s/m", "further damping by grease until it has been worked")
    grease_time: float = shape_par(0.15, "s", "time constant with which it vanishes", (0.06, 0.4))
    side_pull: float = size_par("N", "dry friction of the guide at 5 A, in proportion to the current")
    trapped_air: float = size_par("N/m", "stiffness of the air behind the coil, which flows out through a leak")
    air_time: float = shape_par(3e-3, "s", "time constant of the leak", (1.5e-3, 5e-3))

    air_compression = state("m", "part of the motion that compresses the air")

    def coil_voltage_change(self, s, z):
        angle = 2.0 * jnp.pi * s.piston_position / self.encoder_period + self.encoder_phase
        misread = -s.position_gain * self.encoder_error * (jnp.sin(angle) - jnp.sin(self.encoder_phase))
        ripple = self.supply_rejection * jnp.sin(4.0 * jnp.pi * MAINS * s.time + self.rejection_phase)
        u = s.voltage / 10.0
        starting = self.soft_start * jnp.exp(-s.time / self.soft_start_time)
        return misread + (ripple - starting) * s.voltage - self.amplifier_compression * u * u * u

    def mover_force(self, s, z):
        turn = 2.0 * jnp.pi * self.shock_rate * s.time + self.shock_phase
        strokes = jnp.exp(6.0 * (jnp.cos(turn) - 1.0)) * jnp.sin(2.0 * jnp.pi * SHOCK_FREQUENCY * s.time)
        v = s.piston_velocity
        grease = self.stiff_grease * v * jnp.exp(-s.time / self.grease_time)
        pull = self.side_pull * jnp.abs(s.current) / 5.0 * jnp.tanh(v / 8e-3)
        air = self.trapped_air * z.air_compression
        return self.floor_shocks * strokes - self.windage * v * jnp.abs(v) / 0.09 - grease - pull - air

    def rates(self, s, z):
        return {"air_compression": s.piston_velocity - z.air_compression / self.air_time}


class JudgingPumpDisturbances(Effect):
    """Small disturbances of chambers and valves, each with one size.

    Source: elasticity of a container beside that of the oil: Merritt, Hydraulic Control Systems (1967); weight of the
    balls: statics; the others are differences between valves that are nominally equal, and the form of the flow past
    a moving ball is chosen.
    """

    worn_suction_seat: float = size_par("-", "relative excess of the area of suction valve B")
    gummed_valve: float = size_par("N*s/m", "damping of delivery valve B beyond that of the others")
    hanging_valves: float = size_par("N", "weight of the balls, which closes the suction valves and opens the others")
    elastic_bores: float = size_par("-", "compressibility by the walls of both chambers, over that of the oil")
    moving_ball: float = size_par("-", "relative loss of a valve's area while its ball moves away from the seat")

    def suction_valve_area(self, s, z):
        own = self.worn_suction_seat * s.valve_area if valve_of(s) == "suction_b" else 0.0 * s.valve_area
        return own - self._lost_area(s)

    def delivery_valve_area(self, s, z):
        return -self._lost_area(s)

    def _lost_area(self, s):
        return self.moving_ball * s.valve_area * jnp.tanh(s.lift_velocity / 0.05)

    def check_valve_force(self, s, z):
        valve = valve_of(s)
        own = -self.gummed_valve * s.lift_velocity if valve == "delivery_b" else 0.0 * s.lift_velocity
        return own + (-self.hanging_valves if valve.startswith("suction") else self.hanging_valves)

    def oil_compressibility(self, s, z):
        known = s.values()
        if not any(known["pressure"] is known[f"chamber_pressure_{side}"] for side in "ab"):
            return 0.0 * s.pressure
        return self.elastic_bores / s.oil_bulk_modulus + 0.0 * s.pressure


DISTURBANCES = (
    Disturbance(JudgingDisturbances, "encoder_error", 3e-6, ("encoder_period", "encoder_phase")),
    Disturbance(JudgingDisturbances, "supply_rejection", 0.01, ("rejection_phase",)),
    Disturbance(JudgingDisturbances, "amplifier_compression", 0.05),
    Disturbance(JudgingDisturbances, "soft_start", 0.02, ("soft_start_time",)),
    Disturbance(JudgingDisturbances, "floor_shocks", 0.2, ("shock_rate", "shock_phase")),
    Disturbance(JudgingDisturbances, "windage", 0.2),
    Disturbance(JudgingDisturbances, "stiff_grease", 1.0, ("grease_time",)),
    Disturbance(JudgingDisturbances, "side_pull", 0.15),
    Disturbance(JudgingDisturbances, "trapped_air", 100.0, ("air_time",)),
    Disturbance(JudgingPumpDisturbances, "worn_suction_seat", 0.02),
    Disturbance(JudgingPumpDisturbances, "gummed_valve", 0.1),
    Disturbance(JudgingPumpDisturbances, "hanging_valves", 0.02),
    Disturbance(JudgingPumpDisturbances, "elastic_bores", 0.05),
    Disturbance(JudgingPumpDisturbances, "moving_ball", 0.02),
)  # fmt: skip
