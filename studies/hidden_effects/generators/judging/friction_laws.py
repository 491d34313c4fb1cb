"""Laws of bias, friction that depends on direction, place or pressure, and asymmetric damping, for judging."""

import math

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect, state
from edhas_jax.machine.effects.reference_scales import REFERENCE_TRAVEL, smooth_sign
from studies.hidden_effects.generators.functions import gauge_pressures, smooth_positive
from studies.hidden_effects.generators.laws import Law


class LeverBias(Effect):
    """The force of a weight on a lever that turns with the mover: −F cos(x/4 mm), either sign.

    Source: statics of a lever on a drum of 4 mm radius, from which a band runs to the mover; level at mid-stroke.
    """

    lever_force: float = par(1.0, "N", (-1e4, 1e4), "F", plausible=(-5.0, 5.0))

    def mover_force(self, s, z):
        return -self.lever_force * jnp.cos(s.piston_position / 4e-3)


class PulleyBias(Effect):
    """The force of a weight on a cord that slides over a fixed pin: −F − 0.25 |F| th(v), either sign.

    Source: belt friction, Euler (1762) and Eytelwein (1808): the cord pulls more on one side of the pin; about 0.25 of
    the weight for half a turn at a coefficient of 0.08.
    """

    cord_force: float = par(1.0, "N", (-1e4, 1e4), "F", plausible=(-5.0, 5.0))

    def mover_force(self, s, z):
        return -self.cord_force - 0.25 * jnp.abs(self.cord_force) * smooth_sign(s.piston_velocity)


class SwingingBias(Effect):
    """The force of a weight that swings on its cord: −F (1 + 0.3 sin(2π 4 Hz t + φ)), either sign.

    Source: tension in the cord of a pendulum, which varies at twice its frequency; its size is chosen.
    """

    hanging_force: float = par(1.0, "N", (-1e4, 1e4), "F", plausible=(-5.0, 5.0))
    swing_phase: float = par(0.0, "rad", (-7.0, 7.0), "φ", plausible=(-math.pi, math.pi))

    def mover_force(self, s, z):
        return -self.hanging_force * (1.0 + 0.3 * jnp.sin(8.0 * jnp.pi * s.time + self.swing_phase))


class ElasticLipFriction(Effect):
    """Friction of a seal lip that deforms before it slides.

    dF/dt = (F_a/80 µm) v (1 − F/F_±), F_+ = F_a, F_− = −0.3 F_a

    Source: Dahl, AIAA J. 14 (1976) 1675, with one force in each direction, as of lip seals; the ratio is chosen.
    """

    bent_lip_force: float = par(2.0, "N", (0.0, 1e4), "F_a", plausible=(0.4, 8.0))

    lip_load = state("-", "friction force over F_a")

    def mover_friction(self, s, z):
        return self.bent_lip_force * z.lip_load

    def rates(self, s, z):
        v = s.sliding_velocity
        share_left = jnp.where(v > 0.0, 1.0 - z.lip_load, 1.0 + z.lip_load / 0.3)
        return {"lip_load": v / 80e-6 * share_left}


class LiftingLipFriction(Effect):
    """Friction of a seal lip in the forward stroke, which a film lifts off at speed.

    F_a (v/v_0) exp(1 − v/v_0) for v > 0, v_0 = 40 mm/s

    Source: hydrodynamic lubrication of lips; Müller, Nau, Fluid Sealing Technology (1998); the form is chosen.
    """

    lifting_lip_force: float = par(2.0, "N", (0.0, 1e4), "F_a, the largest", plausible=(0.4, 8.0))

    def mover_friction(self, s, z):
        u = jnp.maximum(s.sliding_velocity, 0.0) / 0.04
        return self.lifting_lip_force * u * jnp.exp(1.0 - u)


