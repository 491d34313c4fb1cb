"""Laws of bias, asymmetric damping, and friction by direction, place or pressure, for the earlier judging set."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.effects.reference_scales import REFERENCE_TRAVEL, smooth_sign
from studies.hidden_effects.generators.functions import gauge_pressures
from studies.hidden_effects.generators.laws import Law


class SettlingBias(Effect):
    """A constant force that settles exponentially after the start: −F (1 − 0.6 exp(−t/0.15 s)), either sign.

    Source: magnetic after-effect of soft iron; the time is chosen.
    """

    iron_pull: float = par(1.0, "N", (-1e4, 1e4), "F", plausible=(-5.0, 5.0))

    def mover_force(self, s, z):
        return -self.iron_pull * (1.0 - 0.6 * jnp.exp(-s.time / 0.15))


class SidedBias(Effect):
    """The force of a weight on a cord over a worn pulley: −F (1 + 0.35 tanh(x/1.2 mm)), either sign.

    Source: statics; the change over the stroke is chosen.
    """

    iron_pull: float = par(1.0, "N", (-1e4, 1e4), "F", plausible=(-5.0, 5.0))

    def mover_force(self, s, z):
        return -self.iron_pull * (1.0 + 0.35 * jnp.tanh(s.piston_position / 1.2e-3))


class ForwardStribeckFriction(Effect):
    """Dry friction in the forward stroke that falls with speed: F_a max(th(v), 0) (0.4 + 0.6 exp(−v/40 mm/s)).

    Source: Stribeck, Z. VDI 46 (1902) 1341; Müller, Nau, Fluid Sealing Technology (1998) for lips.
    """

    lip_force: float = par(2.0, "N", (0.0, 1e4), "F_a", plausible=(0.4, 8.0))

    def mover_friction(self, s, z):
        v = s.sliding_velocity
        fall = 0.4 + 0.6 * jnp.exp(-jnp.maximum(v, 0.0) / 0.04)
        return self.lip_force * jnp.maximum(smooth_sign(v), 0.0) * fall


class ForwardRisingFriction(Effect):
    """Friction in the forward stroke that grows with speed and saturates: F_a v/(v + 30 mm/s) for v > 0.

    Source: chosen; a lip that is dragged along before it slides.
    """

    lip_force: float = par(1.5, "N", (0.0, 1e4), "F_a", plausible=(0.3, 5.0))

    def mover_friction(self, s, z):
        v = jnp.maximum(s.sliding_velocity, 0.0)
        return self.lip_force * v / (v + 0.03)


class RoundedAsymmetricDamping(Effect):
    """Viscous friction that differs between the directions at high speed only: −c (√(v² + v_0²) − v_0), v_0 = 0.1 m/s.

    Source: chosen; a guide whose film carries at speed only.
    """

    guide_difference: float = par(5.0, "N*s/m", (-1e4, 1e4), "c", plausible=(-60.0, 60.0))

    def mover_force(self, s, z):
        return -self.guide_difference * (jnp.sqrt(jnp.square(s.piston_velocity) + 0.01) - 0.1)


class RootAsymmetricDamping(Effect):
    """Drag that differs between the directions with the power 1.5 of speed: −c |v|^1.5/√(0.2 m/s).

    Source: boundary-layer drag ∝ v^1.5 (Blasius 1908) on a body that is not symmetric.
    """

    guide_difference: float = par(5.0, "N*s/m", (-1e4, 1e4), "c", plausible=(-60.0, 60.0))

    def mover_force(self, s, z):
        v = jnp.abs(s.piston_velocity)
        return -self.guide_difference * v * jnp.sqrt((v + 1e-6) / 0.2)


class QuarticEndFriction(Effect):
    """Dry friction near the ends of the stroke: F_s (x/x_m)⁴ th(v).

    Source: chosen; a bore that is narrow at its ends.
    """

    bore_friction: float = par(4.0, "N", (0.0, 1e4), "F_s", plausible=(0.8, 20.0))

    def mover_friction(self, s, z):
        u = jnp.square(s.sliding_position / REFERENCE_TRAVEL)
        return self.bore_friction * u * u * smooth_sign(s.sliding_velocity)


class OneEndFriction(Effect):
    """Dry friction that grows towards one end: F_s max(x, 0)/x_m th(v).

    Source: chosen; a guide that is out of line at one end.
    """

    bore_friction: float = par(3.0, "N", (0.0, 1e4), "F_s", plausible=(0.6, 12.0))

    def mover_friction(self, s, z):
        u = jnp.maximum(s.sliding_position, 0.0) / REFERENCE_TRAVEL
        return self.bore_friction * u * smooth_sign(s.sliding_velocity)


class SaturatingSealFriction(Effect):
    """Seal friction that saturates with pressure: μ S_p Σ p/(1 + p/0.3 MPa) th(v).

    Source: U-cups, whose lip is fully pressed on above some pressure; the form is chosen.
    """

    cup_friction: float = par(0.04, "-", (0.0, 10.0), "μ", plausible=(0.008, 0.3))

    def mover_friction(self, s, z):
        a, b = (p / (1.0 + p / 0.3e6) for p in gauge_pressures(s))
        return self.cup_friction * s.piston_area * (a + b) * smooth_sign(s.sliding_velocity)


class DifferenceSealFriction(Effect):
    """Seal friction in proportion to the pressure difference of the chambers: μ S_p |p_A − p_B| th(v).

    Source: one seal between both chambers, which the difference of pressure presses on; statics.
    """

    cup_friction: float = par(0.03, "-", (0.0, 10.0), "μ", plausible=(0.005, 0.2))

    def mover_friction(self, s, z):
        difference = jnp.abs(s.chamber_pressure_a - s.chamber_pressure_b)
        return self.cup_friction * s.piston_area * difference * smooth_sign(s.sliding_velocity)


LAWS = (
    Law(library.ConstantBiasForce, SettlingBias), Law(library.ConstantBiasForce, SidedBias),
    Law(library.AsymmetricFriction, ForwardStribeckFriction), Law(library.AsymmetricFriction, ForwardRisingFriction),
    Law(library.AsymmetricDamping, RoundedAsymmetricDamping), Law(library.AsymmetricDamping, RootAsymmetricDamping),
    Law(library.StrokeDependentFriction, QuarticEndFriction), Law(library.StrokeDependentFriction, OneEndFriction),
    Law(library.SealFriction, SaturatingSealFriction), Law(library.SealFriction, DifferenceSealFriction),
)  # fmt: skip
