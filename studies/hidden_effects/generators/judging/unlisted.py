"""Laws of mechanisms that the library does not have, for the judging cases.

Each depends on two variables, has a memory, or drifts with time.
"""

import math

import jax.numpy as jnp

from edhas_jax.machine.effects.reference_scales import smooth_sign
from studies.hidden_effects.generators.judging.laws import TURN, USUAL, gap_drop, gauge, travel_share
from studies.hidden_effects.generators.laws import law
from studies.hidden_effects.generators.places import is_chamber_b


def _grip(e, s, z):
    return e.nut_grip * jnp.tanh((s.piston_velocity - z.nut_speed) / 8e-3)


def _late_lip(e, s, z):
    return e.lip_gap * gap_drop(s) * (1.0 - (z.closed_b if is_chamber_b(s) else z.closed_a))


def _late_lip_rates(e, s, z):
    over = {n: jnp.square((getattr(s, f"chamber_pressure_{n}") - s.accumulator_pressure) / 0.3e6) for n in "ab"}
    return {f"closed_{n}": (u / (1.0 + u) - getattr(z, f"closed_{n}")) / e.lip_time for n, u in over.items()}


def _ringing_rates(e, s, z):
    omega = 2.0 * math.pi * e.ring_rate
    return {"ring": omega * z.ring_slope, "ring_slope": omega * (s.voltage - z.ring - 0.5 * z.ring_slope)}


def _hung(e, s, z):
    """Force per kilogram that a mass suspended from the load exerts on it."""
    omega = 2.0 * math.pi * e.swing_rate
    return omega * omega * z.swung + 0.1 * omega * (z.swing_speed - s.cylinder_velocity)


