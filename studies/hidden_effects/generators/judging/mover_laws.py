"""Laws of friction, cogging, eddy drag, springs and reluctance at the mover, for judging."""

import math

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect, state
from edhas_jax.machine.effects.reference_scales import REFERENCE_TRAVEL
from studies.hidden_effects.generators.functions import smooth_positive
from studies.hidden_effects.generators.laws import Law


class BuildingFilmFriction(Effect):
    """Stribeck friction whose oil film of thickness h follows the speed with a lag.

    (F_C + ΔF exp(−h²)) tanh(v/2 mm/s) + c v

    τ dh/dt = |v|/v_S − h, v_S = 50 mm/s, c = 2 N·s/m

    Source: Yanada, Sekikawa, Mechatronics 18 (2008) 330, film of hydraulic cylinders; here without bristles.
    """

    film_level: float = par(3.0, "N", (0.0, 1e4), "F_C", plausible=(1.5, 8.0))
    film_excess: float = par(3.0, "N", (0.0, 1e4), "ΔF", plausible=(2.0, 6.0))
    film_time: float = par(10e-3, "s", (1e-5, 10.0), "τ", plausible=(5e-3, 30e-3))

    film = state("-", "thickness of the film over that at v_S")

    def mover_friction(self, s, z):
        v = s.sliding_velocity
        level = self.film_level + self.film_excess * jnp.exp(-jnp.square(z.film))
        return level * jnp.tanh(v / 2e-3) + 2.0 * v

    def rates(self, s, z):
        return {"film": (jnp.abs(s.sliding_velocity) / 0.05 - z.film) / self.film_time}


class ElastoplasticFriction(Effect):
    """Friction that is elastic up to F_C/2 and plastic from F_C on: dF/dt = σ v (1 − α(r) r), r = (F/F_C) sgn v.

    α rises smoothly from 0 at r = 1/2 to 1 at r = 1

    Source: Dupont, Hayward, Armstrong, Altpeter, IEEE Trans. Autom. Control 47 (2002) 787; α here a cubic polynomial.
    """

    plastic_level: float = par(4.0, "N", (1e-6, 1e4), "F_C", plausible=(2.0, 10.0))
    elastic_stiffness: float = par(4e4, "N/m", (1.0, 1e9), "σ", plausible=(1.5e4, 8e4))

    force = state("N", "friction force")

    def mover_friction(self, s, z):
        return z.force

    def rates(self, s, z):
        v = s.sliding_velocity
        r = z.force / self.plastic_level * jnp.where(v < 0.0, -1.0, 1.0)
        u = jnp.clip(2.0 * r - 1.0, 0.0, 1.0)
        return {"force": self.elastic_stiffness * v * (1.0 - u * u * (3.0 - 2.0 * u) * r)}


class LogarithmicFriction(Effect):
    """Friction that grows with the logarithm of speed: F_1 asinh(v/v_0)/asinh(0.1 m/s/v_0).

    Source: Prandtl, ZAMM 8 (1928) 85; Eyring, J. Chemical Physics 4 (1936) 283: thermally activated sliding.
    """

    boundary_level: float = par(4.0, "N", (0.0, 1e4), "F_1, at 0.1 m/s", plausible=(2.0, 10.0))
    activation_velocity: float = par(1e-3, "m/s", (1e-6, 1.0), "v_0", plausible=(0.4e-3, 4e-3))

    def mover_friction(self, s, z):
        u, at = s.sliding_velocity / self.activation_velocity, 0.1 / self.activation_velocity
        share = jnp.log(u + jnp.sqrt(u * u + 1.0)) / jnp.log(at + jnp.sqrt(at * at + 1.0))
        return self.boundary_level * share


class FlatToppedCogging(Effect):
    """A cogging force that is nearly constant over most of each half period: −A sin u/√(0.06 + sin² u), u = 2π x/τ + φ.

    Source: the form is chosen; teeth and gaps of equal width under a short magnet.
    """

    tooth_force: float = par(1.0, "N", (0.0, 1e4), "A", plausible=(0.2, 5.0))
    tooth_pitch: float = par(6e-3, "m", (1e-5, 1.0), "τ", plausible=(3e-3, 12e-3))
    tooth_phase: float = par(0.0, "rad", (-7.0, 7.0), "φ", plausible=(-math.pi, math.pi))

    def mover_force(self, s, z):
        wave = jnp.sin(2.0 * jnp.pi * s.piston_position / self.tooth_pitch + self.tooth_phase)
        return -self.tooth_force * wave / jnp.sqrt(0.06 + wave * wave)