class WedgingFriction(Effect):
    """Dry friction in the forward stroke that grows with the position: F_a (1 + 0.7 x/x_m) max(th(v), 0), x_m = 5 mm.

    Source: the form is chosen; a wiper that is drawn into a narrowing gap in one direction only.
    """

    wiper_force: float = par(1.5, "N", (0.0, 1e4), "F_a", plausible=(0.3, 5.0))

    def mover_friction(self, s, z):
        growth = 1.0 + 0.7 * s.sliding_position / REFERENCE_TRAVEL
        return self.wiper_force * growth * jnp.maximum(smooth_sign(s.sliding_velocity), 0.0)


class ThinningAsymmetricDamping(Effect):
    """Viscous friction that differs between the directions, with a shear-thinning grease: −c |v|/(1 + |v|/0.1 m/s).

    Source: shear-thinning greases; Cross, J. Colloid Science 20 (1965) 417, with the exponent 1; the speed is chosen.
    """

    grease_difference: float = par(5.0, "N*s/m", (-1e4, 1e4), "c", plausible=(-60.0, 60.0))

    def mover_force(self, s, z):
        v = jnp.abs(s.piston_velocity)
        return -self.grease_difference * v / (1.0 + v / 0.1)


class SlopingAsymmetricDamping(Effect):
    """Viscous friction whose difference between the directions grows with the position: −c |v| (1 + 0.8 x/x_m).

    Source: the form is chosen; a guide that is worn at one end.
    """

    slope_difference: float = par(5.0, "N*s/m", (-1e4, 1e4), "c", plausible=(-60.0, 60.0))

    def mover_force(self, s, z):
        growth = 1.0 + 0.8 * s.piston_position / REFERENCE_TRAVEL
        return -self.slope_difference * jnp.abs(s.piston_velocity) * growth


class TippingAsymmetricDamping(Effect):
    """Viscous friction of a mover that tilts late after a reversal: −c v q, τ dq/dt = tanh(v/20 mm/s) − q.

    Source: the form is chosen; the squeeze film of the guide delays the tilt. After the delay the force is −c |v|.
    """

    tipping_difference: float = par(5.0, "N*s/m", (-1e4, 1e4), "c", plausible=(-60.0, 60.0))
    tipping_time: float = par(6e-3, "s", (1e-5, 1.0), "τ", plausible=(4e-3, 15e-3))

    tilt = state("-", "tilt over that of a long stroke forward")

    def mover_force(self, s, z):
        return -self.tipping_difference * s.piston_velocity * z.tilt

    def rates(self, s, z):
        return {"tilt": (jnp.tanh(s.piston_velocity / 0.02) - z.tilt) / self.tipping_time}


class WavyBoreFriction(Effect):
    """Dry friction that is periodic in the position: F_s (1 + sin(2π x/τ + φ))/2 th(v).

    Source: friction as a Fourier series over the position, Armstrong, Proc. IEEE ICRA (1988) 1210, its first term.
    """

    chatter_friction: float = par(3.0, "N", (0.0, 1e4), "F_s", plausible=(0.5, 12.0))
    chatter_pitch: float = par(4e-3, "m", (1e-5, 1.0), "τ", plausible=(2.5e-3, 6e-3))
    chatter_phase: float = par(0.0, "rad", (-7.0, 7.0), "φ", plausible=(-math.pi, math.pi))

    def mover_friction(self, s, z):
        angle = 2.0 * jnp.pi * s.sliding_position / self.chatter_pitch + self.chatter_phase
        return self.chatter_friction * 0.5 * (1.0 + jnp.sin(angle)) * smooth_sign(s.sliding_velocity)


class TightSpotFriction(Effect):
    """Additional dry friction near one position: F_s exp(−((x − x_0)/0.9 mm)²) th(v).

    Source: the form is chosen; a burr or a dent in the bore.
    """

    burr_friction: float = par(4.0, "N", (0.0, 1e4), "F_s", plausible=(0.8, 20.0))
    burr_position: float = par(1e-3, "m", (-1.0, 1.0), "x_0", plausible=(-2.5e-3, 2.5e-3))

    def mover_friction(self, s, z):
        u = (s.sliding_position - self.burr_position) / 0.9e-3
        return self.burr_friction * jnp.exp(-jnp.square(u)) * smooth_sign(s.sliding_velocity)


