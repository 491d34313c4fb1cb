"""Laws of the cylinder and its load, for the earlier judging set."""

import math

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect, state
from studies.hidden_effects.generators.functions import arctan
from studies.hidden_effects.generators.laws import Law


class StribeckCylinderFriction(Effect):
    """Dry friction of the cylinder that falls with speed: F (1 + 0.8/(1 + (v/8 mm/s)²)) (2/π) atan(v/0.5 mm/s).

    Source: Hess, Soom, J. Tribology 112 (1990) 147.
    """

    rod_friction: float = par(10.0, "N", (0.0, 1e5), "F", plausible=(3.0, 60.0))

    def cylinder_friction_force(self, s, z):
        v = s.cylinder_velocity
        level = (self.rod_friction + s.cylinder_friction_level) * (1.0 + 0.8 / (1.0 + jnp.square(v / 8e-3)))
        return level * (2.0 / math.pi) * arctan(v / 0.5e-3)


class ElasticCylinderFriction(Effect):
    """Cylinder friction with seals that deform before they slide: dF/dt = k v (1 − (F sgn v)/F_C), k = 2e5 N/m.

    Source: Dahl, AIAA J. 14 (1976) 1675.
    """

    rod_friction: float = par(12.0, "N", (1e-6, 1e5), "F_C", plausible=(3.0, 80.0))

    seal_force = state("N", "force of the seals")

    def cylinder_friction_force(self, s, z):
        return z.seal_force

    def rates(self, s, z):
        v, level = s.cylinder_velocity, self.rod_friction
        return {"seal_force": 2e5 * (v - jnp.abs(v) * z.seal_force / level)}


class SaturatingCylinderSeal(Effect):
    """Both dry friction levels of the cylinder grow with the head pressure and saturate: μ A p/(1 + p/0.3 MPa).

    Source: U-cups, whose lip is fully pressed on above some pressure; the form is chosen.
    """

    lip_friction: float = par(0.03, "-", (0.0, 10.0), "μ", plausible=(0.005, 0.15))

    def cylinder_friction_level(self, s, z):
        gauge = jnp.maximum(s.head_pressure - s.atmospheric_pressure, 0.0)
        return self.lip_friction * s.cylinder_area * gauge / (1.0 + gauge / 0.3e6)


class BothSidesCylinderSeal(Effect):
    """Both dry friction levels of the cylinder grow with the difference of the pressures of its sides: μ A |p_h − p_r|.

    Source: a double-acting piston seal, which the larger pressure presses on; the form is chosen.
    """

    lip_friction: float = par(0.03, "-", (0.0, 10.0), "μ", plausible=(0.005, 0.15))

    def cylinder_friction_level(self, s, z):
        return self.lip_friction * s.cylinder_area * jnp.abs(s.head_pressure - s.rod_pressure)


class SofteningLoadSpring(Effect):
    """A load spring whose stiffness falls with its deflection: −k x/(1 + |x|/3 mm).

    Source: rubber mounts; Payne, J. Applied Polymer Science 6 (1962) 57.
    """

    mount_rate: float = par(1e4, "N/m", (0.0, 1e9), "k", plausible=(100.0, 1e6))

    def cylinder_force(self, s, z):
        return -self.mount_rate * s.cylinder_position / (1.0 + jnp.abs(s.cylinder_position) / 3e-3)


class LoadContact(Effect):
    """A load spring with a clearance of 2 mm: −k max(x − 2 mm, 0).

    Source: statics.
    """

    mount_rate: float = par(1e4, "N/m", (0.0, 1e9), "k", plausible=(100.0, 1e6))

    def cylinder_force(self, s, z):
        return -self.mount_rate * jnp.maximum(s.cylinder_position - 2e-3, 0.0)


class WornZoneLeakage(Effect):
    """Leakage of the cylinder in a worn zone beyond 3 mm: k 3 mm/(1 + exp(−(x − 3 mm)/0.7 mm)).

    Source: bores that are worn at one working position; the form is chosen.
    """

    wear: float = par(2e-11, "m^2/(s*Pa)", (0.0, 1e-6), "k", plausible=(1e-12, 2e-10))

    def cylinder_leakage_change(self, s, z):
        return self.wear * 3e-3 / (1.0 + jnp.exp(-(s.cylinder_position - 3e-3) / 0.7e-3))


class RootLeakageRise(Effect):
    """Leakage of the cylinder that grows with the root of the position: k √(x 5 mm).

    Source: chosen; wear that is worst where the piston usually rests and turns.
    """

    wear: float = par(1e-11, "m^2/(s*Pa)", (0.0, 1e-6), "k", plausible=(5e-13, 1e-10))

    def cylinder_leakage_change(self, s, z):
        return self.wear * jnp.sqrt(5e-3 * (jnp.maximum(s.cylinder_position, 0.0) + 1e-6))


LAWS = (
    Law(library.KarnoppFriction, StribeckCylinderFriction), Law(library.KarnoppFriction, ElasticCylinderFriction),
    Law(library.CylinderSealFriction, SaturatingCylinderSeal), Law(library.CylinderSealFriction, BothSidesCylinderSeal),
    Law(library.LoadSpring, SofteningLoadSpring), Law(library.LoadSpring, LoadContact),
    Law(library.CylinderLeakageRise, WornZoneLeakage), Law(library.CylinderLeakageRise, RootLeakageRise),
)  # fmt: skip
