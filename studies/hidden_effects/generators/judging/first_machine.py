"""A machine that the package does not have, for the judging cases: a heated tip on a body in a case.

The voltage of the heater varies about a mean.
"""

import functools

import jax.numpy as jnp

from edhas_jax import Rig, Sine, drive, par, signal, slot, state
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.campaign import Channel
from studies.hidden_effects.generators.benches import Bench, planned_runs
from studies.hidden_effects.generators.disturbances import PHASE, Disturbance, shape_par, size_par
from studies.hidden_effects.generators.functions import smooth_positive
from studies.hidden_effects.generators.judging.settings import cooling_room
from studies.hidden_effects.generators.laws import law
from studies.hidden_effects.generators.settings import RunDrift

ROOM, STEFAN_BOLTZMANN = 293.15, 5.67e-8  # K, W/(m²·K⁴)
WARM = 60.0  # K above the room, a typical temperature of the tip


class HeatedTip(Rig):
    """An electrically heated tip, a body and a case, each with a uniform temperature; T is counted from the room's.

    C_1 dT_1/dt = U²/R − G_1 (T_1 − T_2) − H_1 T_1, C_2 dT_2/dt = G_1 (T_1 − T_2) − G_2 (T_2 − T_3),
    C_3 dT_3/dt = G_2 (T_2 − T_3) − H_3 T_3, with the voltage U = U_0 + u.

    Source: lumped thermal networks; Incropera, DeWitt, Fundamentals of Heat and Mass Transfer.
    """

    time_step, duration = 5e-4, 1.2  # s

    swing = drive("V", "voltage of the heater minus its mean", 0.0)

    mean_voltage: float = par(14.0, "V", (0.0, 1e3), "mean voltage of the heater")
    heater_resistance: float = par(20.0, "ohm", (1e-2, 1e4), "resistance of the heater")
    tip_capacity: float = par(0.025, "J/K", (1e-4, 1e4), "heat capacity of the tip")
    body_capacity: float = par(0.08, "J/K", (1e-4, 1e4), "heat capacity of the body")
    case_capacity: float = par(0.25, "J/K", (1e-4, 1e5), "heat capacity of the case")
    tip_joint: float = par(0.6, "W/K", (1e-4, 1e4), "thermal conductance from tip to body")
    case_joint: float = par(0.9, "W/K", (1e-4, 1e4), "thermal conductance from body to case")
    tip_cooling: float = par(0.08, "W/K", (0.0, 1e3), "thermal conductance from the tip to the room")
    case_cooling: float = par(0.5, "W/K", (0.0, 1e3), "thermal conductance from the case to the room")

    tip_temperature = state("K", "temperature of the tip above the room", 0.0)
    body_temperature = state("K", "temperature of the body above the room", 0.0)
    case_temperature = state("K", "temperature of the case above the room", 0.0)
    heater_voltage = signal("V", "voltage of the heater")
    joint_drop = signal("K", "temperature of the tip above the body")

    heater_factor = slot("tip", "-", "factor of the power", ("tip_temperature", "heater_voltage"), 0.05, scales=True)
    tip_loss = slot("tip", "W", "additional heat loss of the tip", ("tip_temperature", "heater_voltage"), 0.5)
    joint_heat = slot("body", "W", "additional heat flow from tip to body", ("joint_drop", "heater_voltage"), 0.5)
    body_loss = slot("body", "W", "additional heat loss of the body", ("body_temperature", "joint_drop"), 0.5)
    case_loss = slot("case", "W", "additional heat loss of the case", "case_temperature", 0.5)

    def equations(self, y, s):
        """The rates of the temperatures; sets the heater voltage and the temperature drop at the joint."""
        zero = 0.0 * y.tip_temperature
        s.set(heater_voltage=self.mean_voltage + s.swing + zero, joint_drop=y.tip_temperature - y.body_temperature)
        power = jnp.square(s.heater_voltage) / self.heater_resistance * self.heater_factor.apply(1.0 + zero, s)
        first = self.tip_joint * s.joint_drop + self.joint_heat.apply(zero, s)
        second = self.case_joint * (y.body_temperature - y.case_temperature)
        tip = power - first - self.tip_cooling * y.tip_temperature - self.tip_loss.apply(zero, s)
        case = second - self.case_cooling * y.case_temperature - self.case_loss.apply(zero, s)
        return {
            "tip_temperature": tip / self.tip_capacity,
            "body_temperature": (first - second - self.body_loss.apply(zero, s)) / self.body_capacity,
            "case_temperature": case / self.case_capacity,
        }


_law = functools.partial(law, rig=HeatedTip)


def _radiated(t, more=0.0):
    """Net radiation [W/m²] of a surface `t` [K] above the room, with an emissivity that grows by `more` [1/K]."""
    hot = jnp.square(jnp.square(ROOM + jnp.maximum(t, -ROOM)))
    return STEFAN_BOLTZMANN * (hot - ROOM**4) * (1.0 + more * t)