class TaperedBoreFriction(Effect):
    """Dry friction that grows exponentially along a narrowing bore: F_s exp(x/2.5 mm)/exp(2) th(v), F_s at 5 mm.

    Source: a press fit in a cone, whose pressure grows with the depth; the exponential form is chosen.
    """

    taper_friction: float = par(4.0, "N", (0.0, 1e4), "F_s", plausible=(0.8, 20.0))

    def mover_friction(self, s, z):
        growth = jnp.exp(s.sliding_position / 2.5e-3 - 2.0)
        return self.taper_friction * growth * smooth_sign(s.sliding_velocity)


class ThresholdSealFriction(Effect):
    """Seal friction above a threshold of pressure: μ S_p Σ max(p − 0.35 MPa, 0) th(v), rounded within 50 kPa.

    Source: stiff seals, which the pressure must bend before they seal; the form is chosen.
    """

    stiff_seal_friction: float = par(0.04, "-", (0.0, 10.0), "μ", plausible=(0.008, 0.3))

    def mover_friction(self, s, z):
        beyond = sum(smooth_positive(p - 0.35e6, 50e3) for p in gauge_pressures(s))
        return self.stiff_seal_friction * s.piston_area * beyond * smooth_sign(s.sliding_velocity)


class LubricatedSealFriction(Effect):
    """Seal friction that decreases with speed: μ S_p Σ p (0.25 + 0.75/(1 + (v/60 mm/s)²)) th(v).

    Source: mixed lubrication of seals, Müller, Nau, Fluid Sealing Technology (1998); rational fall after Hess, Soom.
    """

    mixed_seal_friction: float = par(0.05, "-", (0.0, 10.0), "μ", plausible=(0.008, 0.3))

    def mover_friction(self, s, z):
        v = s.sliding_velocity
        fall = 0.25 + 0.75 / (1.0 + jnp.square(v / 0.06))
        return self.mixed_seal_friction * s.piston_area * sum(gauge_pressures(s)) * fall * smooth_sign(v)


class SquaredSealFriction(Effect):
    """Seal friction in proportion to the square of the pressure: μ S_p Σ p²/0.5 MPa th(v).

    Source: seals whose contact becomes both wider and harder with the pressure; the form is chosen.
    """

    squeezed_seal_friction: float = par(0.03, "-", (0.0, 10.0), "μ", plausible=(0.003, 0.2))

    def mover_friction(self, s, z):
        squares = sum(jnp.square(p) for p in gauge_pressures(s)) / 0.5e6
        return self.squeezed_seal_friction * s.piston_area * squares * smooth_sign(s.sliding_velocity)


LAWS = (
    Law(library.ConstantBiasForce, LeverBias), Law(library.ConstantBiasForce, PulleyBias),
    Law(library.ConstantBiasForce, SwingingBias),
    Law(library.AsymmetricFriction, ElasticLipFriction), Law(library.AsymmetricFriction, LiftingLipFriction),
    Law(library.AsymmetricFriction, WedgingFriction),
    Law(library.AsymmetricDamping, ThinningAsymmetricDamping), Law(library.AsymmetricDamping, SlopingAsymmetricDamping),
    Law(library.AsymmetricDamping, TippingAsymmetricDamping),
    Law(library.StrokeDependentFriction, WavyBoreFriction), Law(library.StrokeDependentFriction, TightSpotFriction),
    Law(library.StrokeDependentFriction, TaperedBoreFriction),
    Law(library.SealFriction, ThresholdSealFriction), Law(library.SealFriction, LubricatedSealFriction),
    Law(library.SealFriction, SquaredSealFriction),
)  # fmt: skip
