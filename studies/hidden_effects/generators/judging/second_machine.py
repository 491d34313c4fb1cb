"""A machine that the package does not have, for the judging cases: two flywheels on a shaft.

A motor drives the first of them to and fro.
"""

import functools

import jax.numpy as jnp

from edhas_jax import Rig, Sine, drive, par, signal, slot, state
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.campaign import Channel
from studies.hidden_effects.generators.benches import Bench, planned_runs
from studies.hidden_effects.generators.disturbances import PHASE, Disturbance, shape_par, size_par
from studies.hidden_effects.generators.judging.settings import cooling_room
from studies.hidden_effects.generators.laws import law
from studies.hidden_effects.generators.settings import RunDrift

FAST, TWIST = 4.0, 0.02  # typical speed [rad/s] and twist [rad]


class TwoFlywheels(Rig):
    """A rotor that a soft spring holds and a disc, connected by an elastic shaft with the angle of twist φ.

    J_1 dω_1/dt = M − k_0 θ_1 − k φ − d dφ/dt − c_1 ω_1, J_2 dω_2/dt = k φ + d dφ/dt − c_2 ω_2, dφ/dt = ω_1 − ω_2

    Source: torsional oscillators; Den Hartog, Mechanical Vibrations (1934).
    """

    time_step, duration = 1e-4, 0.8  # s

    torque = drive("N*m", "torque of the motor", 0.0)

    rotor_inertia: float = par(2e-3, "kg*m^2", (1e-7, 1e3), "inertia of the rotor")
    disc_inertia: float = par(5e-3, "kg*m^2", (1e-7, 1e3), "inertia of the disc")
    shaft_stiffness: float = par(30.0, "N*m/rad", (1e-3, 1e6), "stiffness of the shaft")
    shaft_damping: float = par(0.02, "N*m*s/rad", (0.0, 1e3), "damping of the shaft")
    rotor_damping: float = par(0.02, "N*m*s/rad", (0.0, 1e3), "damping of the rotor's bearings")
    disc_damping: float = par(0.01, "N*m*s/rad", (0.0, 1e3), "damping of the disc's bearings")
    holding_rate: float = par(2.0, "N*m/rad", (0.0, 1e5), "stiffness of the spring that holds the rotor")

    rotor_angle = state("rad", "angle of the rotor", 0.0)
    twist = state("rad", "angle of twist of the shaft: rotor minus disc", 0.0)
    rotor_speed = state("rad/s", "speed of the rotor", 0.0)
    disc_speed = state("rad/s", "speed of the disc", 0.0)
    disc_angle = signal("rad", "angle of the disc")
    slip_speed = signal("rad/s", "rate of the angle of twist")

    torque_factor = slot("motor", "-", "multiplies the torque", ("rotor_angle", "torque"), 0.05, scales=True)
    rotor_torque = slot("rotor", "N*m", "torque on the rotor", ("rotor_speed", "rotor_angle"), 0.02)
    shaft_torque = slot("shaft", "N*m", "additional torque of the shaft", ("twist", "slip_speed"), 0.02)
    disc_torque = slot("disc", "N*m", "torque on the disc", ("disc_speed", "disc_angle"), 0.02)

    def equations(self, y, s):
        """The rates of angles and speeds; sets the angle of the disc and the rate of the twist."""
        zero = 0.0 * y.rotor_speed
        s.set(disc_angle=y.rotor_angle - y.twist, slip_speed=y.rotor_speed - y.disc_speed)
        shaft = self.shaft_stiffness * y.twist + self.shaft_damping * s.slip_speed + self.shaft_torque.apply(zero, s)
        motor = s.torque * self.torque_factor.apply(1.0 + zero, s) - self.holding_rate * y.rotor_angle
        rotor = motor - shaft - self.rotor_damping * y.rotor_speed + self.rotor_torque.apply(zero, s)
        disc = shaft - self.disc_damping * y.disc_speed + self.disc_torque.apply(zero, s)
        return {"rotor_angle": y.rotor_speed, "twist": s.slip_speed, "rotor_speed": rotor / self.rotor_inertia,
                "disc_speed": disc / self.disc_inertia}  # fmt: skip


_law = functools.partial(law, rig=TwoFlywheels)


def _slipping(e, s, z):
    return e.clamp_torque * jnp.tanh((s.rotor_speed - z.ring_speed) / 0.2)


# fmt: off
BEARING = _law(None, "BearingFriction", "Dry friction of the disc's bearings: −M tanh(ω/0.15 rad/s). Source: Coulomb.",
               {"bearing_level": ("N*m", 5e-4, 0.08)},
               disc_torque=lambda e, s, z: -e.bearing_level * jnp.tanh(s.disc_speed / 0.15)).kind
