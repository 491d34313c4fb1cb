"""Effects of a user, each wrong in one way (but the first)."""

import math

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax import Effect, state
from edhas_jax import par

NotAnEffect = dict


def helper(x):
    raise ValueError("the table of the seal is empty")


class Good(Effect):
    seal_force: float = par(3.0, "N", (0.0, 100.0), "force of the seal")

    def mover_friction(self, s, z):
        return self.seal_force * jnp.tanh(s.piston_velocity / 1e-3)


class UnknownSignal(Effect):
    def mover_friction(self, s, z):
        return 2.0 * s.piston_speed


class OilSignal(Effect):
    def mover_friction(self, s, z):
        return s.viscosity * s.piston_velocity


class IfOnValue(Effect):
    def mover_friction(self, s, z):
        if s.piston_velocity > 0:
            return 3.0
        return -3.0


class NumpyFunction(Effect):
    def mover_friction(self, s, z):
        return np.tanh(s.piston_velocity)


class MathFunction(Effect):
    def mover_friction(self, s, z):
        return math.tanh(s.piston_velocity)


class Crash(Effect):
    def mover_friction(self, s, z):
        return helper(s.piston_velocity)


class ReturnsNothing(Effect):
    def mover_friction(self, s, z):
        2.0 * s.piston_velocity


class ReturnsInteger(Effect):
    def mover_friction(self, s, z):
        return jnp.sign(s.piston_velocity).astype(int)


class ReturnsTuple(Effect):
    def coil_resistance_factor(self, s, z):
        return 1.0, 2.0


class ReturnsArray(Effect):
    def mover_friction(self, s, z):
        return jnp.stack([s.piston_velocity, s.current])


class ForcedPrecision(Effect):
    def mover_friction(self, s, z):
        return np.sqrt(2.0) * s.piston_velocity


class ReturnsComplex(Effect):
    def mover_friction(self, s, z):
        return jax.lax.complex(s.piston_velocity, s.current)


class UnknownRate(Effect):
    bend = state("m", "bending of the lip")

    def mover_friction(self, s, z):
        return 1e4 * z.bend

    def rates(self, s, z):
        return {"bending": s.piston_velocity}


class MissingRate(Effect):
    bend = state("m", "bending of the lip")
    heat = state("K", "warming of the lip")

    def mover_friction(self, s, z):
        return 1e4 * z.bend

    def rates(self, s, z):
        return {"bend": s.piston_velocity}


class RatesNoDict(Effect):
    bend = state("m", "bending of the lip")

    def mover_friction(self, s, z):
        return 1e4 * z.bend

    def rates(self, s, z):
        return s.piston_velocity


class UnknownState(Effect):
    bend = state("m", "bending of the lip")

    def mover_friction(self, s, z):
        return 1e4 * z.bending

    def rates(self, s, z):
        return {"bend": s.piston_velocity}


class NoPar(Effect):
    seal_force: float = 3.0

    def mover_friction(self, s, z):
        return self.seal_force


class SpanWrong(Effect):
    seal_force: float = par(3.0, "N", 100.0, "force of the seal")

    def mover_friction(self, s, z):
        return self.seal_force


class DefaultOutside(Effect):
    seal_force: float = par(300.0, "N", (0.0, 100.0), "force of the seal")

    def mover_friction(self, s, z):
        return self.seal_force


class UnitWrong(Effect):
    seal_force: float = par(3.0, "Newton-ish", (0.0, 100.0), "force of the seal")

    def mover_friction(self, s, z):
        return self.seal_force


class WrongSignature(Effect):
    def mover_friction(self, s):
        return s.piston_velocity


class BadId(Effect):
    id = "seal drag"

    def mover_friction(self, s, z):
        return s.piston_velocity


class TakenId(Effect):
    id = "coil"

    def mover_friction(self, s, z):
        return s.piston_velocity


class LocalSignal(Effect):
    def mover_friction(self, s, z):
        return s.lift * 1e3


class LateSignal(Effect):
    def coil_voltage_change(self, s, z):
        return 0.1 * s.friction_force