# fmt: off
RADIATION = _law(None, "TipRadiation", "Radiation of the tip: A σ (T⁴ − T_0⁴). Source: Stefan, Boltzmann.",
                 {"radiating_area": ("m^2", 1e-4, 1.5e-2)},
                 tip_loss=lambda e, s, z: e.radiating_area * _radiated(s.tip_temperature)).kind
HEATER = _law(None, "HeaterRise", "A heater whose resistance rises with temperature: power/(1 + α T). "
              "Source: resistivity of metals.",
              {"rise_per_kelvin": ("1/K", 5e-5, 6e-3)},
              heater_factor=lambda e, s, z: 1.0 / (1.0 + e.rise_per_kelvin * s.tip_temperature)).kind
BUOYANCY = _law(None, "BuoyantCooling", "Free convection of the case: h T (T/20 K)^¼, T > 0. Source: McAdams (1954).",
                {"buoyant_loss": ("W/K", 0.01, 0.8)}, case_loss=lambda e, s, z: e.buoyant_loss * s.case_temperature
                * jnp.sqrt(jnp.sqrt((jnp.maximum(s.case_temperature, 0.0) + 1e-3) / 20.0))).kind
PELTIER = _law(None, "PeltierHeat", "Peltier heat that the heater current carries into the body: Π U. Source: Peltier.",
               {"peltier_current": ("A", -0.2, 0.2)},
               joint_heat=lambda e, s, z: e.peltier_current * s.heater_voltage).kind
STORE = _law(None, "SlowStore", "A filling of the body that stores heat: G (T_2 − T_f), τ dT_f/dt = T_2 − T_f. "
             "Source: one lumped heat capacity.",
             {"filling": ("W/K", 0.04, 2.0), "filling_time": ("s", 0.05, 0.5)}, states={"filled": "K"},
             body_loss=lambda e, s, z: e.filling * (s.body_temperature - z.filled),
             rates=lambda e, s, z: {"filled": (s.body_temperature - z.filled) / e.filling_time}).kind
# fmt: on
LIBRARY: tuple[type[Effect], ...] = (RADIATION, HEATER, BUOYANCY, PELTIER, STORE)
LAWS = (
    _law(RADIATION, "OxidisedRadiation", "Radiation with an emissivity that grows with temperature: "
         "A σ (T⁴ − T_0⁴) (1 + T/80 K). Source: oxidised metals; Siegel, Howell, Thermal Radiation Heat Transfer.",
         {"dull_area": ("m^2", 1e-4, 1e-2)},
         tip_loss=lambda e, s, z: e.dull_area * _radiated(s.tip_temperature, 1.0 / 80.0)),
    _law(HEATER, "SwitchingHeater", "A heater whose resistance rises steeply near 60 K: power (1 − β (1 + tanh((T − "
         "60 K)/8 K))/2). Source: PTC ceramics; form chosen.", {"switched_share": ("-", 0.01, 0.4)},
         heater_factor=lambda e, s, z:
         1.0 - e.switched_share * 0.5 * (1.0 + jnp.tanh((s.tip_temperature - WARM) / 8.0))),
    _law(BUOYANCY, "OnsetCooling", "Convection of the case that sets in at 8 K: h max(T − 8 K, 0), rounded within 2 K. "
         "Source: onset of convection cells; Rayleigh (1916); form chosen.", {"onset_loss": ("W/K", 0.01, 1.5)},
         case_loss=lambda e, s, z: e.onset_loss * smooth_positive(s.case_temperature - 8.0, 2.0)),
    _law(PELTIER, "LeadHeat", "Joule heat of the leads that flows into the body: k |U|³/(14 V)³. Source: Joule; a lead "
         "that warms up; form chosen.", {"lead_power": ("W", -2.0, 2.0)}, joint_heat=lambda e, s, z: e.lead_power
         * jnp.square(s.heater_voltage / 14.0) * jnp.sqrt(jnp.square(s.heater_voltage / 14.0) + 1e-4)),
    _law(STORE, "SpreadStore", "A filling that stores heat with two time constants, 40 and 300 ms. Source: conduction "
         "into thick layers, Foster network with two elements.",
         {"layer": ("W/K", 0.02, 1.0)}, states={"near": "K", "far": "K"},
         body_loss=lambda e, s, z: e.layer * (2.0 * s.body_temperature - z.near - z.far), rates=lambda e, s, z:
         {"near": (s.body_temperature - z.near) / 0.04, "far": (s.body_temperature - z.far) / 0.3}),
)  # fmt: skip
UNLISTED = (
    _law(None, "DryingPaste", "Paste on the tip that takes up heat as it dries: q (1 − w) u, dw/dt = (1 − w) u/0.4 s, "
         "u = max(T, 0)/60 K (memory). Source: first-order drying; Lewis (1921).",
         {"drying_power": ("W", 0.1, 8.0)}, states={"dried": "-"}, confused_with=("tip_radiation", "heater_rise"),
         tip_loss=lambda e, s, z: e.drying_power * (1.0 - z.dried) * jnp.maximum(s.tip_temperature, 0.0) / WARM,
         rates=lambda e, s, z: {"dried": (1.0 - z.dried) * jnp.maximum(s.tip_temperature, 0.0) / WARM / 0.4}),
    _law(None, "OpeningJoint", "A joint that conducts less as the body warms up: −g (T_1 − T_2) T_2/30 K (drop × "
         "temperature). Source: thermal strain; form chosen.", {"opened": ("W/K", 5e-3, 0.3)},
         confused_with=("peltier_heat", "slow_store"),
         joint_heat=lambda e, s, z: -e.opened * s.joint_drop * s.body_temperature / 30.0),
    _law(None, "AgeingHeater", "A heater whose power falls linearly: 1 − ε t/1 s (drift). Source: form chosen.",
         {"aged": ("-", 3e-3, 0.2)}, confused_with=("heater_rise",),
         heater_factor=lambda e, s, z: 1.0 - e.aged * s.time),
    _law(None, "LeakingInsulation", "Body heated by leakage current through its warm insulation: −k U² T_2/30 K "
         "(voltage × temperature). Source: resistivity of ceramics; form chosen.", {"shunt": ("W/V^2", 2e-4, 0.02)},
         confused_with=("peltier_heat", "slow_store"), body_loss=lambda e, s, z:
         -e.shunt * jnp.square(s.heater_voltage) * s.body_temperature / 30.0),
)  # fmt: skip


