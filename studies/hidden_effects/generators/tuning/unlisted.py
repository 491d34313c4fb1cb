"""Laws of mechanisms that the library does not have, for the tuning cases.

Each depends on two variables, has a memory, or drifts with time.
"""

import math

import jax.numpy as jnp

from edhas_jax.machine.effects.reference_scales import REFERENCE_TRAVEL, smooth_sign
from studies.hidden_effects.generators.functions import smooth_positive, wrapped
from studies.hidden_effects.generators.laws import law
from studies.hidden_effects.generators.places import is_chamber_b
from studies.hidden_effects.generators.tuning.laws import ANGLE, GAUGE, bouc_wen


def _drop(s):
    return s.chamber_pressure - s.accumulator_pressure


def _pocket(e, s, z):
    """Flow [m³/s] from a chamber into its dead-end pocket."""
    filled = z.pocket_b if is_chamber_b(s) else z.pocket_a
    return e.pocket_flow * (s.chamber_pressure / GAUGE - filled)


def _pocket_rates(e, s, z):
    pressures = {"pocket_a": s.chamber_pressure_a, "pocket_b": s.chamber_pressure_b}
    return {n: (p / GAUGE - getattr(z, n)) / e.pocket_time for n, p in pressures.items()}


def _rope_rates(e, s, z):
    return {"stretched": bouc_wen(s.cylinder_velocity, z.stretched, 0.6, 0.4) / e.rope_slip}


