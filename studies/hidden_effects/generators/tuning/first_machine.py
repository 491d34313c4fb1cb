"""A machine that the package does not have, for the tuning cases: a table on an air spring with a damping tank.

The floor under it moves.
"""

import functools
import math

import jax.numpy as jnp

from edhas_jax import Rig, Sine, drive, par, signal, slot, state
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.campaign import Channel
from studies.hidden_effects.generators.benches import Bench, planned_runs
from studies.hidden_effects.generators.disturbances import PHASE, Disturbance, shape_par, size_par
from studies.hidden_effects.generators.laws import law
from studies.hidden_effects.generators.settings import RunDrift
from studies.hidden_effects.generators.tuning.laws import bouc_wen
from studies.hidden_effects.generators.tuning.settings import warmer_in_sessions

AMBIENT, GRAVITY = 101325.0, 9.81  # Pa, m/s²
TRAVEL, RELATIVE_SPEED, DROP = 5e-3, 0.08, 4e3  # typical travel [m], speed [m/s] and pressure drop [Pa]


class AirTable(Rig):
    """A table on an air spring that exchanges air with a tank through a laminar throttle; the floor moves.

    m dv/dt = (p − p_0) A − d (v − w), V dp/dt = −n (p A (v − w) + p_0 Q), V_t dp_t/dt = n p_0 Q, Q = C (p − p_t), with
    V = V_0 + A (x − f), floor f and its speed w.

    Source: Erin, Wilson, Zapfe, J. Sound and Vibration 218 (1998) 81: two-chamber pneumatic isolators.
    """

    time_step, duration = 1e-3, 4.0  # s

    floor = drive("m", "position of the floor", 0.0)

    table_mass: float = par(60.0, "kg", (1.0, 1e4), "mass of the table")
    table_damping: float = par(80.0, "N*s/m", (0.0, 1e5), "damping of the guides")
    bellows_area: float = par(5e-3, "m^2", (1e-5, 1.0), "effective area of the spring")
    spring_volume: float = par(6e-4, "m^3", (1e-5, 1.0), "volume of air in the spring")
    tank_volume: float = par(1.5e-3, "m^3", (1e-5, 1.0), "volume of air in the tank")
    throttle: float = par(1.2e-7, "m^3/(s*Pa)", (1e-12, 1e-3), "volume flow of the throttle per pressure drop")
    exponent: float = par(1.3, "-", (1.0, 1.7), "polytropic exponent")

    table_position = state("m", "position of the table", 0.0)
    table_speed = state("m/s", "speed of the table", 0.0)
    spring_pressure = state("Pa", "pressure in the spring above that at rest", 0.0)
    tank_pressure = state("Pa", "pressure in the tank above that at rest", 0.0)
    stroke = signal("m", "position of the table relative to the floor")
    stroke_speed = signal("m/s", "rate of the stroke")
    throttle_drop = signal("Pa", "pressure drop of the throttle")

    table_force = slot("table", "N", "force on the table", ("stroke_speed", "stroke"), 5.0)
    area_factor = slot("bellows", "-", "multiplies the area of the spring", "stroke", 0.05, scales=True)
    throttle_flow = slot("throttle", "m^3/s", "additional flow from spring to tank", "throttle_drop", 5e-5)
    air_loss = slot("bellows", "m^3/s", "flow out of the spring", "spring_pressure", 2e-5)
    tank_loss = slot("tank", "m^3/s", "flow out of the tank", "tank_pressure", 2e-5)

    def equations(self, y, s):
        """The rates of all states; sets stroke, its rate and the pressure drop of the throttle."""
        s.set(stroke=y.table_position - s.floor, stroke_speed=y.table_speed - s.floor_rate,
              throttle_drop=y.spring_pressure - y.tank_pressure)  # fmt: skip
        rest = AMBIENT + self.table_mass * GRAVITY / self.bellows_area
        zero = 0.0 * y.table_speed
        area = self.bellows_area * self.area_factor.apply(1.0 + zero, s)
        flow = self.throttle * s.throttle_drop + self.throttle_flow.apply(zero, s)
        volume = self.spring_volume + self.bellows_area * s.stroke
        compression = (rest + y.spring_pressure) * area * s.stroke_speed
        force = y.spring_pressure * self.bellows_area + rest * (area - self.bellows_area)
        return {
            "table_position": y.table_speed,
            "table_speed": (force - self.table_damping * s.stroke_speed + self.table_force.apply(zero, s))
            / self.table_mass,
            "spring_pressure": -self.exponent * (compression + rest * (flow + self.air_loss.apply(zero, s))) / volume,
            "tank_pressure": self.exponent * rest * (flow - self.tank_loss.apply(zero, s)) / self.tank_volume,
        }


