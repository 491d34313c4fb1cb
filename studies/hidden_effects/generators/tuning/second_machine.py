"""A machine that the package does not have, for the tuning cases: a filter of two coils and two capacitors.

It lies between a voltage source and a load.
"""

import functools

import jax.numpy as jnp

from edhas_jax import Rig, Sine, drive, par, slot, state
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.campaign import Channel
from studies.hidden_effects.generators.benches import Bench, planned_runs
from studies.hidden_effects.generators.disturbances import PHASE, Disturbance, shape_par, size_par
from studies.hidden_effects.generators.laws import law
from studies.hidden_effects.generators.settings import RunDrift
from studies.hidden_effects.generators.tuning.settings import warmer_in_sessions


class LadderFilter(Rig):
    """A ladder of coils and capacitors: L_1 di_1/dt = u − R_1 i_1 − u_1, C_1 du_1/dt = i_1 − i_2, and so on to a load.

    Source: Kirchhoff; ladder networks, Zverev, Handbook of Filter Synthesis (1967).
    """

    time_step, duration = 2e-5, 0.15  # s

    source = drive("V", "voltage of the source", 0.0)

    first_inductance: float = par(20e-3, "H", (1e-6, 10.0), "inductance L_1")
    second_inductance: float = par(10e-3, "H", (1e-6, 10.0), "inductance L_2")
    first_capacity: float = par(100e-6, "F", (1e-9, 1.0), "capacity C_1")
    second_capacity: float = par(47e-6, "F", (1e-9, 1.0), "capacity C_2")
    first_resistance: float = par(2.0, "ohm", (1e-3, 1e4), "resistance of the first coil")
    second_resistance: float = par(3.0, "ohm", (1e-3, 1e4), "resistance of the second coil")
    load_resistance: float = par(30.0, "ohm", (1e-2, 1e6), "resistance of the load")

    first_current = state("A", "current of the first coil", 0.0)
    second_current = state("A", "current of the second coil", 0.0)
    middle_voltage = state("V", "voltage of the first capacitor", 0.0)
    load_voltage = state("V", "voltage of the load", 0.0)

    first_drop = slot("first_coil", "V", "additional drop at the first coil", ("first_current", "middle_voltage"), 0.1)
    core_factor = slot("first_coil", "-", "multiplies the first inductance", "first_current", 0.05, scales=True)
    second_drop = slot("second_coil", "V", "additional drop at the second coil", "second_current", 0.1)
    middle_loss = slot("first_capacitor", "A", "leakage current of the first capacitor", "middle_voltage", 0.02)
    load_loss = slot("load", "A", "additional current of the load", ("load_voltage", "second_current"), 0.02)

    def equations(self, y, s):
        """The rates of currents and voltages."""
        zero = 0.0 * y.first_current
        inductance = self.first_inductance * self.core_factor.apply(1.0 + zero, s)
        first = s.source - self.first_resistance * y.first_current - y.middle_voltage - self.first_drop.apply(zero, s)
        second = y.middle_voltage - self.second_resistance * y.second_current - y.load_voltage
        load = y.load_voltage / self.load_resistance + self.load_loss.apply(zero, s)
        return {
            "first_current": first / inductance,
            "second_current": (second - self.second_drop.apply(zero, s)) / self.second_inductance,
            "middle_voltage": (y.first_current - y.second_current - self.middle_loss.apply(zero, s))
            / self.first_capacity,
            "load_voltage": (y.second_current - load) / self.second_capacity,
        }


_law = functools.partial(law, rig=LadderFilter)


def _core_rates(e, s, z):
    slope = (s.source - s.middle_voltage - s.first_resistance * s.first_current) / s.first_inductance
    return {"domain": slope / e.coercive_current * (1.0 - z.domain * jnp.tanh(slope / 25.0))}


# fmt: off
CORE = _law(None, "CoreSaturation",
            "A core that saturates: L/(1 + (i/i_s)²), b = 1/i_s². Source: Fröhlich's curve, even.",
            {"core_slope": ("1/A^2", 0.01, 3.0)},
            core_factor=lambda e, s, z: 1.0 / (1.0 + e.core_slope * jnp.square(s.first_current))).kind