LEAKS = ("piston_leakage", "suction_seat_leakage", "delivery_seat_leakage")
FRICTIONS = ("lugre_friction", "stroke_dependent_friction", "asymmetric_friction", "seal_friction")
MOTORS = ("magnetic_saturation", "force_constant_droop", "reluctance_force")
VOLTAGES = ("inverter_dead_time", "amplifier_lag", "coil_heating", "supply_sag")
UNLISTED = (
    law(None, "EndCushion", "Oil that is squeezed out at the ends of the stroke: −c v (x/x_m)⁴ (position × speed). "
        "Source: squeeze film, Hamrock (1991); the power is chosen.", {"cushion_size": ("N*s/m", 5.0, 500.0)},
        confused_with=("eddy_drag", *FRICTIONS), mover_force=lambda e, s, z:
        -e.cushion_size * s.piston_velocity * jnp.square(jnp.square(s.piston_position / REFERENCE_TRAVEL))),
    law(None, "DraggedMass", "A mass of oil that the mover drags along, with a lag: −d (v − v_r), "
        "τ dv_r/dt = v − v_r. Source: added mass with viscous coupling; Brennen, Added mass (1982); one lag.",
        {"drag_coupling": ("N*s/m", 2.0, 100.0), "drag_time": ("s", 3e-3, 40e-3)}, states={"dragged": "m/s"},
        confused_with=("eddy_drag", "coupling_compliance", "parasitic_spring"),
        mover_force=lambda e, s, z: -e.drag_coupling * (s.piston_velocity - z.dragged),
        rates=lambda e, s, z: {"dragged": (s.piston_velocity - z.dragged) / e.drag_time}),
    law(None, "DryingGuide", "Dry friction that grows linearly with time: F (t/0.4 s) th(v). Source: a guide that runs "
        "dry; slow drift of one coefficient.", {"drying_level": ("N", 0.5, 12.0)}, confused_with=FRICTIONS,
        mover_friction=lambda e, s, z: e.drying_level * s.time / 0.4 * smooth_sign(s.sliding_velocity)),
    law(None, "LoadedGuide", "Dry friction that current and distance from mid-stroke raise: F |i x|/(3 A x_m) th(v) "
        "(current × position). Source: side pull of an eccentric coil; form chosen.",
        {"guide_load": ("N", 0.5, 15.0)}, confused_with=FRICTIONS, mover_friction=lambda e, s, z: e.guide_load
        * jnp.abs(s.current * s.piston_position) / (3.0 * REFERENCE_TRAVEL) * smooth_sign(s.sliding_velocity)),
    law(None, "StrandedStop", "A washer on the mover that sticks before it slides: −F r, r = hysteresis of width w "
        "over position, dr/dt = (v/w) (1 − r² sgn(v r)) (memory). Source: Bliman, Sorine, Dahl-type models (1995).",
        {"washer_level": ("N", 0.5, 8.0), "washer_slip": ("m", 0.4e-3, 2e-3)}, states={"pushed": "-"},
        confused_with=(*FRICTIONS, "parasitic_spring"), mover_force=lambda e, s, z: -e.washer_level * z.pushed,
        rates=lambda e, s, z: {"pushed": (s.piston_velocity - jnp.abs(s.piston_velocity) * z.pushed
                                          * jnp.abs(z.pushed)) / e.washer_slip}),
    law(None, "ShiftedField", "A field that the current shifts along the stroke: Km (1 + κ (x/x_m) i/5 A) (current × "
        "position), in the force alone. Source: armature reaction of linear motors; Boldea (2013).",
        {"field_shift": ("-", -0.4, 0.4)}, confused_with=MOTORS, motor_force_factor=lambda e, s, z:
        1.0 + e.field_shift * s.piston_position / REFERENCE_TRAVEL * s.current / 5.0),
    law(None, "LossyIron", "A motor force that falls with current and speed: F_e (1 − κ √(u² + 0.01)), "
        "u = i v/(3 A 0.2 m/s) (current × speed). Source: eddy currents in the yoke of a loaded motor; form chosen.",
        {"iron_loss": ("-", 0.02, 0.4)}, confused_with=(*MOTORS, "eddy_drag"), motor_force_factor=lambda e, s, z:
        1.0 - e.iron_loss * jnp.sqrt(jnp.square(s.current * s.piston_velocity / 0.6) + 0.01)),
    law(None, "LosingMagnets", "Magnets that load demagnetises irreversibly: Km (1 − ε (1 − exp(−q))), "
        "dq/dt = (i/4 A)²/0.15 s (drift). Source: irreversible demagnetisation; Coey, Magnetism (2010); form chosen.",
        {"field_loss": ("-", 0.01, 0.2)}, states={"stress": "-"}, confused_with=(*MOTORS, "coil_heating"),
        force_constant_factor=lambda e, s, z: 1.0 - e.field_loss * (1.0 - jnp.exp(-z.stress)),
        rates=lambda e, s, z: {"stress": jnp.square(s.current / 4.0) / 0.15}),
    law(None, "ThermalTail",
        "An output stage whose voltage falls after a load: −r i_s, di_s/dt = (i − i_s)/τ (memory). "
        "Source: thermal tails of output transistors; Self, Audio Power Amplifier Design (2013).",
        {"tail_resistance": ("ohm", 0.03, 2.0), "tail_time": ("s", 5e-3, 40e-3)}, states={"tail": "A"},
        confused_with=VOLTAGES, coil_voltage_change=lambda e, s, z: -e.tail_resistance * z.tail,
        rates=lambda e, s, z: {"tail": (s.current - z.tail) / e.tail_time}),
    law(None, "CoarseModulator", "A modulator with coarse voltage steps: u rounded to multiples of q. "
        "Source: Widrow, Kollár, Quantization Noise (2008).", {"modulator_step": ("V", 0.3, 4.0)},
        confused_with=VOLTAGES, coil_voltage_change=lambda e, s, z:
        -e.modulator_step / (2.0 * math.pi) * wrapped(2.0 * math.pi * s.voltage / e.modulator_step)),
    law(None, "SlowBrush",
        "A contact whose resistance grows with current and speed: −R i |v|/(|v| + 0.1 m/s) (current × "
        "speed). Source: lift of sliding contacts; Holm, Electric Contacts (1967); form chosen.",
        {"brush_resistance": ("ohm", 0.02, 2.0)}, confused_with=VOLTAGES, coil_voltage_change=lambda e, s, z:
        -e.brush_resistance * s.current * jnp.abs(s.piston_velocity) / (jnp.abs(s.piston_velocity) + 0.1)),
    law(None, "UncoveredGroove", "A groove that the plunger uncovers near its ends: k Δp (1 + tanh((|x| − 2.6 mm)/"
        "0.4 mm))/2 (pressure × position). Source: control edges of plunger pumps; Ivantysyn (2001).",
        {"groove_size": ("m^3/(s*Pa)", 5e-15, 5e-12)}, confused_with=LEAKS, chamber_leakage=lambda e, s, z:
        e.groove_size * _drop(s) * 0.5 * (1.0 + jnp.tanh((jnp.abs(s.piston_position) - 2.6e-3) / 0.4e-3))),
    law(None, "DeadEndPocket", "A pocket behind a throttle that fills and empties: Q = k (p − p_t), dp_t/dt = "
        "(p − p_t)/τ (memory). Source: RC volume behind a seal; Merritt (1967).",
        {"pocket_flow": ("m^3/s", 2e-8, 3e-6), "pocket_time": ("s", 0.5e-3, 20e-3)},
        states={"pocket_a": "-", "pocket_b": "-"}, confused_with=("entrained_air", "coupling_compliance", *LEAKS),
        chamber_leakage=_pocket, rates=_pocket_rates),
    law(None, "WearingSeal",
        "Leakage that grows linearly with time: k Δp t/0.4 s (drift). Source: Archard, J. Applied Physics 24 "
        "(1953) 981, wear in proportion to time.", {"wear_size": ("m^3/(s*Pa)", 5e-15, 5e-12)}, confused_with=LEAKS,
        chamber_leakage=lambda e, s, z: e.wear_size * _drop(s) * s.time / 0.4),
    law(None, "SpeedOpenedGap", "Leakage past a lip that motion lifts at low pressure: k Δp w/(1 + Δp²/"
        "(0.4 MPa)²), w = |v|/0.2 m/s (pressure × speed). Source: Hirano, Kaneta (1971); form chosen.",
        {"lifted_size": ("m^3/(s*Pa)", 1e-14, 1e-11)}, confused_with=LEAKS, chamber_leakage=lambda e, s, z:
        e.lifted_size * _drop(s) * jnp.abs(s.plunger_velocity) / 0.2 / (1.0 + jnp.square(_drop(s) / 0.4e6))),
    law(None, "BallCushion", "A cushion that brakes the ball near its largest lift: −c ẏ (1 + tanh((y − 0.3 mm)/"
        "50 µm))/2 (lift × speed). Source: dashpot stops of valves; form chosen.", {"stop_size": ("N*s/m", 0.1, 20.0)},
        confused_with=("valve_flow_force", "valve_adhesion"), check_valve_force=lambda e, s, z:
        -e.stop_size * s.lift_velocity * 0.5 * (1.0 + jnp.tanh((s.lift - 0.3e-3) / 50e-6))),
    law(None, "ChokedBall", "A lifting force on the ball in the flow: F (Δp/0.2 MPa) (y/0.4 mm) exp(1 − y/0.4 mm), "
        "opening (pressure × lift). Source: pressure recovery under a disc; Takenaka et al. (1964); form chosen.",
        {"lift_force": ("N", 0.05, 2.0)}, confused_with=("valve_flow_force", "valve_adhesion"),
        check_valve_force=lambda e, s, z: e.lift_force * s.pressure_drop / 0.2e6 * jnp.maximum(s.lift, 0.0) / 0.4e-3
        * jnp.exp(1.0 - jnp.maximum(s.lift, 0.0) / 0.4e-3)),
    law(None, "ChatteringLoad", "A load valve that chatters: a resistance R (1 + sin(2π f t + φ))/2 in series. "
        "Source: self-excited valves; Hayashi, Int. Symposium on Fluid Power (1995).",
        {"chatter_size": ("Pa*s/m^3", 1e8, 1e10), "chatter_rate": ("Hz", 6.0, 25.0), "chatter_start": ANGLE},
        confused_with=("hose_compliance",), outlet_line_resistance=lambda e, s, z: e.chatter_size * 0.5
        * (1.0 + jnp.sin(2.0 * jnp.pi * e.chatter_rate * s.time + e.chatter_start))),
    law(None, "ThixotropicOil", "Oil that thins as it is sheared and recovers: viscosity/(1 + s w), 80 ms dw/dt = "
        "|v|/0.2 m/s − w (memory). Source: Moore, Trans. British Ceramic Society 58 (1959) 470.",
        {"thinning": ("-", 0.2, 3.0)}, states={"sheared": "-"}, confused_with=("oil_temperature", *LEAKS),
        oil_viscosity_factor=lambda e, s, z: 1.0 / (1.0 + e.thinning * z.sheared),
        rates=lambda e, s, z: {"sheared": (jnp.abs(s.piston_velocity) / 0.2 - z.sheared) / 0.08}),
    law(None, "FilmOnRod", "Drag of the cylinder that grows with pressure: −c v_c (p_h/0.5 MPa)² (pressure × speed). "
        "Source: squeezed film of a pressed seal; form chosen.", {"film_size": ("N*s/m", 10.0, 3000.0)},
        confused_with=("karnopp_friction", "cylinder_seal_friction"), cylinder_force=lambda e, s, z:
        -e.film_size * s.cylinder_velocity * jnp.square(smooth_positive(s.head_pressure - 0.1e6, 1e3) / GAUGE)),
    law(None, "LoadRope",
        "A rope on the load whose strands slip: −F r, w dr/dt = v − 0.6 |v| r |r| − 0.4 v r² (memory). "
        "Source: Wen, J. Eng. Mech. Div. ASCE 102 (1976) 249.",
        {"rope_level": ("N", 4.0, 80.0), "rope_slip": ("m", 0.5e-3, 4e-3)}, states={"stretched": "-"},
        confused_with=("karnopp_friction", "load_spring"), cylinder_force=lambda e, s, z: -e.rope_level * z.stretched,
        rates=_rope_rates),
    law(None, "FadingSeal", "Leakage of the cylinder that grows steadily: k t/0.3 s (drift). Source: Archard (1953).",
        {"fading_size": ("m^3/(s*Pa)", 5e-15, 2e-12)}, confused_with=("cylinder_leakage_rise",),
        cylinder_leakage_change=lambda e, s, z: e.fading_size * s.time / 0.3),
)  # fmt: skip