class IronScrewCogging(Effect):
    """Attraction to one piece of iron in the frame: −A √(2 e) u exp(−u²), u = (x − x_0)/w, at most A.

    Source: gradient of an energy well; its bell shape is chosen.
    """

    screw_force: float = par(2.0, "N", (0.0, 1e4), "A", plausible=(0.4, 8.0))
    screw_position: float = par(0.5e-3, "m", (-1.0, 1.0), "x_0", plausible=(-2e-3, 2e-3))
    screw_width: float = par(1e-3, "m", (1e-5, 1.0), "w", plausible=(0.6e-3, 1.6e-3))

    def mover_force(self, s, z):
        u = (s.piston_position - self.screw_position) / self.screw_width
        return -self.screw_force * math.sqrt(2.0 * math.e) * u * jnp.exp(-u * u)


class UnevenPitchCogging(Effect):
    """Cogging whose pitch changes along the stroke: −A sin(2π (x/τ) (1 + 0.4 x/x_m) + φ), x_m = 5 mm.

    Source: the form is chosen; magnets at uneven distances.
    """

    uneven_force: float = par(1.0, "N", (0.0, 1e4), "A", plausible=(0.2, 5.0))
    uneven_pitch: float = par(5e-3, "m", (1e-5, 1.0), "τ", plausible=(3e-3, 8e-3))
    uneven_phase: float = par(0.0, "rad", (-7.0, 7.0), "φ", plausible=(-math.pi, math.pi))

    def mover_force(self, s, z):
        x = s.piston_position
        turns = x / self.uneven_pitch * (1.0 + 0.4 * x / REFERENCE_TRAVEL)
        return -self.uneven_force * jnp.sin(2.0 * jnp.pi * turns + self.uneven_phase)


class ShortedTurnDrag(Effect):
    """Eddy drag of a shorted turn with inductance, which follows the speed with a lag: τ dF/dt = c v − F.

    Source: Faraday's and Ohm's laws for a ring in a uniform radial field; τ is its inductance over its resistance.
    """

    turn_drag: float = par(10.0, "N*s/m", (0.0, 1e4), "c", plausible=(1.0, 40.0))
    turn_time: float = par(3e-3, "s", (1e-6, 1.0), "τ", plausible=(1.5e-3, 1.2e-2))

    ring_force = state("N", "drag")

    def mover_force(self, s, z):
        return -z.ring_force

    def rates(self, s, z):
        return {"ring_force": (self.turn_drag * s.piston_velocity - z.ring_force) / self.turn_time}


class PoleEddyDrag(Effect):
    """Eddy drag with the square of a periodic field: −c v (1 + cos(2π x/τ + φ)).

    Source: eddy loss ∝ B² v² of a thin conductor in the sinusoidal field of a magnet array.
    """

    pole_drag: float = par(8.0, "N*s/m", (0.0, 1e4), "c", plausible=(1.0, 30.0))
    pole_pitch: float = par(6e-3, "m", (1e-5, 1.0), "τ", plausible=(4e-3, 12e-3))
    pole_phase: float = par(0.0, "rad", (-7.0, 7.0), "φ", plausible=(-math.pi, math.pi))

    def mover_force(self, s, z):
        field = 1.0 + jnp.cos(2.0 * jnp.pi * s.piston_position / self.pole_pitch + self.pole_phase)
        return -self.pole_drag * s.piston_velocity * field


class EnteringEddyDrag(Effect):
    """Eddy drag of a sheet that enters the field at one end of the stroke: −c v (1 + tanh((x − x_0)/1.5 mm))/2.

    Source: eddy-current brakes with partial overlap of sheet and magnet; the shape of the edge is chosen.
    """

    overlap_drag: float = par(12.0, "N*s/m", (0.0, 1e4), "c", plausible=(1.0, 40.0))
    overlap_position: float = par(0.0, "m", (-1.0, 1.0), "x_0", plausible=(-1.5e-3, 1.5e-3))

    def mover_force(self, s, z):
        overlap = 0.5 * (1.0 + jnp.tanh((s.piston_position - self.overlap_position) / 1.5e-3))
        return -self.overlap_drag * s.piston_velocity * overlap


class SlackSpring(Effect):
    """A spring with slack up to ±g: −k (|x| − g) sgn x beyond, rounded within 0.3 mm.

    Source: chosen; a cable or a bellows that is free until it is stretched.
    """

    slack_stiffness: float = par(1500.0, "N/m", (0.0, 1e8), "k", plausible=(150.0, 12000.0))
    slack_length: float = par(1.5e-3, "m", (0.0, 1.0), "g", plausible=(1e-3, 2.2e-3))

    def mover_force(self, s, z):
        ahead, behind = (smooth_positive(x - self.slack_length, 3e-4) for x in (s.piston_position, -s.piston_position))
        return -self.slack_stiffness * (ahead - behind)