class HeatedTipDisturbances(Effect, rig=HeatedTip):
    """Small effects on the tip that its library does not have; one parameter sets the size of each."""

    breeze: float = size_par("W/K", "additional conductance from tip to room by a fluctuating draught")
    breeze_rate: float = shape_par(6.0, "Hz", "its frequency", (3.0, 12.0))
    breeze_phase: float = shape_par(0.0, "rad", "its phase", PHASE)
    sunbeam: float = size_par("W", "heat of sunlight that falls on the case from a certain time on")
    sunrise: float = shape_par(0.3, "s", "time from which the sun shines", (0.15, 0.4))
    weak_mains: float = size_par("-", "relative fluctuation of the heating power with the mains")
    mains_beat: float = shape_par(17.0, "Hz", "frequency of the fluctuation", (13.0, 29.0))
    warming_room: float = size_par("W", "heat flow into the body from a room that warms up steadily, at 1 s")

    def tip_loss(self, s, z):
        """Heat loss by the draught [W]."""
        return self.breeze * s.tip_temperature * jnp.sin(
            2.0 * jnp.pi * self.breeze_rate * s.time + self.breeze_phase)  # fmt: skip

    def case_loss(self, s, z):
        """Heat of the sun, as a negative loss [W]."""
        return -self.sunbeam * 0.5 * (1.0 + jnp.tanh((s.time - self.sunrise) / 0.02)) + 0.0 * s.case_temperature

    def heater_factor(self, s, z):
        """Fluctuation of the heating power."""
        return 1.0 + self.weak_mains * jnp.sin(2.0 * jnp.pi * self.mains_beat * s.time)

    def body_loss(self, s, z):
        """Heat from the room, as a negative loss [W]."""
        return -self.warming_room * s.time + 0.0 * s.body_temperature


DISTURBANCES = (
    Disturbance(HeatedTipDisturbances, "breeze", 2e-3, ("breeze_rate", "breeze_phase")),
    Disturbance(HeatedTipDisturbances, "sunbeam", 0.05, ("sunrise",)),
    Disturbance(HeatedTipDisturbances, "weak_mains", 2e-3, ("mains_beat",)),
    Disturbance(HeatedTipDisturbances, "warming_room", 0.05),
)
DRIFTS = (RunDrift("heater cools down", "heater_resistance", cooling_room),)
BENCH = Bench(
    "heated tip", functools.partial(HeatedTip, swing=Sine(ramp_time=0.02)), (),
    {"heater_resistance": 0.02, "tip_capacity": 0.05, "body_capacity": 0.05, "case_capacity": 0.08, "tip_joint": 0.06,
     "case_joint": 0.06, "tip_cooling": 0.2, "case_cooling": 0.1},
    {"tip_temperature": Channel("K", 0.04), "body_temperature": Channel("K", 0.025),
     "case_temperature": Channel("K", 0.02)},
    planned_runs(
        {"frequency": 1.0, "amplitude": 1.0, "mean_voltage": 1.0},
        ("fit", 1.2, 1.1, 8.0, 14.0), ("fit", 1.0, 2.3, 10.0, 11.0), ("fit", 0.8, 4.1, 9.0, 18.0),
        ("fit", 0.6, 8.3, 12.0, 15.0), ("fit", 0.9, 1.7, 6.0, 20.0), ("holdout", 0.9, 2.9, 8.0, 16.0),
    ), 1.2e-3, 1.0, step=1e-4,
)  # fmt: skip
