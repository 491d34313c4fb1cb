"""Laws of mover, coupling and cylinder for practice cases, which are a second set of development cases."""

import math

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect, state
from edhas_jax.machine.effects.reference_scales import REFERENCE_TRAVEL, smooth_sign
from studies.hidden_effects.generators.functions import gauge_pressures
from studies.hidden_effects.generators.laws import Law


class ExponentialStribeckFriction(Effect):
    """Static friction with Stribeck's fall: (F (1 + 0.5 exp(−|v|/15 mm/s)) + c |v|) tanh(v/1.5 mm/s).

    Source: Bo, Pavelescu, Wear 82 (1982) 277, exponent 1; Tustin, J. IEE 94 (1947) 143.
    """

    stribeck_level: float = par(4.0, "N", (0.0, 1e4), "F", plausible=(1.5, 9.0))
    stribeck_viscosity: float = par(3.0, "N*s/m", (0.0, 1e4), "c", plausible=(1.0, 8.0))

    def mover_friction(self, s, z):
        v = s.sliding_velocity
        size = jnp.abs(v)
        level = self.stribeck_level * (1.0 + 0.5 * jnp.exp(-size / 15e-3)) + self.stribeck_viscosity * size
        return level * jnp.tanh(v / 1.5e-3)


class MaxwellSlipFriction(Effect):
    """Two elastic elements in parallel that slip at different forces: 0.6 F at 20 µm, 0.4 F at 100 µm.

    Source: Maxwell-slip models of pre-sliding; Lampaert, Al-Bender, Swevers, Tribology Letters 16 (2004) 95; here
    with a smooth transition after Dahl, exponent 1.
    """

    slip_level: float = par(4.0, "N", (1e-6, 1e4), "F", plausible=(1.5, 9.0))

    early = state("N", "force of the first element")
    late = state("N", "force of the second element")

    def mover_friction(self, s, z):
        return z.early + z.late

    def rates(self, s, z):
        v = s.sliding_velocity
        first, second = 0.6 * self.slip_level, 0.4 * self.slip_level
        return {
            "early": (first * v - jnp.abs(v) * z.early) / 20e-6,
            "late": (second * v - jnp.abs(v) * z.late) / 100e-6,
        }


class CubedCogging(Effect):
    """Cogging that is concentrated at the edges: −A sin³ u, u = 2π x/τ + φ.

    Source: sharpened waveform of skewless slots, e.g. Zhu, Howe, IEEE Trans. Magn. 28 (1992) 1371; the form is chosen.
    """

    edge_size: float = par(1.0, "N", (0.0, 1e4), "A", plausible=(0.3, 5.0))
    edge_distance: float = par(6e-3, "m", (1e-5, 1.0), "τ", plausible=(3e-3, 14e-3))
    edge_shift: float = par(0.0, "rad", (-7.0, 7.0), "φ", plausible=(-math.pi, math.pi))

    def mover_force(self, s, z):
        wave = jnp.sin(2.0 * jnp.pi * s.piston_position / self.edge_distance + self.edge_shift)
        return -self.edge_size * wave * wave * wave


class RootEddyDrag(Effect):
    """Eddy-current drag whose growth with speed levels off: −c v/√(1 + (v/v_e)²).

    Source: thick conductors, whose skin depth falls with speed; Smythe, Trans. AIEE 61 (1942) 681; the form is chosen.
    """

    sheet_size: float = par(10.0, "N*s/m", (0.0, 1e4), "c", plausible=(2.0, 40.0))
    sheet_speed: float = par(0.1, "m/s", (1e-3, 1e3), "v_e", plausible=(0.04, 0.3))

    def mover_force(self, s, z):
        v = s.piston_velocity
        return -self.sheet_size * v / jnp.sqrt(1.0 + jnp.square(v / self.sheet_speed))