FAN = _law(None, "FanTorque", "Air drag of blades on the disc: −b ω |ω|/(4 rad/s)². Source: Newton's drag.",
           {"blade_torque": ("N*m", 1e-3, 0.2)},
           disc_torque=lambda e, s, z: -e.blade_torque * s.disc_speed * jnp.abs(s.disc_speed) / FAST**2).kind
DETENT = _law(None, "DetentTorque", "Detent torque of the motor: −A sin(12 θ + ψ). Source: twelve teeth.",
              {"detent_size": ("N*m", 1e-3, 0.15), "detent_start": ("rad", -3.1, 3.1)},
              rotor_torque=lambda e, s, z: -e.detent_size * jnp.sin(12.0 * s.rotor_angle + e.detent_start)).kind
STIFFENING = _law(None, "StiffeningShaft", "A shaft that stiffens with its twist: k_3 φ (φ/0.02 rad)². Source: Duffing "
                  "(1918).",
                  {"stiffening": ("N*m/rad", 0.02, 15.0)},
                  shaft_torque=lambda e, s, z: e.stiffening * s.twist * jnp.square(s.twist / TWIST)).kind
UNBALANCE = _law(None, "HangingUnbalance", "Unbalance of the disc, on which gravity acts: −W sin(φ_2 + ψ). Source: "
                 "statics of a pendulum.", {"unbalance": ("N*m", 2e-3, 0.3), "weight_place": ("rad", -3.1, 3.1)},
                 disc_torque=lambda e, s, z: -e.unbalance * jnp.sin(s.disc_angle + e.weight_place)).kind
# fmt: on
LIBRARY: tuple[type[Effect], ...] = (BEARING, FAN, DETENT, STIFFENING, UNBALANCE)
LAWS = (
    _law(BEARING, "WetBearing", "Stribeck friction of the disc's bearings: −M (1 + 1.2 exp(−|ω|/0.5 rad/s)) "
         "tanh(ω/0.1 rad/s). Source: Stribeck (1902).", {"wet_level": ("N*m", 5e-4, 0.06)}, disc_torque=lambda e, s, z:
         -e.wet_level * (1.0 + 1.2 * jnp.exp(-jnp.abs(s.disc_speed) / 0.5)) * jnp.tanh(s.disc_speed / 0.1)),
    _law(FAN, "FeatheredFan", "Air drag of flexible blades: −b u/√(1 + u²) |u|, u = ω/3 rad/s. Source: flexible "
         "leaves; Vogel, Life in Moving Fluids; form chosen.", {"leaf_torque": ("N*m", 1e-3, 0.15)},
         disc_torque=lambda e, s, z: -e.leaf_torque * (s.disc_speed / 3.0) * jnp.abs(s.disc_speed / 3.0)
         / jnp.sqrt(1.0 + jnp.square(s.disc_speed / 3.0))),
    _law(DETENT, "DoubleDetent", "Detent torque with its second harmonic: −A (sin u + 0.7 sin(2 u + 1)), u = 9 θ + ψ. "
         "Source: Fourier series.", {"double_size": ("N*m", 1e-3, 0.12), "double_start": ("rad", -3.1, 3.1)},
         rotor_torque=lambda e, s, z: -e.double_size * (jnp.sin(9.0 * s.rotor_angle + e.double_start)
         + 0.7 * jnp.sin(18.0 * s.rotor_angle + 2.0 * e.double_start + 1.0))),
    _law(STIFFENING, "StopShaft", "Stops of the twist at ±15 mrad: k max(|φ| − 15 mrad, 0) sgn φ, rounded over 2 mrad. "
         "Source: two-stage clutch springs; statics.", {"stop_rate": ("N*m/rad", 0.2, 60.0)},
         shaft_torque=lambda e, s, z: e.stop_rate * 0.5 * (2.0 * s.twist - jnp.sqrt(jnp.square(s.twist + 0.015) + 4e-6)
         + jnp.sqrt(jnp.square(s.twist - 0.015) + 4e-6))),
    _law(UNBALANCE, "MagneticPull", "Pull of a magnet near the disc: −W sin φ/(1.4 − cos φ), φ = φ_2 + ψ. "
         "Source: dipole near iron; chosen.", {"pull_torque": ("N*m", 1e-3, 0.2), "pole_place": ("rad", -1.5, 1.5)},
         disc_torque=lambda e, s, z: -e.pull_torque * jnp.sin(s.disc_angle + e.pole_place)
         / (1.4 - jnp.cos(s.disc_angle + e.pole_place))),
)  # fmt: skip
UNLISTED = (
    _law(None, "SlippingRing", "A ring of 3e-4 kg·m² that slips on the rotor: −M th, th = tanh((ω_1 − ω_r)/0.2 rad/s), "
         "3e-4 dω_r/dt = M th (memory). Source: Lanchester's damper (1914).", {"clamp_torque": ("N*m", 2e-3, 0.1)},
         states={"ring_speed": "rad/s"}, confused_with=("bearing_friction", "detent_torque"),
         rotor_torque=lambda e, s, z: -_slipping(e, s, z),
         rates=lambda e, s, z: {"ring_speed": _slipping(e, s, z) / 3e-4}),
    _law(None, "AngleDamping", "Damping of the disc that grows with its angle: −c ω (φ_2/0.2 rad)² (angle × speed). "
         "Source: a wedge-shaped gap of oil; form chosen.", {"wedge_size": ("N*m*s/rad", 3e-4, 0.08)},
         confused_with=("bearing_friction", "fan_torque"),
         disc_torque=lambda e, s, z: -e.wedge_size * s.disc_speed * jnp.square(s.disc_angle / 0.2)),
    _law(None, "RelaxingShaft", "A viscoelastic bushing: k (φ − φ_r), τ dφ_r/dt = φ − φ_r (memory). Source: Maxwell.",
         {"bushing_rate": ("N*m/rad", 0.2, 15.0), "bushing_time": ("s", 5e-3, 60e-3)}, states={"crept": "rad"},
         confused_with=("stiffening_shaft",), shaft_torque=lambda e, s, z: e.bushing_rate * (s.twist - z.crept),
         rates=lambda e, s, z: {"crept": (s.twist - z.crept) / e.bushing_time}),
    _law(None, "LooseningClamp", "A shaft whose clamp loosens steadily: −k φ t/0.5 s (drift). Source: form chosen.",
         {"loosened": ("N*m/rad", 0.05, 8.0)}, confused_with=("stiffening_shaft",),
         shaft_torque=lambda e, s, z: -e.loosened * s.twist * s.time / 0.5),
)  # fmt: skip


