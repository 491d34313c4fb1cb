"""Laws at the mover, for the earlier judging set."""

import math

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect, state
from edhas_jax.machine.effects.reference_scales import REFERENCE_TRAVEL
from studies.hidden_effects.generators.functions import arctan
from studies.hidden_effects.generators.laws import Law


class TustinFriction(Effect):
    """Stribeck friction with an exponential fall: (F_C + ΔF exp(−|v|/v_S)) tanh(v/3 mm/s) + c v.

    Source: Tustin, J. IEE 94 (1947) 143; Bo, Pavelescu, Wear 82 (1982) 277.
    """

    tustin_level: float = par(4.0, "N", (0.0, 1e4), "F_C", plausible=(2.0, 10.0))
    tustin_excess: float = par(2.0, "N", (0.0, 1e4), "ΔF", plausible=(1.0, 4.0))
    tustin_velocity: float = par(0.02, "m/s", (1e-5, 1.0), "v_S", plausible=(0.01, 0.05))
    tustin_viscous: float = par(2.0, "N*s/m", (0.0, 1e4), "c", plausible=(1.0, 5.0))

    def mover_friction(self, s, z):
        v = s.sliding_velocity
        level = self.tustin_level + self.tustin_excess * jnp.exp(-jnp.abs(v) / self.tustin_velocity)
        return level * jnp.tanh(v / 3e-3) + self.tustin_viscous * v


class LorentzianFriction(Effect):
    """Stribeck friction with a rational fall: (F_C + ΔF/(1 + (v/v_S)²)) (2/π) atan(v/1 mm/s) + c v.

    Source: Hess, Soom, J. Tribology 112 (1990) 147.
    """

    lorentz_level: float = par(4.0, "N", (0.0, 1e4), "F_C", plausible=(2.0, 10.0))
    lorentz_excess: float = par(2.0, "N", (0.0, 1e4), "ΔF", plausible=(1.0, 4.0))
    lorentz_velocity: float = par(0.02, "m/s", (1e-5, 1.0), "v_S", plausible=(0.01, 0.05))
    lorentz_viscous: float = par(2.0, "N*s/m", (0.0, 1e4), "c", plausible=(1.0, 5.0))

    def mover_friction(self, s, z):
        v = s.sliding_velocity
        level = self.lorentz_level + self.lorentz_excess / (1.0 + jnp.square(v / self.lorentz_velocity))
        return level * (2.0 / math.pi) * arctan(v / 1e-3) + self.lorentz_viscous * v


class TwoElementFriction(Effect):
    """Two elastic elements that yield one after the other, each dF/dt = k v (1 − ((F sgn v)/F_y)³) while it loads.

    Source: Iwan, J. Applied Mechanics 33 (1966) 893; Lampaert, Al-Bender, Swevers, Proc. Physcon (2003) 1209.
    """

    yield_level: float = par(4.0, "N", (1e-6, 1e4), "sum of both yield forces", plausible=(2.0, 10.0))

    soft_force = state("N", "force of the softer element")
    stiff_force = state("N", "force of the stiffer element")

    def mover_friction(self, s, z):
        return z.soft_force + z.stiff_force

    def rates(self, s, z):
        v, out = s.sliding_velocity, {}
        for name, stiffness, share in (("soft_force", 1e4, 0.4), ("stiff_force", 8e4, 0.6)):
            ratio = getattr(z, name) / (share * self.yield_level)
            out[name] = stiffness * (v - jnp.abs(v) * ratio * ratio * ratio)
        return out


class MagnetEdgeCogging(Effect):
    """A pulse of force at each edge of a magnet: −A Σ (±) exp(−((x − x_k)/w)²), edges a pitch apart.

    Source: detent forces of slotless motors, which act where a magnet passes an end of the iron; the shape is chosen.
    """

    pulse_force: float = par(1.5, "N", (0.0, 1e4), "A", plausible=(0.3, 5.0))
    pulse_distance: float = par(4e-3, "m", (1e-4, 1.0), "distance of two edges", plausible=(2e-3, 5e-3))
    pulse_centre: float = par(0.0, "m", (-1.0, 1.0), "position of the middle edge", plausible=(-1.5e-3, 1.5e-3))
    pulse_width: float = par(0.7e-3, "m", (1e-5, 1.0), "w", plausible=(0.4e-3, 1e-3))

    def mover_force(self, s, z):
        out = 0.0
        for k, sign in ((-1.0, -1.0), (0.0, 1.0), (1.0, -1.0)):
            u = (s.piston_position - self.pulse_centre - k * self.pulse_distance) / self.pulse_width
            out = out - sign * self.pulse_force * jnp.exp(-jnp.square(u))
        return out


