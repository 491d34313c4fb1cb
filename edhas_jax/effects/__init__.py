"""The library of physical effects: one small class each, all alike, each removable."""

from edhas_jax.effects.base import Effect, EffectError, state
from edhas_jax.effects.entrained_air import EntrainedAir
from edhas_jax.effects.karnopp_friction import KarnoppFriction
from edhas_jax.effects.lugre_friction import LugreFriction
from edhas_jax.effects.piston_leakage import PistonLeakage

LIBRARY: tuple[type[Effect], ...] = (LugreFriction, PistonLeakage, EntrainedAir, KarnoppFriction)

__all__ = [
    "LIBRARY",
    "Effect",
    "EffectError",
    "EntrainedAir",
    "KarnoppFriction",
    "LugreFriction",
    "PistonLeakage",
    "state",
]