class TwoFlywheelsDisturbances(Effect, rig=TwoFlywheels):
    """Small effects on the flywheels that their library does not have; one parameter sets the size of each."""

    rocking: float = size_par("N*m", "torque on the rotor as the frame rocks")
    rocking_rate: float = shape_par(4.5, "Hz", "its frequency", (3.0, 7.0))
    rocking_phase: float = shape_par(0.0, "rad", "its phase", PHASE)
    drive_belt: float = size_par("N*m", "torque on the disc from a fluttering belt")
    belt_rate: float = shape_par(55.0, "Hz", "its frequency", (40.0, 75.0))
    one_sided: float = size_par("-", "relative gain error of the motor, opposite for positive and negative torque")
    tight_cable: float = size_par("N*m", "torque of a cable that becomes taut within 0.2 s")

    def rotor_torque(self, s, z):
        """Torque of the rocking frame and of the cable [N·m]."""
        rocking = self.rocking * jnp.sin(2.0 * jnp.pi * self.rocking_rate * s.time + self.rocking_phase)
        return rocking + self.tight_cable * jnp.tanh(s.time / 0.2) * jnp.exp(-s.rotor_angle / 0.1)

    def disc_torque(self, s, z):
        """Torque of the fluttering belt [N·m]."""
        return self.drive_belt * jnp.sin(2.0 * jnp.pi * self.belt_rate * s.time) + 0.0 * s.disc_speed

    def torque_factor(self, s, z):
        """Gain that depends on the sign of the torque."""
        return 1.0 + self.one_sided * jnp.tanh(s.torque / 0.05)


DISTURBANCES = (
    Disturbance(TwoFlywheelsDisturbances, "rocking", 2e-3, ("rocking_rate", "rocking_phase")),
    Disturbance(TwoFlywheelsDisturbances, "drive_belt", 3e-3, ("belt_rate",)),
    Disturbance(TwoFlywheelsDisturbances, "one_sided", 5e-3),
    Disturbance(TwoFlywheelsDisturbances, "tight_cable", 2e-3),
)
DRIFTS = (RunDrift("bearings cool down", "rotor_damping", cooling_room),)
BENCH = Bench(
    "two flywheels", functools.partial(TwoFlywheels, torque=Sine(ramp_time=0.1)), (),
    {"rotor_inertia": 0.02, "disc_inertia": 0.02, "shaft_stiffness": 0.04, "shaft_damping": 0.3, "rotor_damping": 0.25,
     "disc_damping": 0.3, "holding_rate": 0.05},
    {"rotor_angle": Channel("rad", 4e-4), "rotor_speed": Channel("rad/s", 1e-2), "disc_speed": Channel("rad/s", 1e-2)},
    planned_runs(
        {"frequency": 1.0, "amplitude": 1.0},
        ("fit", 0.9, 4.1, 0.3), ("fit", 0.7, 7.3, 0.6), ("fit", 0.6, 11.7, 0.8), ("fit", 0.5, 19.4, 0.4),
        ("fit", 0.5, 27.9, 0.4), ("fit", 0.6, 9.2, 0.25), ("holdout", 0.6, 14.6, 0.7),
    ), 1e-3, 1.0, step=5e-5,
)  # fmt: skip