class EndWeightedCogging(Effect):
    """Cogging that grows towards the ends of the stroke: −A (0.3 + (x/x_m)²) sin u.

    Source: finite length of the stator; Inoue, Sato, IEEE Trans. Magn. 36 (2000) 1890.
    """

    ripple_force: float = par(2.0, "N", (0.0, 1e4), "A", plausible=(0.4, 10.0))
    ripple_pitch: float = par(5e-3, "m", (1e-5, 1.0), "pitch", plausible=(2.5e-3, 9e-3))
    ripple_phase: float = par(0.0, "rad", (-7.0, 7.0), "phase", plausible=(-math.pi, math.pi))

    def mover_force(self, s, z):
        x = s.piston_position
        envelope = 0.3 + jnp.square(x / REFERENCE_TRAVEL)
        return -self.ripple_force * envelope * jnp.sin(2.0 * jnp.pi * x / self.ripple_pitch + self.ripple_phase)


class SkinEddyDrag(Effect):
    """Eddy drag of a thick conductor, in proportion to the root of speed: −c v/√(|v|/0.1 m/s), linear below 2 mm/s.

    Source: skin depth ∝ 1/√v, which the currents do not exceed.
    """

    skin_drag: float = par(6.0, "N*s/m", (0.0, 1e4), "c", plausible=(0.6, 25.0))

    def mover_force(self, s, z):
        u = s.piston_velocity / 0.1
        return -self.skin_drag * s.piston_velocity * (jnp.square(u) + 4e-4) ** -0.25


class ThinSheetDrag(Effect):
    """Eddy drag of a thin sheet in a local field: −c v exp(−(x/3 mm)²)/√(1 + (v/v_e)²).

    Source: Saslow, Am. J. Phys. 60 (1992) 693, for the thin sheet; the bell shape of the field is chosen.
    """

    drag_slope: float = par(10.0, "N*s/m", (0.0, 1e4), "c", plausible=(2.0, 60.0))
    drag_speed: float = par(0.2, "m/s", (1e-3, 1e3), "v_e", plausible=(0.05, 0.4))

    def mover_force(self, s, z):
        v, field = s.piston_velocity, jnp.exp(-jnp.square(s.piston_position / 3e-3))
        return -self.drag_slope * v * field / jnp.sqrt(1.0 + jnp.square(v / self.drag_speed))


class SofteningSpring(Effect):
    """A spring whose stiffness falls with its deflection: −k x/(1 + |x|/2 mm).

    Source: rubber mounts, whose stiffness falls with amplitude; Payne, J. Applied Polymer Science 6 (1962) 57.
    """

    mount_stiffness: float = par(500.0, "N/m", (0.0, 1e8), "k", plausible=(100.0, 8000.0))

    def mover_force(self, s, z):
        return -self.mount_stiffness * s.piston_position / (1.0 + jnp.abs(s.piston_position) / 2e-3)


class RelaxingSpring(Effect):
    """A spring in parallel with a spring and damper in series: −k x − k/2 (x − x_r), dx_r/dt = (x − x_r)/τ.

    Source: standard linear solid (Zener, Elasticity and Anelasticity of Metals, 1948).
    """

    mount_stiffness: float = par(500.0, "N/m", (0.0, 1e8), "k", plausible=(50.0, 5000.0))
    relaxation_time: float = par(0.01, "s", (1e-4, 10.0), "τ", plausible=(3e-3, 0.05))

    relaxed = state("m", "position at which the relaxing part is free of force")

    def mover_force(self, s, z):
        x = s.piston_position
        return -self.mount_stiffness * (x + 0.5 * (x - z.relaxed))

    def rates(self, s, z):
        return {"relaxed": (s.piston_position - z.relaxed) / self.relaxation_time}


LAWS = (
    Law(library.LugreFriction, TustinFriction), Law(library.LugreFriction, LorentzianFriction),
    Law(library.LugreFriction, TwoElementFriction),
    Law(library.CoggingForce, MagnetEdgeCogging), Law(library.CoggingForce, EndWeightedCogging),
    Law(library.EddyDrag, SkinEddyDrag), Law(library.EddyDrag, ThinSheetDrag),
    Law(library.ParasiticSpring, SofteningSpring), Law(library.ParasiticSpring, RelaxingSpring),
)  # fmt: skip