class SofteningSpring(Effect):
    """A spring whose stiffness decreases with deflection: −k x/√(1 + (x/3 mm)²).

    Source: cables and corrugated boots that unfold; the form is chosen.
    """

    boot_stiffness: float = par(500.0, "N/m", (0.0, 1e8), "k", plausible=(80.0, 4000.0))

    def mover_force(self, s, z):
        x = s.piston_position
        return -self.boot_stiffness * x / jnp.sqrt(1.0 + jnp.square(x / 3e-3))


class OneSidedSpring(Effect):
    """A spring that is three times as stiff on one side: −k (x + (√(x² + (0.3 mm)²) − 0.3 mm)/2).

    Source: a boot or a cable that is stretched in one direction and folded in the other; the form is chosen.
    """

    side_stiffness: float = par(500.0, "N/m", (0.0, 1e8), "k", plausible=(80.0, 4000.0))

    def mover_force(self, s, z):
        x = s.piston_position
        return -self.side_stiffness * (x + 0.5 * (jnp.sqrt(jnp.square(x) + 9e-8) - 3e-4))


class RippledBias(Effect):
    """A bias force that varies by 10 % along the stroke: −F (1 + 0.1 sin(2π x/3 mm)).

    Source: a weight on a cable over a pulley that runs out; the form is chosen.
    """

    weight_size: float = par(1.0, "N", (-1e4, 1e4), "F", plausible=(-5.0, 5.0))

    def mover_force(self, s, z):
        return -self.weight_size * (1.0 + 0.1 * jnp.sin(2.0 * jnp.pi * s.piston_position / 3e-3))


class SpeedingAsymmetricFriction(Effect):
    """Friction of the forward stroke that grows with speed: F_a (0.5 + |v|/0.2 m/s) max(tanh(v/8 mm/s), 0).

    Source: scraper rings, which wipe in one direction; the form is chosen.
    """

    scraper_size: float = par(1.5, "N", (0.0, 1e4), "F_a", plausible=(0.4, 5.0))

    def mover_friction(self, s, z):
        v = s.sliding_velocity
        return self.scraper_size * (0.5 + jnp.abs(v) / 0.2) * jnp.maximum(jnp.tanh(v / 8e-3), 0.0)


class RootAsymmetricDamping(Effect):
    """Drag that differs between the directions with speed to the power 1.5: −c |v|^1.5/√(0.1 m/s), either sign.

    Source: turbulent passages at moderate Reynolds numbers; Idelchik, Handbook of Hydraulic Resistance.
    """

    passage_size: float = par(5.0, "N*s/m", (-1e4, 1e4), "c", plausible=(-50.0, 50.0))

    def mover_force(self, s, z):
        size = jnp.abs(s.piston_velocity)
        return -self.passage_size * size * jnp.sqrt(size / 0.1 + 1e-9)


class QuarticEndFriction(Effect):
    """Dry friction at the ends of the stroke only: F_s (x/x_m)⁴ th(v).

    Source: a bore that is worn in its middle; the form is chosen.
    """

    wear_size: float = par(4.0, "N", (0.0, 1e4), "F_s", plausible=(1.0, 12.0))

    def mover_friction(self, s, z):
        share = jnp.square(jnp.square(s.sliding_position / REFERENCE_TRAVEL))
        return self.wear_size * share * smooth_sign(s.sliding_velocity)


class SaturatingSealFriction(Effect):
    """Seal friction that saturates with pressure: μ S_p p/(1 + p/1.5 MPa) of both chambers, th(v).

    Source: seals that are fully pressed on above some pressure; Müller, Nau, Fluid Sealing Technology (1998).
    """

    pressed_share: float = par(0.03, "-", (0.0, 10.0), "μ", plausible=(0.008, 0.2))

    def mover_friction(self, s, z):
        a, b = (p / (1.0 + p / 1.5e6) for p in gauge_pressures(s))
        return self.pressed_share * s.piston_area * (a + b) * smooth_sign(s.sliding_velocity)