_law = functools.partial(law, rig=AirTable)


def _sign(s, width):
    return jnp.tanh(s.stroke_speed / width)


def _root(x, width):
    return x / jnp.sqrt(jnp.sqrt(x * x + width * width))


def _slip_rates(e, s, z):
    return {"slipped": bouc_wen(s.stroke_speed, z.slipped, 0.6, 0.4) / e.slip_length}


# fmt: off
GUIDE = _law(None, "GuideFriction", "Dry friction of the guides: −F tanh(v/4 mm/s). Source: Coulomb.",
             {"guide_level": ("N", 0.3, 12.0)}, table_force=lambda e, s, z: -e.guide_level * _sign(s, 4e-3)).kind
CABLES = _law(None, "CableStiffness", "Stiffness of cables to the table: −k x. Source: statics.",
              {"cable_rate": ("N/m", 100.0, 5000.0)}, table_force=lambda e, s, z: -e.cable_rate * s.stroke).kind
ROLLING = _law(None, "RollingArea",
               "A bellows whose area changes along the stroke: A (1 + a x/5 mm). Source: geometry.",
               {"area_slope": ("-", -0.3, 0.3)},
               area_factor=lambda e, s, z: 1.0 + e.area_slope * s.stroke / TRAVEL).kind
BYPASS = _law(None, "ThrottleBypass", "A sharp hole beside the throttle: c √Δp. Source: Bernoulli.",
              {"bypass_size": ("m^3/(s*Pa^0.5)", 1e-7, 2e-5)},
              throttle_flow=lambda e, s, z: e.bypass_size * _root(s.throttle_drop, 50.0)).kind
LEAK = _law(None, "BellowsLeak", "A porous bellows: g p, p above that at rest. Source: Darcy.",
            {"leak_size": ("m^3/(s*Pa)", 2e-10, 2e-7)}, air_loss=lambda e, s, z: e.leak_size * s.spring_pressure).kind
# fmt: on
LIBRARY: tuple[type[Effect], ...] = (GUIDE, CABLES, ROLLING, BYPASS, LEAK)
LAWS = (
    _law(GUIDE, "StribeckGuide", "Friction of the guides that falls with speed: −F (1 + 0.8 exp(−|v|/20 mm/s)) "
         "tanh(v/3 mm/s). Source: Stribeck (1902).", {"guide_size": ("N", 0.3, 8.0)}, table_force=lambda e, s, z:
         -e.guide_size * (1.0 + 0.8 * jnp.exp(-jnp.abs(s.stroke_speed) / 0.02)) * _sign(s, 3e-3)),
    _law(CABLES, "SlackCables", "Cables that are slack up to 2 mm: −k (x − 2 mm) beyond. Source: statics.",
         {"slack_rate": ("N/m", 300.0, 1e4)}, table_force=lambda e, s, z: -e.slack_rate
         * (s.stroke - 2e-3 * jnp.tanh(s.stroke / 2e-3))),
    _law(ROLLING, "BarrelArea", "A bellows with a bulge: A (1 + a exp(−(x/3 mm)²)). Source: geometry; form chosen.",
         {"bulge": ("-", -0.2, 0.2)},
         area_factor=lambda e, s, z: 1.0 + e.bulge * (jnp.exp(-jnp.square(s.stroke / 3e-3)) - 1.0)),
    _law(BYPASS, "FlapBypass", "A flap that opens above 3 kPa either way: c (Δp − 3 kPa tanh(Δp/3 kPa)). "
         "Source: flap valves; form chosen.", {"flap_size": ("m^3/(s*Pa)", 1e-8, 1e-6)},
         throttle_flow=lambda e, s, z: e.flap_size * (s.throttle_drop - 3e3 * jnp.tanh(s.throttle_drop / 3e3))),
    _law(LEAK, "SeamLeak", "A seam that leaks more when it is stretched: g p (1 + tanh(x/3 mm)). Source: form chosen.",
         {"seam_size": ("m^3/(s*Pa)", 4e-10, 2e-7)},
         air_loss=lambda e, s, z: e.seam_size * s.spring_pressure * (1.0 + jnp.tanh(s.stroke / 3e-3))),
)  # fmt: skip
UNLISTED = (
    _law(None, "CordHysteresis",
         "Hysteresis of the cords in the bellows: −F r, w dr/dt = v − 0.6 |v| r |r| − 0.4 v r². "
         "Source: Wen (1976); Berg, Vehicle System Dynamics 30 (1998) 197, for air springs.",
         {"cord_level": ("N", 1.0, 30.0), "slip_length": ("m", 1e-3, 6e-3)}, states={"slipped": "-"},
         confused_with=("guide_friction", "cable_stiffness"),
         table_force=lambda e, s, z: -e.cord_level * z.slipped, rates=_slip_rates),
    _law(None, "PinchedThrottle", "A throttle hose that the table pinches: −0.6 c Δp (1 + tanh(x/2 mm))/2 (pressure × "
         "position). Source: form chosen.", {"pinch": ("m^3/(s*Pa)", 1e-8, 1.5e-7)}, confused_with=("throttle_bypass",),
         throttle_flow=lambda e, s, z: -0.3 * e.pinch * s.throttle_drop * (1.0 + jnp.tanh(s.stroke / 2e-3))),
    _law(None, "CoolingTank", "Heat that the wall of the tank takes up: the pressure relaxes as if air left, "
         "g (p_t − p_w), dp_w/dt = (p_t − p_w)/τ (memory). Source: Pourmovahed, Otis (1990).",
         {"wall_size": ("m^3/(s*Pa)", 2e-9, 2e-7), "wall_time": ("s", 0.05, 0.6)}, states={"wall": "Pa"},
         confused_with=("bellows_leak", "throttle_bypass"),
         tank_loss=lambda e, s, z: e.wall_size * (s.tank_pressure - z.wall),
         rates=lambda e, s, z: {"wall": (s.tank_pressure - z.wall) / e.wall_time}),
    _law(None, "DryingGuides", "Friction of the guides that grows linearly with time: −F t/2 s tanh(v/4 mm/s) (drift). "
         "Source: form chosen.", {"drift_level": ("N", 0.5, 12.0)}, confused_with=("guide_friction",),
         table_force=lambda e, s, z: -e.drift_level * s.time / 2.0 * _sign(s, 4e-3)),
)  # fmt: skip


