"""Laws of the coupling between coil carrier and plungers, for judging."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect, state
from studies.hidden_effects.generators.laws import Law


class PreloadedCoupling(Effect):
    """A preloaded joint that separates: stiffness 1/C, a third of it beyond the force F_0, damping 20 N·s/m.

    F = Δ/(3 C) + (2/3) F_0 tanh(Δ/(C F_0)) + 20 N·s/m Δ̇

    Source: bolted joints, whose stiffness falls to that of the bolt where the parts separate; VDI 2230 (2015). The
    rounding is chosen.
    """

    preloaded_compliance: float = par(1e-6, "m/N", (1e-12, 1.0), "C", plausible=(4e-8, 1e-5))
    opening_force: float = par(12.0, "N", (1e-6, 1e6), "F_0", plausible=(4.0, 25.0))

    def coupling_force(self, s, z):
        linear = s.coupling_deflection / self.preloaded_compliance
        preload = self.opening_force * jnp.tanh(linear / self.opening_force)
        return (linear + 2.0 * preload) / 3.0 + 20.0 * s.coupling_velocity


class MicroslipCoupling(Effect):
    """A joint with microslip of its faces: Δ/C + F_s, dF_s/dt = (2/C) (Δ̇ − |Δ̇| F_s/F_y), and 10 N·s/m Δ̇.

    Source: microslip of joints, Gaul, Nitsche, Applied Mechanics Reviews 54 (2001) 93; Dahl's form of the transition.
    """

    slipping_compliance: float = par(1e-6, "m/N", (1e-12, 1.0), "C", plausible=(1e-7, 1e-5))
    face_friction: float = par(12.0, "N", (1e-6, 1e6), "friction of the faces F_y", plausible=(5.0, 30.0))

    face_force = state("N", "force of the faces that slip")

    def coupling_force(self, s, z):
        return s.coupling_deflection / self.slipping_compliance + z.face_force + 10.0 * s.coupling_velocity

    def rates(self, s, z):
        w = s.coupling_velocity
        return {"face_force": 2.0 / self.slipping_compliance * (w - jnp.abs(w) * z.face_force / self.face_friction)}


def _contact(depth, speed, stiffness):
    """Force [N] of a contact with a damping of 20 N·s/m, never adhesive, at a depth [m] that grows at a speed [m/s]."""
    return jnp.where(depth > 0.0, jnp.maximum(stiffness * depth + 20.0 * speed, 0.0), 0.0)


def _contacts(s, play, ahead=1e6, behind=1e6):
    """Force [N] of the contacts at both ends of a play [m], of the stiffnesses `ahead` and `behind` [N/m]."""
    d, w, half = s.coupling_deflection, s.coupling_velocity, 0.5 * play
    return _contact(d - half, w, ahead) - _contact(-d - half, -w, behind)


class UnequalBacklash(Effect):
    """Play between a hard and a soft face: contacts of 5e6 N/m for Δ > b/2 and of 1e6 N/m for Δ < −b/2.

    Source: a shoulder on one side and a retaining ring on the other; the stiffnesses are chosen.
    """

    ring_play: float = par(30e-6, "m", (0.0, 1e-2), "b", plausible=(2e-6, 100e-6))

    def coupling_force(self, s, z):
        return _contacts(s, self.ring_play, 5e6, 1e6)


class RubbingBacklash(Effect):
    """Play with friction between the parts: contacts of 1e6 N/m beyond ±b/2, and the friction F_r tanh(Δ̇/3 mm/s).

    Source: joints that clear and rub; Nordin, Gutman, Automatica 38 (2002) 1633, for play; the friction is chosen.
    """

    rubbing_play: float = par(30e-6, "m", (0.0, 1e-2), "b", plausible=(3e-6, 150e-6))
    play_friction: float = par(6.0, "N", (0.0, 1e4), "F_r", plausible=(3.0, 12.0))

    def coupling_force(self, s, z):
        return _contacts(s, self.rubbing_play) + self.play_friction * jnp.tanh(s.coupling_velocity / 3e-3)


class SprungBacklash(Effect):
    """Play with a preload spring: contacts of 1e6 N/m beyond ±b/2, and F_p + 2 N/mm Δ + 5 N·s/m Δ̇ between them.

    Source: anti-backlash nuts and gears with springs; statics.
    """

    sprung_play: float = par(30e-6, "m", (0.0, 1e-2), "b", plausible=(3e-6, 150e-6))
    take_up_force: float = par(6.0, "N", (0.0, 1e4), "F_p", plausible=(2.0, 12.0))

    def coupling_force(self, s, z):
        spring = self.take_up_force + 2e3 * s.coupling_deflection + 5.0 * s.coupling_velocity
        return _contacts(s, self.sprung_play) + spring


LAWS = (
    Law(library.CouplingCompliance, PreloadedCoupling), Law(library.CouplingCompliance, MicroslipCoupling),
    Law(library.Backlash, UnequalBacklash), Law(library.Backlash, RubbingBacklash),
    Law(library.Backlash, SprungBacklash),
)  # fmt: skip