class SoftCentreCoupling(Effect):
    """A coupling with half its stiffness k at zero deflection: k Δ (1 − 0.5/(1 + (Δ/15 µm)²)) + 20 N·s/m Δ̇.

    Source: joints whose surfaces touch at asperities first; the form is chosen.
    """

    joint_compliance: float = par(1e-6, "m/N", (1e-12, 1.0), "1/k", plausible=(2e-7, 1e-5))

    def coupling_force(self, s, z):
        d = s.coupling_deflection
        soft = 1.0 - 0.5 / (1.0 + jnp.square(d / 15e-6))
        return d / self.joint_compliance * soft + 20.0 * s.coupling_velocity


class FilledBacklash(Effect):
    """Play that is filled with grease: beyond it 1e6 N/m, within it a twentieth of this, with 10 N·s/m everywhere.

    Source: piecewise linear joints with a soft gap; Kahraman, Singh, J. Sound Vib. 142 (1990) 49.
    """

    greased_play: float = par(30e-6, "m", (0.0, 1e-2), "b", plausible=(4e-6, 100e-6))

    def coupling_force(self, s, z):
        d = s.coupling_deflection
        depth = jnp.maximum(jnp.abs(d) - 0.5 * self.greased_play, 0.0)
        direction = jnp.where(d > 0.0, 1.0, -1.0)
        return 1e6 * direction * depth + 5e4 * d + 10.0 * s.coupling_velocity


class StribeckCylinderFriction(Effect):
    """Friction of the cylinder with Stribeck's fall: F (1 + 0.4 exp(−|v|/10 mm/s)) tanh(v/0.7 mm/s), no standstill.

    Source: Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083.
    """

    rod_level: float = par(12.0, "N", (0.0, 1e5), "F", plausible=(4.0, 80.0))

    def cylinder_friction_force(self, s, z):
        v = s.cylinder_velocity
        level = (self.rod_level + s.cylinder_friction_level) * (1.0 + 0.4 * jnp.exp(-jnp.abs(v) / 10e-3))
        return level * jnp.tanh(v / 0.7e-3)


class SaturatingCylinderSeal(Effect):
    """Dry friction of the cylinder that levels off with the head pressure: μ A p/(1 + p/1.5 MPa).

    Source: seals that are fully pressed on above some pressure; Müller, Nau, Fluid Sealing Technology (1998).
    """

    rod_seal_share: float = par(0.02, "-", (0.0, 10.0), "μ", plausible=(0.004, 0.1))

    def cylinder_friction_level(self, s, z):
        gauge = jnp.maximum(s.head_pressure - s.atmospheric_pressure, 0.0)
        return self.rod_seal_share * s.cylinder_area * gauge / (1.0 + gauge / 1.5e6)


class SofteningLoadSpring(Effect):
    """A load spring whose stiffness decreases with deflection: −k x/(1 + |x|/10 mm).

    Source: disc springs, whose force-deflection curve is degressive; DIN EN 16984; the form is chosen.
    """

    disc_stiffness: float = par(5e3, "N/m", (0.0, 1e9), "k", plausible=(100.0, 3e5))

    def cylinder_force(self, s, z):
        x = s.cylinder_position
        return -self.disc_stiffness * x / (1.0 + jnp.abs(x) / 10e-3)


LAWS = (
    Law(library.LugreFriction, ExponentialStribeckFriction), Law(library.LugreFriction, MaxwellSlipFriction),
    Law(library.CoggingForce, CubedCogging), Law(library.EddyDrag, RootEddyDrag),
    Law(library.ParasiticSpring, SofteningSpring), Law(library.ParasiticSpring, OneSidedSpring),
    Law(library.ConstantBiasForce, RippledBias), Law(library.AsymmetricFriction, SpeedingAsymmetricFriction),
    Law(library.AsymmetricDamping, RootAsymmetricDamping), Law(library.StrokeDependentFriction, QuarticEndFriction),
    Law(library.SealFriction, SaturatingSealFriction), Law(library.CouplingCompliance, SoftCentreCoupling),
    Law(library.Backlash, FilledBacklash), Law(library.KarnoppFriction, StribeckCylinderFriction),
    Law(library.CylinderSealFriction, SaturatingCylinderSeal), Law(library.LoadSpring, SofteningLoadSpring),
)  # fmt: skip
