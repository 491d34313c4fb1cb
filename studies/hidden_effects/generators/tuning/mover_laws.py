"""Laws at the mover, for tuning."""

import math

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect, state
from edhas_jax.machine.effects.reference_scales import REFERENCE_TRAVEL, smooth_sign
from studies.hidden_effects.generators.functions import gauge_pressures, triangle
from studies.hidden_effects.generators.laws import Law


class StaticSlidingFriction(Effect):
    """Coulomb, viscous and quadratic friction without bristles: F_C tanh(v/4 mm/s) + c v + q v |v|.

    Source: Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083, static friction models.
    """

    sliding_level: float = par(4.0, "N", (0.0, 1e4), "F_C", plausible=(2.0, 10.0))
    linear_part: float = par(2.0, "N*s/m", (0.0, 1e4), "c", plausible=(1.0, 5.0))
    quadratic_part: float = par(5.0, "N*s^2/m^2", (0.0, 1e4), "q", plausible=(1.0, 20.0))

    def mover_friction(self, s, z):
        v = s.sliding_velocity
        return self.sliding_level * jnp.tanh(v / 4e-3) + self.linear_part * v + self.quadratic_part * v * jnp.abs(v)


class SlowYieldFriction(Effect):
    """Dahl's friction with the exponent 2: dF/dt = σ v (1 − r)², r = (F/F_C) sgn v, a slow approach to F_C.

    Source: Dahl, Aerospace Corporation TOR-158(3107-18) (1968); AIAA J. 14 (1976) 1675.
    """

    dahl_level: float = par(4.0, "N", (1e-6, 1e4), "F_C", plausible=(2.0, 10.0))
    dahl_stiffness: float = par(1e4, "N/m", (1.0, 1e9), "σ", plausible=(4e3, 4e4))

    force = state("N", "friction force")

    def mover_friction(self, s, z):
        return z.force

    def rates(self, s, z):
        v = s.sliding_velocity
        left = 1.0 - z.force / self.dahl_level * jnp.where(v < 0.0, -1.0, 1.0)
        return {"force": self.dahl_stiffness * v * left * jnp.abs(left)}


class TriangularCogging(Effect):
    """Cogging as a triangle wave over the position.

    Source: the simplest form of an attraction that is constant between the positions of rest of wide teeth; chosen.
    """

    cogging_size: float = par(1.0, "N", (0.0, 1e4), "amplitude", plausible=(0.2, 5.0))
    cogging_length: float = par(6e-3, "m", (1e-5, 1.0), "pitch", plausible=(3e-3, 14e-3))
    cogging_shift: float = par(0.0, "rad", (-7.0, 7.0), "phase", plausible=(-math.pi, math.pi))

    def mover_force(self, s, z):
        return -self.cogging_size * triangle(
            2.0 * jnp.pi * s.piston_position / self.cogging_length + self.cogging_shift
        )


class TwoHarmonicCogging(Effect):
    """Cogging with its second harmonic: −A (sin u + 0.5 sin(2 u + ψ)).

    Source: Fourier series of cogging forces; Gieras, Piech, Tomczuk, Linear Synchronous Motors (2011).
    """

    cogging_size: float = par(1.0, "N", (0.0, 1e4), "A", plausible=(0.2, 5.0))
    cogging_length: float = par(6e-3, "m", (1e-5, 1.0), "pitch", plausible=(4e-3, 16e-3))
    cogging_shift: float = par(0.0, "rad", (-7.0, 7.0), "phase", plausible=(-math.pi, math.pi))
    harmonic_shift: float = par(0.0, "rad", (-7.0, 7.0), "ψ", plausible=(-math.pi, math.pi))

    def mover_force(self, s, z):
        u = 2.0 * jnp.pi * s.piston_position / self.cogging_length + self.cogging_shift
        return -self.cogging_size * (jnp.sin(u) + 0.5 * jnp.sin(2.0 * u + self.harmonic_shift))


class RationalEddyDrag(Effect):
    """Eddy drag that falls slowly beyond its largest value: −c v/(1 + |v|/v_e)², largest at v_e.

    Source: fitted forms of eddy-current brakes, Simeu, Georges, Control Eng. Practice 4 (1996) 19.
    """

    eddy_size: float = par(10.0, "N*s/m", (0.0, 1e4), "c", plausible=(1.0, 40.0))
    eddy_speed: float = par(0.2, "m/s", (1e-3, 1e3), "v_e", plausible=(0.05, 0.5))

    def mover_force(self, s, z):
        v = s.piston_velocity
        return -self.eddy_size * v / jnp.square(1.0 + jnp.abs(v) / self.eddy_speed)


