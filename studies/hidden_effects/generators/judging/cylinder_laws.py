"""Laws of the cylinder and its load, for judging."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect, state
from studies.hidden_effects.generators.functions import smooth_positive
from studies.hidden_effects.generators.laws import Law

BRISTLE_STIFFNESS, BRISTLE_DAMPING = 3e5, 150.0  # N/m and N·s/m, of the seals of the cylinder


class LugreCylinderFriction(Effect):
    """LuGre friction of the cylinder: σ₀ z + σ₁ dz/dt, dz/dt = v − σ₀ |v| z/g, g = F (1 + 0.5 exp(−(v/12 mm/s)²)).

    σ₀ = 3e5 N/m and σ₁ = 150 N·s/m.

    Source: Canudas de Wit, Olsson, Åström, Lischinsky, IEEE Trans. Autom. Control 40 (1995) 419.
    """

    bristle_friction: float = par(12.0, "N", (1e-6, 1e5), "F", plausible=(0.4, 80.0))

    bristle = state("m", "deflection of the bristles")

    def _bristle_rate(self, s, z):
        v = s.cylinder_velocity
        level = self.bristle_friction * (1.0 + 0.5 * jnp.exp(-jnp.square(v / 12e-3)))
        return v - BRISTLE_STIFFNESS * jnp.abs(v) * z.bristle / level

    def cylinder_friction_force(self, s, z):
        force = BRISTLE_STIFFNESS * z.bristle + BRISTLE_DAMPING * self._bristle_rate(s, z)
        return force * (1.0 + s.cylinder_friction_level / self.bristle_friction)

    def rates(self, s, z):
        return {"bristle": self._bristle_rate(s, z)}


class MakkarCylinderFriction(Effect):
    """Friction of the cylinder as a sum of smooth steps: F (th(v/2 mm/s) + 0.6 (th(v/1 mm/s) − th(v/15 mm/s))).

    Source: Makkar, Dixon, Sawyer, Hu, Proc. IEEE/ASME Int. Conf. Advanced Intelligent Mechatronics (2005) 600.
    """

    stepped_friction: float = par(12.0, "N", (0.0, 1e5), "F", plausible=(0.4, 80.0))

    def cylinder_friction_force(self, s, z):
        v = s.cylinder_velocity
        rise = 0.6 * (jnp.tanh(v / 1e-3) - jnp.tanh(v / 15e-3))
        return (self.stepped_friction + s.cylinder_friction_level) * (jnp.tanh(v / 2e-3) + rise)


class UnevenCylinderFriction(Effect):
    """Dry friction that is larger while the cylinder moves out: F (u + 0.35 u²), u = v/√(v² + (1.5 mm/s)²).

    Source: lips of rod seals and wipers, which act in one direction; Müller, Nau (1998); the form is chosen.
    """

    wiper_friction: float = par(12.0, "N", (0.0, 1e5), "F", plausible=(0.4, 80.0))

    def cylinder_friction_force(self, s, z):
        v = s.cylinder_velocity
        u = v / jnp.sqrt(jnp.square(v) + 2.25e-6)
        return (self.wiper_friction + s.cylinder_friction_level) * u * (1.0 + 0.35 * u)


class BothRodSeals(Effect):
    """Cylinder friction that grows with the sum of the pressures of both sides: μ A (p_h + p_r), gauge.

    Source: a rod that passes through both ends, each with its seal; the proportion to pressure is that of O-rings.
    """

    pair_friction: float = par(0.02, "-", (0.0, 10.0), "μ", plausible=(0.004, 0.1))

    def cylinder_friction_level(self, s, z):
        gauge = [jnp.maximum(p - s.atmospheric_pressure, 0.0) for p in (s.head_pressure, s.rod_pressure)]
        return self.pair_friction * s.cylinder_area * (gauge[0] + gauge[1])


class PreloadedCylinderSeal(Effect):
    """Cylinder friction that depends on pressure above the preload of the seal only: μ A (u + √(u² + (20 kPa)²))/2.

    u = p_h − 0.35 MPa

    Source: interference fit of lips and O-rings; Müller, Nau, Fluid Sealing Technology (1998); the pressure is chosen.
    """

    excess_friction: float = par(0.04, "-", (0.0, 10.0), "μ", plausible=(0.008, 0.3))

    def cylinder_friction_level(self, s, z):
        return self.excess_friction * s.cylinder_area * smooth_positive(s.head_pressure - 0.35e6, 20e3)


class LateCylinderSeal(Effect):
    """Cylinder friction that follows the pressure with a first-order lag: μ A p_e, dp_e/dt = (p_h − p_atm − p_e)/τ.

    Source: viscoelastic seals, whose contact pressure follows that of the oil; the one time constant is chosen.
    """

    late_friction: float = par(0.02, "-", (0.0, 10.0), "μ", plausible=(0.004, 0.08))
    pressing_time: float = par(0.05, "s", (1e-4, 10.0), "τ", plausible=(0.02, 0.12))

    seal_pressure = state("Pa", "pressure above ambient that the seal feels", 1e5)

    def cylinder_friction_level(self, s, z):
        return self.late_friction * s.cylinder_area * jnp.maximum(z.seal_pressure, 0.0)

    def rates(self, s, z):
        gauge = s.head_pressure - s.atmospheric_pressure
        return {"seal_pressure": (gauge - z.seal_pressure) / self.pressing_time}


class GasLoadSpring(Effect):
    """A gas spring: −(k L/1.4) ((1 − x/L)^(−1.4) − 1), L = 30 mm, without its preload.

    Source: adiabatic compression of an enclosed gas.
    """

    gas_stiffness: float = par(4e3, "N/m", (0.0, 1e9), "k", plausible=(50.0, 3e5))

    def cylinder_force(self, s, z):
        left = jnp.maximum(1.0 - s.cylinder_position / 30e-3, 0.1)
        return -self.gas_stiffness * 30e-3 / 1.4 * (left ** (-1.4) - 1.0)


class RelaxingLoadSpring(Effect):
    """A load spring in parallel with a spring and damper in series: −k x − 1.5 k (x − x_r), dx_r/dt = (x − x_r)/τ.

    Source: standard linear solid; Zener, Elasticity and Anelasticity of Metals (1948).
    """

    lasting_stiffness: float = par(5e3, "N/m", (0.0, 1e9), "k", plausible=(50.0, 5e5))
    relaxing_time: float = par(0.06, "s", (1e-4, 100.0), "τ", plausible=(0.02, 0.2))

    relaxed_position = state("m", "position at which the second spring is without force")

    def cylinder_force(self, s, z):
        x = s.cylinder_position
        return -self.lasting_stiffness * (x + 1.5 * (x - z.relaxed_position))

    def rates(self, s, z):
        return {"relaxed_position": (s.cylinder_position - z.relaxed_position) / self.relaxing_time}


class SwungLoadSpring(Effect):
    """A pendulum as the load: −k x₀ sin(x/x₀), x₀ = 8 mm; the force is largest at 12.6 mm.

    Source: statics of a pendulum.
    """

    lever_stiffness: float = par(1e4, "N/m", (0.0, 1e9), "k", plausible=(100.0, 1e6))

    def cylinder_force(self, s, z):
        return -self.lever_stiffness * 8e-3 * jnp.sin(s.cylinder_position / 8e-3)


class TaperLeakageRise(Effect):
    """Cylinder leakage through a gap that widens linearly with the position: k x₀ ((1 + x/x₀)³ − 1)/3, x₀ = 8 mm.

    Source: laminar flow, with the cube of the gap, in a conical bore; Merritt, Hydraulic Control Systems (1967).
    """

    taper_rise: float = par(5e-12, "m^2/(s*Pa)", (0.0, 1e-6), "k", plausible=(3e-13, 4e-11))

    def cylinder_leakage_change(self, s, z):
        wide = 1.0 + jnp.maximum(s.cylinder_position, 0.0) / 8e-3
        return self.taper_rise * 8e-3 / 3.0 * (wide * wide * wide - 1.0)


class MidStrokeWear(Effect):
    """Cylinder leakage with a maximum at 8 mm, where the bore is worn most: k 5 mm exp(−((x − 8 mm)/3 mm)²).

    Source: wear of bores around the working position; the bell shape is chosen.
    """

    worn_middle: float = par(2e-11, "m^2/(s*Pa)", (0.0, 1e-6), "k", plausible=(1e-12, 2e-10))

    def cylinder_leakage_change(self, s, z):
        return self.worn_middle * 5e-3 * jnp.exp(-jnp.square((s.cylinder_position - 8e-3) / 3e-3))


class ShorteningSealLeakage(Effect):
    """Cylinder leakage along a gap that becomes shorter: k x/(1 − x/25 mm), the sealing length being 25 mm − x.

    Source: laminar gap flow, inversely proportional to the length of the gap; the lengths are chosen.
    """

    shortening_rise: float = par(8e-12, "m^2/(s*Pa)", (0.0, 1e-6), "k", plausible=(5e-13, 1e-10))

    def cylinder_leakage_change(self, s, z):
        x = jnp.maximum(s.cylinder_position, 0.0)
        return self.shortening_rise * x / jnp.maximum(1.0 - x / 25e-3, 0.04)


LAWS = (
    Law(library.KarnoppFriction, LugreCylinderFriction), Law(library.KarnoppFriction, MakkarCylinderFriction),
    Law(library.KarnoppFriction, UnevenCylinderFriction), Law(library.CylinderSealFriction, BothRodSeals),
    Law(library.CylinderSealFriction, PreloadedCylinderSeal), Law(library.CylinderSealFriction, LateCylinderSeal),
    Law(library.LoadSpring, GasLoadSpring), Law(library.LoadSpring, RelaxingLoadSpring),
    Law(library.LoadSpring, SwungLoadSpring), Law(library.CylinderLeakageRise, TaperLeakageRise),
    Law(library.CylinderLeakageRise, MidStrokeWear), Law(library.CylinderLeakageRise, ShorteningSealLeakage),
)  # fmt: skip