class AirTableDisturbances(Effect, rig=AirTable):
    """Small effects on the table that its library does not have; one parameter sets the size of each."""

    footsteps: float = size_par("N", "force of footsteps on the table")
    step_rate: float = shape_par(1.7, "Hz", "frequency of the steps", (1.4, 2.3))
    step_phase: float = shape_par(0.0, "rad", "phase of the steps", PHASE)
    pump_pulses: float = size_par("N", "oscillating force of a vacuum pump")
    pulse_rate: float = shape_par(14.0, "Hz", "frequency of the pump", (11.0, 19.0))
    room_warming: float = size_par("m^3/s", "slow temperature change of the tank, as a flow out of it, at 1 s")
    draught: float = size_par("N", "air drag, proportional to the square of the speed, at 0.08 m/s")

    def table_force(self, s, z):
        """Force of footsteps, pump and air drag [N]."""
        steps = jnp.exp(8.0 * (jnp.cos(2.0 * jnp.pi * self.step_rate * s.time + self.step_phase) - 1.0))
        pulses = self.pump_pulses * jnp.sin(2.0 * jnp.pi * self.pulse_rate * s.time)
        u = s.stroke_speed / RELATIVE_SPEED
        return self.footsteps * steps + pulses - self.draught * u * jnp.abs(u)

    def tank_loss(self, s, z):
        """Temperature change of the tank as a flow out of it [m³/s]."""
        return self.room_warming * (s.time + 0.0 * s.stroke)


DISTURBANCES = (
    Disturbance(AirTableDisturbances, "footsteps", 0.5, ("step_rate", "step_phase")),
    Disturbance(AirTableDisturbances, "pump_pulses", 0.5, ("pulse_rate",)),
    Disturbance(AirTableDisturbances, "room_warming", 1e-6),
    Disturbance(AirTableDisturbances, "draught", 0.3),
)
DRIFTS = (RunDrift("throttle warms up", "throttle", warmer_in_sessions),)
BENCH = Bench(
    "air table", functools.partial(AirTable, floor=Sine(ramp_time=0.4)), (),
    {"table_mass": 0.02, "table_damping": 0.3, "spring_volume": 0.08, "tank_volume": 0.06, "throttle": 0.2,
     "exponent": 0.03},
    {"stroke": Channel("mm", 1.5e-5), "table_speed": Channel("m/s", 3e-4), "spring_pressure": Channel("Pa", 25.0),
     "tank_pressure": Channel("Pa", 25.0)},
    planned_runs(
        {"frequency": 1.0, "amplitude": 1e-3},
        ("fit", 4.0, 1.1, 2.5), ("fit", 3.2, 2.3, 1.2), ("fit", 2.6, 3.4, 2.0), ("fit", 2.4, 5.2, 2.5),
        ("fit", 3.2, 1.7, 2.0), ("holdout", 3.0, 2.8, 1.5),
    ), 4e-3, 1.0, step=math.ldexp(1.0, -12),
)  # fmt: skip