class ExponentialEddyDrag(Effect):
    """Eddy drag that saturates: −c v_e (1 − exp(−|v|/v_e)) sgn v.

    Source: an empirical saturation curve, as for drag torques of clutches and brakes.
    """

    eddy_size: float = par(10.0, "N*s/m", (0.0, 1e4), "c", plausible=(1.0, 40.0))
    eddy_speed: float = par(0.2, "m/s", (1e-3, 1e3), "v_e", plausible=(0.05, 0.5))

    def mover_force(self, s, z):
        v = s.piston_velocity
        u = jnp.abs(v) / self.eddy_speed
        return -self.eddy_size * self.eddy_speed * (1.0 - jnp.exp(-u)) * jnp.where(v < 0.0, -1.0, 1.0)


class HardeningSpring(Effect):
    """A spring that hardens: −k x (1 + (x/3 mm)²).

    Source: Duffing, Erzwungene Schwingungen bei veränderlicher Eigenfrequenz (1918).
    """

    spring_size: float = par(500.0, "N/m", (0.0, 1e8), "k", plausible=(50.0, 3000.0))

    def mover_force(self, s, z):
        x = s.piston_position
        return -self.spring_size * x * (1.0 + jnp.square(x / 3e-3))


class TrailingBias(Effect):
    """A magnet's pull that falls along the stroke: −F (1 − 0.4 x/x_m), either sign.

    Source: force of a magnet over a small change of its gap, first terms of 1/(g + x)².
    """

    bias_size: float = par(1.0, "N", (-1e4, 1e4), "F", plausible=(-5.0, 5.0))

    def mover_force(self, s, z):
        return -self.bias_size * (1.0 - 0.4 * s.piston_position / REFERENCE_TRAVEL)


class ForwardHardFriction(Effect):
    """Dry friction in the forward stroke only, which sets in at once: F_a max(tanh(v/1 mm/s), 0) (1 + v/0.3 m/s).

    Source: lip seals, whose lip digs in when it moves against the film; Müller, Nau, Fluid Sealing Technology (1998).
    """

    forward_size: float = par(1.5, "N", (0.0, 1e4), "F_a", plausible=(0.3, 5.0))

    def mover_friction(self, s, z):
        v = s.sliding_velocity
        return self.forward_size * jnp.maximum(jnp.tanh(v / 1e-3), 0.0) * (1.0 + v / 0.3)


class QuadraticAsymmetricDamping(Effect):
    """Drag that differs between the directions with the square of speed: −c v²/0.2 m/s, either sign.

    Source: flow drag in a passage that has another loss coefficient in each direction; Idelchik, Handbook of
    Hydraulic Resistance.
    """

    asymmetry_size: float = par(5.0, "N*s/m", (-1e4, 1e4), "c", plausible=(-60.0, 60.0))

    def mover_force(self, s, z):
        return -self.asymmetry_size * jnp.square(s.piston_velocity) / 0.2


class LinearEndFriction(Effect):
    """Dry friction in proportion to the distance from mid-stroke: F_s |x|/x_m th(v).

    Source: friction of a tilted guide under a side load that grows with the overhang.
    """

    end_size: float = par(3.0, "N", (0.0, 1e4), "F_s", plausible=(0.5, 10.0))

    def mover_friction(self, s, z):
        return self.end_size * jnp.abs(s.sliding_position) / REFERENCE_TRAVEL * smooth_sign(s.sliding_velocity)


class RootSealFriction(Effect):
    """Seal friction in proportion to the root of the pressure: μ S_p (√(p_A p_1) + √(p_B p_1)) th(v), p_1 = 0.5 MPa.

    Source: contact width of O-rings that grows less than the pressure; Müller, Nau (1998).
    """

    seal_size: float = par(0.03, "-", (0.0, 10.0), "μ", plausible=(0.005, 0.2))

    def mover_friction(self, s, z):
        a, b = (jnp.sqrt(5e5 * (p + 1.0)) for p in gauge_pressures(s))
        return self.seal_size * s.piston_area * (a + b) * smooth_sign(s.sliding_velocity)


LAWS = (
    Law(library.LugreFriction, StaticSlidingFriction), Law(library.LugreFriction, SlowYieldFriction),
    Law(library.CoggingForce, TriangularCogging), Law(library.CoggingForce, TwoHarmonicCogging),
    Law(library.EddyDrag, RationalEddyDrag), Law(library.EddyDrag, ExponentialEddyDrag),
    Law(library.ParasiticSpring, HardeningSpring), Law(library.ConstantBiasForce, TrailingBias),
    Law(library.AsymmetricFriction, ForwardHardFriction), Law(library.AsymmetricDamping, QuadraticAsymmetricDamping),
    Law(library.StrokeDependentFriction, LinearEndFriction), Law(library.SealFriction, RootSealFriction),
)  # fmt: skip
