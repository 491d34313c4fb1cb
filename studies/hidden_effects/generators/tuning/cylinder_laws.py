"""Laws of the cylinder and its load, for tuning."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect
from studies.hidden_effects.generators.laws import Law


class SmoothCylinderFriction(Effect):
    """Dry friction of the cylinder without standstill: F tanh(v/1 mm/s).

    Source: Andersson, Söderberg, Björklund, Tribology Int. 40 (2007) 580, smooth Coulomb friction.
    """

    cylinder_level: float = par(12.0, "N", (0.0, 1e5), "F", plausible=(3.0, 80.0))

    def cylinder_friction_force(self, s, z):
        return (self.cylinder_level + s.cylinder_friction_level) * jnp.tanh(s.cylinder_velocity / 1e-3)


class RootCylinderSeal(Effect):
    """Both dry friction levels of the cylinder grow with the root of the head pressure: μ A √(p 0.5 MPa).

    Source: contact width of O-rings that grows less than the pressure; Müller, Nau, Fluid Sealing Technology (1998).
    """

    ring_size: float = par(0.02, "-", (0.0, 10.0), "μ", plausible=(0.003, 0.1))

    def cylinder_friction_level(self, s, z):
        gauge = jnp.maximum(s.head_pressure - s.atmospheric_pressure, 0.0)
        return self.ring_size * s.cylinder_area * jnp.sqrt(0.5e6 * (gauge + 1.0))


class HardeningLoadSpring(Effect):
    """A load spring that hardens: −k x (1 + (x/5 mm)²).

    Source: Duffing, Erzwungene Schwingungen bei veränderlicher Eigenfrequenz (1918).
    """

    load_stiffness: float = par(5e3, "N/m", (0.0, 1e9), "k", plausible=(50.0, 3e5))

    def cylinder_force(self, s, z):
        x = s.cylinder_position
        return -self.load_stiffness * x * (1.0 + jnp.square(x / 5e-3))


class QuadraticLeakageRise(Effect):
    """Leakage of the cylinder that grows with the square of the position: k x²/5 mm.

    Source: a conical bore, first term; chosen.
    """

    bore_slope: float = par(1e-11, "m^2/(s*Pa)", (0.0, 1e-6), "k", plausible=(5e-13, 1e-10))

    def cylinder_leakage_change(self, s, z):
        return self.bore_slope * jnp.square(s.cylinder_position) / 5e-3


LAWS = (
    Law(library.KarnoppFriction, SmoothCylinderFriction), Law(library.CylinderSealFriction, RootCylinderSeal),
    Law(library.LoadSpring, HardeningLoadSpring), Law(library.CylinderLeakageRise, QuadraticLeakageRise),
)  # fmt: skip