class MagnetPairSpring(Effect):
    """Lateral attraction of two magnets side by side: −k x (1 − (x/2 a)²)/(1 + (x/a)²)^3.5, a = 6 mm.

    Source: lateral force between two dipoles at the distance a, e.g. Jackson, Classical Electrodynamics.
    """

    magnet_stiffness: float = par(500.0, "N/m", (0.0, 1e8), "k", plausible=(100.0, 8000.0))

    def mover_force(self, s, z):
        x = s.piston_position
        q = jnp.square(x / 6e-3)
        near = 1.0 + q
        return -self.magnet_stiffness * x * (1.0 - 0.25 * q) / (near * near * near * jnp.sqrt(near))


class AirSpring(Effect):
    """A closed volume of air behind the mover: −(k h/1.2) ((1 − x/h)^−1.2 − 1), h = 9 mm.

    Source: polytropic change of state in a closed volume of the length h.
    """

    air_stiffness: float = par(500.0, "N/m", (0.0, 1e8), "k", plausible=(50.0, 4000.0))

    def mover_force(self, s, z):
        left = jnp.maximum(1.0 - s.piston_position / 9e-3, 0.1)
        return -self.air_stiffness * 9e-3 / 1.2 * (jnp.exp(-1.2 * jnp.log(left)) - 1.0)


class GapInductance(Effect):
    """An inductance that falls as an air gap opens: L (1 − λ + λ/(1 + x/8 mm)), with its force and voltage.

    Source: plunger magnets, inductance ∝ 1/gap; Fitzgerald, Kingsley, Umans, Electric Machinery.
    """

    gap_share: float = par(0.15, "-", (0.0, 1.0), "λ", plausible=(0.02, 0.4))

    def _gradient(self, s):
        return -s.coil_inductance * self.gap_share / 8e-3 / jnp.square(1.0 + s.piston_position / 8e-3)

    def coil_inductance_factor(self, s, z):
        return 1.0 - self.gap_share + self.gap_share / (1.0 + s.piston_position / 8e-3)

    def coil_voltage_change(self, s, z):
        return -s.current * s.piston_velocity * self._gradient(s)

    def mover_force(self, s, z):
        return 0.5 * jnp.square(s.current) * self._gradient(s)


class OverlapInductance(Effect):
    """An inductance that grows with the overlap of coil and iron, from mid-stroke on, with its force and voltage.

    L (1 + λ (x + √(x² + (0.6 mm)²))/(2 x_m)), x_m = 5 mm

    Source: idealised profile of reluctance machines; Lawrenson et al., IEE Proc. B 127 (1980) 253; rounding chosen.
    """

    overlap_inductance: float = par(0.2, "-", (-1.0, 1.0), "λ", plausible=(-0.4, 0.4))

    def _gradient(self, s):
        x = s.piston_position
        slope = 0.5 * (1.0 + x / jnp.sqrt(jnp.square(x) + 3.6e-7))
        return s.coil_inductance * self.overlap_inductance * slope / REFERENCE_TRAVEL

    def coil_inductance_factor(self, s, z):
        return 1.0 + self.overlap_inductance * smooth_positive(s.piston_position, 6e-4) / REFERENCE_TRAVEL

    def coil_voltage_change(self, s, z):
        return -s.current * s.piston_velocity * self._gradient(s)

    def mover_force(self, s, z):
        return 0.5 * jnp.square(s.current) * self._gradient(s)


LAWS = (
    Law(library.LugreFriction, BuildingFilmFriction), Law(library.LugreFriction, ElastoplasticFriction),
    Law(library.LugreFriction, LogarithmicFriction),
    Law(library.CoggingForce, FlatToppedCogging), Law(library.CoggingForce, IronScrewCogging),
    Law(library.CoggingForce, UnevenPitchCogging),
    Law(library.EddyDrag, ShortedTurnDrag), Law(library.EddyDrag, PoleEddyDrag),
    Law(library.EddyDrag, EnteringEddyDrag),
    Law(library.ParasiticSpring, SlackSpring), Law(library.ParasiticSpring, MagnetPairSpring),
    Law(library.ParasiticSpring, AirSpring),
    Law(library.ReluctanceForce, GapInductance), Law(library.ReluctanceForce, OverlapInductance),
)  # fmt: skip