LEAKS = ("piston_leakage", "suction_seat_leakage", "delivery_seat_leakage")
FRICTIONS = ("lugre_friction", "stroke_dependent_friction", "asymmetric_friction", "seal_friction")
MOTORS = ("magnetic_saturation", "force_constant_droop", "reluctance_force")
VOLTAGES = ("inverter_dead_time", "amplifier_lag", "coil_heating", "supply_sag")
BALLS = ("valve_flow_force", "valve_adhesion")
UNLISTED = (
    law(None, "LeakyAirSpring", "Trapped air behind the mover that leaks: −k (x − x_l), τ dx_l/dt = x − x_l (memory). "
        "Source: dashpots with a vent; Den Hartog, Mechanical Vibrations (1934).",
        {"trapped_rate": ("N/m", 150.0, 8e3), "vent_time": ("s", 3e-3, 30e-3)}, states={"vented": "m"},
        confused_with=("parasitic_spring", "eddy_drag", "coupling_compliance"),
        mover_force=lambda e, s, z: -e.trapped_rate * (s.piston_position - z.vented),
        rates=lambda e, s, z: {"vented": (s.piston_position - z.vented) / e.vent_time}),
    law(None, "CoveredVent", "Air that is forced through a vent which the mover covers: −c v |v| (1 + tanh(x/1.2 "
        "mm))/2 (position × speed). Source: flow through an orifice of changing area; Bernoulli.",
        {"vent_drag": ("N*s^2/m^2", 5.0, 400.0)}, confused_with=("eddy_drag", "asymmetric_damping", *FRICTIONS),
        mover_force=lambda e, s, z: -e.vent_drag * s.piston_velocity * jnp.abs(s.piston_velocity)
        * 0.5 * (1.0 + jnp.tanh(s.piston_position / 1.2e-3))),
    law(None, "FilmFriction", "Dry friction that falls as a lubricating film builds up: F th(v)/(1 + w), "
        "50 ms dw/dt = |v|/40 mm/s − w (memory). Source: mixed lubrication with a lag; Hess, Soom, J. Tribology 112 "
        "(1990) 147; form chosen.", {"bare_level": ("N", 1.0, 20.0)}, states={"film": "-"}, confused_with=FRICTIONS,
        mover_friction=lambda e, s, z: e.bare_level * smooth_sign(s.sliding_velocity) / (1.0 + z.film),
        rates=lambda e, s, z: {"film": (jnp.abs(s.sliding_velocity) / 0.04 - z.film) / 50e-3}),
    law(None, "PolishedGuide", "Dry friction that falls with the distance travelled: F exp(−w/30 mm) th(v), dw/dt = "
        "|v| (drift). "
        "Source: running-in; Blau, Friction Science and Technology (2009).", {"rough_level": ("N", 0.8, 15.0)},
        states={"travel": "m"}, confused_with=FRICTIONS, mover_friction=lambda e, s, z:
        e.rough_level * jnp.exp(-z.travel / 30e-3) * smooth_sign(s.sliding_velocity),
        rates=lambda e, s, z: {"travel": jnp.abs(s.sliding_velocity)}),
    law(None, "CantedPlunger", "Dry friction of plungers that pressure tilts when they are extended: "
        "F |p_A − p_B|/0.5 MPa |x|/x_m th(v) (pressure × position), rounded. Source: side force of overhung plungers; "
        "Ivantysyn (2001).", {"cant_level": ("N", 0.5, 15.0)}, confused_with=FRICTIONS, mover_friction=lambda e, s, z:
        e.cant_level
        * jnp.sqrt(jnp.square((s.chamber_pressure_a - s.chamber_pressure_b) / USUAL * travel_share(s)) + 1e-4)
        * smooth_sign(s.sliding_velocity)),
    law(None, "LooseNut", "A loose nut of 25 g that slides on the mover: −F th, th = tanh((v − v_n)/8 mm/s), "
        "25 g dv_n/dt = F th (memory). Source: Coulomb dampers, Lanchester (1914).", {"nut_grip": ("N", 0.1, 4.0)},
        states={"nut_speed": "m/s"}, confused_with=("coupling_compliance", "backlash", "lugre_friction"),
        mover_force=lambda e, s, z: -_grip(e, s, z), rates=lambda e, s, z: {"nut_speed": _grip(e, s, z) / 25e-3}),
    law(None, "LoadRipple", "A force ripple along the stroke that grows with the current: F_e (1 + ε |i|/3 A sin(2π "
        "x/τ + φ)) (current × position), |i| rounded. Source: tooth saturation; Gieras, Piech, Tomczuk (2011).",
        {"load_ripple": ("-", 0.01, 0.3), "pole_length": ("m", 3e-3, 9e-3), "pole_shift": TURN},
        confused_with=(*MOTORS, "cogging_force"), motor_force_factor=lambda e, s, z: 1.0 + e.load_ripple
        * jnp.sqrt(jnp.square(s.current / 3.0) + 1e-4)
        * jnp.sin(2.0 * jnp.pi * s.piston_position / e.pole_length + e.pole_shift)),
    law(None, "DiffusingFlux", "A part of the motor force that lags the current: −K (i − i_s), τ di_s/dt = i − i_s "
        "(memory). Source: eddy currents in solid yokes; Stoll (1974), one time constant.",
        {"late_constant": ("N/A", 0.15, 6.0), "flux_time": ("s", 1e-3, 12e-3)}, states={"soaking": "A"},
        confused_with=(*MOTORS, "eddy_drag", "amplifier_lag"),
        mover_force=lambda e, s, z: -e.late_constant * (s.current - z.soaking),
        rates=lambda e, s, z: {"soaking": (s.current - z.soaking) / e.flux_time}),
    law(None, "PatchyTrack", "A sliding contact on an uneven track: −R i (1 + cos(2π x/τ + φ))/2 (current × position). "
        "Source: contact films; Holm, Electric Contacts (1967); form chosen.",
        {"patch_resistance": ("ohm", 0.03, 2.0), "patch_length": ("m", 1.5e-3, 5e-3), "patch_shift": TURN},
        confused_with=(*VOLTAGES, "force_constant_droop"), coil_voltage_change=lambda e, s, z: -e.patch_resistance
        * s.current * 0.5 * (1.0 + jnp.cos(2.0 * jnp.pi * s.piston_position / e.patch_length + e.patch_shift))),
    law(None, "FadingGain", "An amplifier whose gain falls steadily: −g u t/0.4 s (drift). Source: drift of a voltage "
        "divider.",
        {"gain_fall": ("-", 0.01, 0.3)}, confused_with=VOLTAGES,
        coil_voltage_change=lambda e, s, z: -e.gain_fall * s.voltage * s.time / 0.4),
    law(None, "RingingChoke", "A resonance of the amplifier's output filter: g (u_f − u), "
        "d²u_f/dt² = ω² (u − u_f) − 0.5 ω du_f/dt (memory). Source: LC filters; Erickson, Maksimović, Fundamentals of "
        "Power Electronics.", {"ring_share": ("-", 0.04, 0.6), "ring_rate": ("Hz", 150.0, 900.0)},
        states={"ring": "V", "ring_slope": "V"}, confused_with=("amplifier_lag", "inverter_dead_time"),
        coil_voltage_change=lambda e, s, z: e.ring_share * (z.ring - s.voltage), rates=_ringing_rates),
    law(None, "LateLip", "Leakage past a lip that closes with a lag under pressure: k Δp (1 − c), τ dc/dt = q²/(1 + "
        "q²) − c, q = Δp/0.3 MPa (memory). Source: viscoelastic lip seals; Müller, Nau (1998); form chosen.",
        {"lip_gap": ("m^3/(s*Pa)", 1e-14, 1e-11), "lip_time": ("s", 4e-3, 40e-3)},
        states={"closed_a": "-", "closed_b": "-"}, confused_with=LEAKS, chamber_leakage=_late_lip,
        rates=_late_lip_rates),
    law(None, "SiltedGap", "A leak that silts up as the pump moves: k Δp exp(−w/40 mm), dw/dt = |v| (drift). Source: "
        "silting of clearances; Hermia, Trans. IChemE 60 (1982) 183; form chosen.",
        {"open_gap": ("m^3/(s*Pa)", 1e-14, 1e-11)}, states={"passed": "m"}, confused_with=LEAKS,
        chamber_leakage=lambda e, s, z: e.open_gap * gap_drop(s) * jnp.exp(-z.passed / 40e-3),
        rates=lambda e, s, z: {"passed": jnp.abs(s.piston_velocity)}),
    law(None, "ChurnedAir", "Air that is entrained as the oil is churned: α p_atm/p² w, 60 ms dw/dt = |v|/0.2 m/s − w "
        "(memory). Source: aeration of reservoirs; form chosen.", {"churned_share": ("-", 5e-4, 0.02)},
        states={"churning": "-"}, confused_with=("entrained_air", "hose_compliance", "coupling_compliance"),
        oil_compressibility=lambda e, s, z: e.churned_share * s.atmospheric_pressure / jnp.square(s.pressure)
        * z.churning,
        rates=lambda e, s, z: {"churning": (jnp.abs(s.piston_velocity) / 0.2 - z.churning) / 60e-3}),
    law(None, "BallInStream", "Damping of the ball by the flow: −c ẏ |Δp|/0.1 MPa (pressure × lift speed), rounded. "
        "Source: damping by the momentum of the stream; Merritt (1967); form chosen.",
        {"stream_drag": ("N*s/m", 0.05, 20.0)}, confused_with=BALLS, check_valve_force=lambda e, s, z:
        -e.stream_drag * s.lift_velocity * jnp.sqrt(jnp.square(s.pressure_drop / 0.1e6) + 1e-4)),
    law(None, "SettlingSprings", "Valve springs that relax: F t/0.4 s, opening (drift). Source: relaxed springs, "
        "DIN EN 13906-1; linear in time.", {"spring_loss": ("N", 0.02, 0.6)}, confused_with=BALLS,
        check_valve_force=lambda e, s, z: e.spring_loss * s.time / 0.4 + 0.0 * s.lift),
    law(None, "CreepingHose", "A hose that expands with a lag under pressure: C w, 30 ms dw/dt = p/0.5 MPa − w "
        "(memory). Source: creep of rubber; Treloar; form chosen.", {"creep_compliance": ("m^3/Pa", 2e-14, 1e-11)},
        states={"stretch": "-"}, confused_with=("hose_compliance", "entrained_air"),
        outlet_capacity=lambda e, s, z: e.creep_compliance * z.stretch,
        rates=lambda e, s, z: {"stretch": (s.outlet_pressure / USUAL - z.stretch) / 30e-3}),
    law(None, "ShearHeatedOil", "Oil that motion heats up: viscosity/(1 + h q), dq/dt = (v/0.2 m/s)²/0.15 s (drift). "
        "Source: viscous heating without cooling; Joule.", {"heat_thinning": ("-", 0.1, 3.0)}, states={"heated": "-"},
        confused_with=("oil_temperature", *LEAKS),
        oil_viscosity_factor=lambda e, s, z: 1.0 / (1.0 + e.heat_thinning * z.heated),
        rates=lambda e, s, z: {"heated": jnp.square(s.piston_velocity / 0.2) / 0.15}),
    law(None, "CantedRod", "Friction of a rod that pressure tilts: F p_h/0.5 MPa (x/10 mm) tanh(v/2 mm/s) "
        "(pressure × position), gauge. Source: side force of an overhung rod; statics.",
        {"rod_cant": ("N", 3.0, 100.0)}, confused_with=("karnopp_friction", "cylinder_seal_friction", "load_spring"),
        cylinder_force=lambda e, s, z: -e.rod_cant * gauge(s, "head_pressure")
        / USUAL * jnp.maximum(s.cylinder_position, 0.0) / 10e-3 * jnp.tanh(s.cylinder_velocity / 2e-3)),
    law(None, "ThinningDamper", "A load damper whose oil warms up: −c v exp(−t/0.15 s) (drift). Source: viscosity "
        "that falls with temperature; form chosen.", {"load_damper": ("N*s/m", 30.0, 3000.0)},
        confused_with=("karnopp_friction", "cylinder_seal_friction"), cylinder_force=lambda e, s, z:
        -e.load_damper * s.cylinder_velocity * jnp.exp(-s.time / 0.15)),
    law(None, "HungMass", "A mass suspended from the load, displaced by y: m (ω² y + 0.1 ω ẏ), ẏ = v_m − v, "
        "dv_m/dt = −ω² y − 0.1 ω ẏ (memory). Source: Den Hartog, Mechanical Vibrations (1934).",
        {"hung_mass": ("kg", 0.03, 1.5), "swing_rate": ("Hz", 6.0, 25.0)},
        states={"swung": "m", "swing_speed": "m/s"}, confused_with=("load_spring", "karnopp_friction"),
        cylinder_force=lambda e, s, z: e.hung_mass * _hung(e, s, z), rates=lambda e, s, z:
        {"swung": z.swing_speed - s.cylinder_velocity, "swing_speed": -_hung(e, s, z)}),
    law(None, "LiftedPistonSeal", "Leakage of the cylinder past a seal that motion lifts off: k |v|/(|v| + 50 mm/s) "
        "(pressure × speed). Source: Hirano, Kaneta (1971); form chosen.",
        {"lift_leakage": ("m^3/(s*Pa)", 5e-15, 3e-12)}, confused_with=("cylinder_leakage_rise",),
        cylinder_leakage_change=lambda e, s, z: e.lift_leakage
        * jnp.abs(s.cylinder_velocity) / (jnp.abs(s.cylinder_velocity) + 0.05)),
)  # fmt: skip