CONTACT = _law(None, "ContactDrop", "A contact with a constant drop: V tanh(i/15 mA). Source: Holm, Electric Contacts.",
               {"contact_voltage": ("V", 0.01, 0.8)},
               second_drop=lambda e, s, z: e.contact_voltage * jnp.tanh(s.second_current / 0.015)).kind
ABSORPTION = _law(None, "DielectricAbsorption", "A capacitor that absorbs charge: g (u − u_a), du_a/dt = (u − u_a)/τ. "
                  "Source: Dow, IRE Trans. Electronic Computers EC-7 (1958) 17, one branch.",
                  {"absorbing": ("1/ohm", 2e-4, 0.03), "absorption_time": ("s", 1e-3, 2e-2)}, states={"absorbed": "V"},
                  middle_loss=lambda e, s, z: e.absorbing * (s.middle_voltage - z.absorbed),
                  rates=lambda e, s, z: {"absorbed": (s.middle_voltage - z.absorbed) / e.absorption_time}).kind
CLAMP = _law(None, "LoadClamp", "A diode across the load that conducts at positive voltage: I (exp(u/1.5 V) − 1). "
             "Source: Shockley (1949).", {"clamp_current": ("A", 1e-4, 0.02)}, load_loss=lambda e, s, z:
             e.clamp_current * (jnp.exp(jnp.minimum(s.load_voltage / 1.5, 6.0)) - 1.0)).kind
WINDING = _law(None, "WindingHeat", "A winding whose resistance rises as it heats up: R_1 a ϑ i, 40 ms dϑ/dt = i² − ϑ. "
               "Source: Joule.",
               {"winding_rise": ("1/A^2", 0.05, 6.0)}, states={"warmth": "A^2"},
               first_drop=lambda e, s, z: s.first_resistance * e.winding_rise * z.warmth * s.first_current,
               rates=lambda e, s, z: {"warmth": (jnp.square(s.first_current) - z.warmth) / 0.04}).kind
# fmt: on
LIBRARY: tuple[type[Effect], ...] = (CORE, CONTACT, ABSORPTION, CLAMP, WINDING)
LAWS = (
    _law(CORE, "BiasedCore", "A core with remanence, which saturates at positive currents only: L/(1 + b max(i, 0)). "
         "Source: Bozorth, Ferromagnetism (1951); form chosen.", {"bias_slope": ("1/A", 0.01, 2.0)},
         core_factor=lambda e, s, z: 1.0 / (1.0 + e.bias_slope * jnp.maximum(s.first_current, 0.0))),
    _law(CONTACT, "OxideContact",
         "A contact with an oxide film: V i/√(i² + (80 mA)²). Source: Holm, Electric Contacts; "
         "form chosen.", {"oxide_voltage": ("V", 0.02, 1.0)}, second_drop=lambda e, s, z:
         e.oxide_voltage * s.second_current / jnp.sqrt(jnp.square(s.second_current) + 0.08**2)),
    _law(ABSORPTION, "TwofoldAbsorption", "A capacitor that absorbs charge at two rates, 2 ms and 15 ms. Source: Dow "
         "(1958), two branches.", {"twofold": ("1/ohm", 1e-4, 0.02)}, states={"fast": "V", "slow": "V"},
         middle_loss=lambda e, s, z: e.twofold * (2.0 * s.middle_voltage - z.fast - z.slow), rates=lambda e, s, z:
         {"fast": (s.middle_voltage - z.fast) / 2e-3, "slow": (s.middle_voltage - z.slow) / 15e-3}),
    _law(CLAMP, "VaristorClamp",
         "A varistor across the load: I (u/2 V)³. Source: Levinson, Philipp, J. Applied Physics "
         "46 (1975) 1332; exponent chosen.", {"varistor_current": ("A", 5e-4, 0.1)}, load_loss=lambda e, s, z:
         e.varistor_current * (s.load_voltage / 2.0) * jnp.square(s.load_voltage / 2.0)),
    _law(WINDING, "CrowdedWinding", "A winding whose resistance grows with the current without lag: R_1 a |i| i. "
         "Source: current crowding; form chosen.", {"crowding": ("1/A", 0.02, 3.0)}, first_drop=lambda e, s, z:
         s.first_resistance * e.crowding * jnp.abs(s.first_current) * s.first_current),
)  # fmt: skip
UNLISTED = (
    _law(None, "CoreHysteresis", "Hysteresis of the core: a drop V r, dr/dt = (di/dt/i_c) (1 − r sgn(di/dt)) (memory). "
         "Source: Coleman, Hodgdon (1986), simplest form.",
         {"core_voltage": ("V", 0.02, 1.0), "coercive_current": ("A", 0.02, 0.3)}, states={"domain": "-"},
         confused_with=("core_saturation", "winding_heat"),
         first_drop=lambda e, s, z: e.core_voltage * z.domain, rates=_core_rates),
    _law(None, "StrayCoupling",
         "Coils that couple through their currents: −M i_1 i_2/(1 A) as a drop (current × current). "
         "Source: form chosen.", {"stray_voltage": ("V", -2.0, 2.0)}, confused_with=("contact_drop", "core_saturation"),
         second_drop=lambda e, s, z: e.stray_voltage * s.first_current * s.second_current),
    _law(None, "DryingCapacitor", "A capacitor whose leakage grows linearly: g u t/0.1 s (drift). Source: form chosen.",
         {"drying": ("1/ohm", 2e-4, 0.03)}, confused_with=("dielectric_absorption",),
         middle_loss=lambda e, s, z: e.drying * s.middle_voltage * s.time / 0.1),
    _law(None, "SwitchingLoad", "A further load that switches on above 2 V, of either sign: I tanh(max(|u| − 2 V, "
         "0)/0.5 V) sgn u. Source: form chosen.", {"switched": ("A", 2e-3, 0.15)}, confused_with=("load_clamp",),
         load_loss=lambda e, s, z: e.switched * jnp.tanh(s.load_voltage)
         * jnp.tanh(jnp.maximum(jnp.abs(s.load_voltage) - 2.0, 0.0) / 0.5)),
)  # fmt: skip


class LadderDisturbances(Effect, rig=LadderFilter):
    """Small effects on the filter that its library does not have; one parameter sets the size of each."""

    mains_hum: float = size_par("V", "mains hum induced in the first coil")
    hum_phase: float = shape_par(0.0, "rad", "its phase", PHASE)
    radio: float = size_par("A", "interference current in the load")
    radio_rate: float = shape_par(700.0, "Hz", "its frequency", (500.0, 900.0))
    rectified: float = size_par("V", "voltage by rectification in a joint of the second coil, at 0.2 A")
    warming_load: float = size_par("1/ohm", "conductance by which the load falls linearly with time, at 0.1 s")

    def first_drop(self, s, z):
        """Mains hum [V]."""
        return self.mains_hum * jnp.sin(2.0 * jnp.pi * 50.0 * s.time + self.hum_phase)

    def second_drop(self, s, z):
        """Rectified voltage [V]."""
        return self.rectified * jnp.square(s.second_current / 0.2)

    def load_loss(self, s, z):
        """Interference and change of the load [A]."""
        radio = self.radio * jnp.sin(2.0 * jnp.pi * self.radio_rate * s.time)
        return radio - self.warming_load * s.load_voltage * s.time / 0.1


DISTURBANCES = (
    Disturbance(LadderDisturbances, "mains_hum", 0.02, ("hum_phase",)),
    Disturbance(LadderDisturbances, "radio", 2e-3, ("radio_rate",)),
    Disturbance(LadderDisturbances, "rectified", 0.02),
    Disturbance(LadderDisturbances, "warming_load", 5e-4),
)
DRIFTS = (RunDrift("coil warms up", "first_resistance", warmer_in_sessions),)
BENCH = Bench(
    "ladder filter", functools.partial(LadderFilter, source=Sine(ramp_time=0.02)), (),
    {"first_inductance": 0.03, "second_inductance": 0.03, "first_capacity": 0.05, "second_capacity": 0.05,
     "first_resistance": 0.05, "second_resistance": 0.05, "load_resistance": 0.03},
    {"first_current": Channel("A", 2e-3), "middle_voltage": Channel("V", 6e-3), "load_voltage": Channel("V", 6e-3)},
    planned_runs(
        {"frequency": 1.0, "amplitude": 1.0},
        ("fit", 0.16, 37.0, 6.0), ("fit", 0.12, 71.0, 4.0), ("fit", 0.12, 113.0, 5.0), ("fit", 0.10, 167.0, 8.0),
        ("fit", 0.10, 241.0, 9.0), ("holdout", 0.12, 89.0, 6.0),
    ), 1e-4, 1.0, step=1e-5,
)  # fmt: skip
