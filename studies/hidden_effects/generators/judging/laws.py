"""Other laws of mechanisms of the library, for the judging cases."""

import math

import jax.numpy as jnp

from edhas_jax.machine import effects as library
from edhas_jax.machine.effects.reference_scales import REFERENCE_TRAVEL, smooth_sign
from studies.hidden_effects.generators.functions import (
    gauge_pressures,
    outlet_line_drop,
    smooth_positive,
    suction_line_drop,
)
from studies.hidden_effects.generators.laws import law
from studies.hidden_effects.generators.places import is_chamber_b

TURN = ("rad", -math.pi, math.pi)
USUAL = 0.5e6  # Pa, a typical pressure in the pump


def travel_share(s):
    """Position of the mover over the reference travel of 5 mm."""
    return s.piston_position / REFERENCE_TRAVEL


def _speed(s):
    return jnp.abs(s.piston_velocity)


def gap_drop(s):
    """Pressure drop [Pa] over the gap of a plunger."""
    return s.chamber_pressure - s.accumulator_pressure


def _laminar(e, s, length):
    """Laminar flow [m³/s] through a concentric annular gap of this length [m]."""
    return jnp.pi * s.piston_diameter * e.slit**3 / (12.0 * s.viscosity * length) * gap_drop(s)


def _engaged(s):
    """Length [m] of the sealing gap: 9 mm at mid-stroke, shorter as the plunger moves out of its bore."""
    return 9e-3 + jnp.clip(-s.piston_position if is_chamber_b(s) else s.piston_position, -6e-3, 6e-3)


def _slip_elements(e, s, z):
    v = s.sliding_velocity
    lengths = {"short": e.slip_length, "middle": 4.0 * e.slip_length, "long": 16.0 * e.slip_length}
    return {n: (v - jnp.abs(v) * getattr(z, n)) / length for n, length in lengths.items()}


def _two_tanh(e, s, z):
    v = s.sliding_velocity
    falling = jnp.tanh(v / 2e-3) - jnp.tanh(v / 15e-3)
    return e.dry_level * (jnp.tanh(v / 6e-3) + 0.9 * falling) + e.slope_level * v


def _wave(e, s):
    return 2.0 * jnp.pi * s.piston_position / e.tooth_length + e.tooth_shift


def _narrow(e, s, z):
    u = _wave(e, s)
    return -0.8 * e.tooth_force * jnp.sin(u) / (1.3 - jnp.cos(u))


def _toothed_gradient(e, s):
    return s.coil_inductance * e.tooth_share * 2.0 * jnp.pi / 9e-3 * jnp.cos(2.0 * jnp.pi * s.piston_position / 9e-3)


def _entering_gradient(e, s):
    return s.coil_inductance * e.entry_share / 1.8e-3 * (1.0 - jnp.square(jnp.tanh(s.piston_position / 1.8e-3)))


def _rippled(e, s, z):
    i, half = s.current, 0.7
    return -e.rail_loss * (jnp.sqrt(jnp.square(i + half) + 0.01) - jnp.sqrt(jnp.square(i - half) + 0.01)) / (2.0 * half)


def _pade(e, s, z):
    """Rates of a delay τ in Padé's approximation (12 − 6 p + p²)/(12 + 6 p + p²), p = s τ."""
    t = e.dead_interval
    return {"part": z.slope / t, "slope": (12.0 * (s.voltage - z.part) - 6.0 * z.slope) / t}


def _slewing(e, s, z):
    ahead = s.voltage - z.behind
    return {"behind": ahead / (e.small_time * jnp.sqrt(1.0 + jnp.square(ahead / 1.5)))}


def _network(e, s, z):
    loss, times = s.resistance * jnp.square(s.current), {"film": 8e-3, "wire": 50e-3, "former": 0.3}
    return {n: (e.heat_gain * 0.3 * loss - getattr(z, n)) / time for n, time in times.items()}


def _filled_play(e, s, z):
    d, half = s.coupling_deflection, 0.5 * e.key_play
    return 1e6 * (d - jnp.clip(d, -half, half)) + 400.0 * s.coupling_velocity


def _sprung_play(e, s, z):
    d, half = s.coupling_deflection, 0.5 * e.key_play
    return 0.8e5 * d + 1e6 * (d - jnp.clip(d, -half, half)) + 20.0 * s.coupling_velocity


def _stefan(e, s, z):
    height = 1.0 + jnp.maximum(s.lift, 0.0) / 15e-6
    return -e.squeeze_force * smooth_positive(s.lift_velocity, 1e-4) / 10e-3 / (height * height * height)


def _meniscus(e, s, z):
    left = jnp.clip(1.0 - s.lift / 45e-6, 0.0, 1.0)
    return -e.neck_force * left * left * (3.0 - 2.0 * left) * 0.5 * (1.0 + jnp.tanh(s.lift_velocity / 3e-4))


def _soft_seat(e, s, z):
    return e.gap_area / (1.0 + jnp.abs(s.pressure_drop) / 0.12e6)


def _washed_out(e, s, z):
    return e.gap_area * (0.15 + 0.85 * jnp.exp(-s.time / 0.12))


def _redissolving(e, s, z):
    kept = 1.0 / (1.0 + jnp.maximum(s.outlet_pressure - s.atmospheric_pressure, 0.0) / USUAL)
    return {"gone": (1.0 - kept - z.gone) / 40e-3}


def _walther(e, s, z):
    nu = 46.0  # mm²/s at 40 °C
    power = jnp.exp(-e.walther_slope * jnp.log(s.oil_temperature / 313.15))
    return (jnp.exp(power * math.log(nu + 0.7)) - 0.7) / nu


def _gap_mean(s):
    return 0.5 * jnp.maximum(s.chamber_pressure + s.accumulator_pressure, 0.0)


def gauge(s, name):
    """A pressure above ambient [Pa], at least 0."""
    return jnp.maximum(getattr(s, name) - s.atmospheric_pressure, 0.0)


def _gas_load(e, s, z):
    share = jnp.clip(s.cylinder_position / 32e-3, -0.5, 0.8)
    return -e.gas_rate * 32e-3 / 1.2 * (jnp.exp(-1.2 * jnp.log(1.0 - share)) - 1.0)


def _trailing(where, drop):
    """The terms of a line with fluid inertia whose core flow lags; `where` is "outlet" or "suction"."""
    return {
        "states": {"column": "m^3/s", "core": "m^3/s"}, f"{where}_line_flow": lambda e, s, z: z.column,
        f"{where}_line_resistance": lambda e, s, z: 2.5 * e.wall_loss, "rates": lambda e, s, z:
        {"column": (drop(s, z.column) + 1.5 * e.wall_loss * z.core) / e.column_mass,
         "core": (z.column - z.core) / 4e-3},
    }  # fmt: skip


def _easing(where, drop):
    """The terms of a line with fluid inertia and shear-thinning oil."""
    return {
        "states": {"column": "m^3/s"}, f"{where}_line_flow": lambda e, s, z: z.column,
        f"{where}_line_resistance": lambda e, s, z: e.wall_loss / (1.0 + jnp.abs(z.column) / 8e-6),
        "rates": lambda e, s, z: {"column": drop(s, z.column) / e.column_mass},
    }  # fmt: skip


COLUMN = {"column_mass": ("kg/m^4", 1e6, 5e7)}
SEAT = {"gap_area": ("m^2", 2e-9, 3e-7)}
SOFT_TEXT = ("Leakage of soft seats of the {} valves, which pressure closes: A/(1 + |Δp|/0.12 MPa). "
             "Source: elastic seats of valves, contact stress that grows with pressure; form chosen.")  # fmt: skip
CHIP_TEXT = ("A chip that keeps the {} valves open until it is washed away: A (0.15 + 0.85 exp(−t/0.12 s)). "
             "Source: contamination of seat valves; form chosen.")  # fmt: skip
TRAIL_TEXT = ("A {} with fluid inertia, whose core flow lags: I dQ/dt = Δp − R (Q + 1.5 (Q − Q_c)), 4 ms dQ_c/dt "
              "= Q − Q_c. Source: frequency-dependent friction after Zielke, J. Basic Eng. 90 (1968) 109.")  # fmt: skip
EASE_TEXT = ("A {} with fluid inertia and shear-thinning oil: I dQ/dt = Δp − R Q/(1 + |Q|/0.48 L/min). "
             "Source: shear thinning of oils with polymers; Cross, J. Colloid Science 20 (1965) 417.")  # fmt: skip
LAWS = (
    law(library.LugreFriction, "SlipElementFriction", "Friction of three Dahl elements that slip one after another: "
        "F (0.5 r_1 + 0.3 r_2 + 0.2 r_3), dr/dt = (v − |v| r)/δ with δ, 4 δ, 16 δ. "
        "Source: Iwan, J. Applied Mechanics 33 (1966) 893; Al-Bender, Lampaert, Swevers (2005).",
        {"slip_level": ("N", 2.0, 10.0), "slip_length": ("m", 10e-6, 120e-6)},
        states={"short": "-", "middle": "-", "long": "-"}, rates=_slip_elements,
        mover_friction=lambda e, s, z: e.slip_level * (0.5 * z.short + 0.3 * z.middle + 0.2 * z.long)),
    law(library.LugreFriction, "TwoTanhFriction", "Smooth friction with a Stribeck peak at low speed: F (tanh(v/6 "
        "mm/s) + 0.9 (tanh(v/2 mm/s) − tanh(v/15 mm/s))) + c v. "
        "Source: Makkar, Dixon, Sawyer, Hu, Proc. IEEE/ASME AIM (2005) 600.",
        {"dry_level": ("N", 2.0, 9.0), "slope_level": ("N*s/m", 1.0, 12.0)}, mover_friction=_two_tanh),
    law(library.PistonLeakage, "WidenedBoreLeakage", "Leakage past a plunger whose bore widens under pressure: "
        "k Δp (1 + Δp/1.6 MPa)³. Source: Lamé's thick tube; Ivantysyn, Ivantysynova, Hydrostatic Pumps (2001).",
        {"slit": ("m", 12e-6, 34e-6)}, chamber_leakage=lambda e, s, z: _laminar(e, s, 20e-3)
        * (1.0 + jnp.clip(gap_drop(s) / 1.6e6, -0.3, 5.0)) ** 3),
    law(library.PistonLeakage, "ShorteningGapLeakage", "Leakage past a plunger whose gap is 9 mm long at mid-stroke "
        "and shorter as it moves out of its bore: k Δp 9 mm/(9 mm ± x). Source: Hagen-Poiseuille for slits; geometry.",
        {"slit": ("m", 10e-6, 28e-6)}, chamber_leakage=lambda e, s, z: _laminar(e, s, _engaged(s))),
    law(library.EntrainedAir, "RedissolvingAir", "Air that the outlet pressure dissolves with a lag: α p_atm/p² (1 − "
        "g), 40 ms dg/dt = p/(p + 0.5 MPa) − g, p the gauge pressure of the outlet. "
        "Source: rate of solution of bubbles, first order; form chosen.",
        {"early_air": ("-", 0.003, 0.02)}, states={"gone": "-"}, rates=_redissolving,
        oil_gas=lambda e, s, z: e.early_air * s.atmospheric_pressure, oil_compressibility=lambda e, s, z:
        e.early_air * s.atmospheric_pressure / jnp.square(s.pressure) * (1.0 - z.gone)),
    law(library.EntrainedAir, "MicroBubbleAir", "Air in small bubbles, which surface tension compresses: "
        "α p_atm/(p + 60 kPa)². Source: Laplace's pressure 2 σ/r of bubbles of 1 µm.",
        {"fine_air": ("-", 0.003, 0.02)}, oil_gas=lambda e, s, z: e.fine_air * s.atmospheric_pressure,
        oil_compressibility=lambda e, s, z:
        e.fine_air * s.atmospheric_pressure / jnp.square(s.pressure + 60e3)),
    law(library.KarnoppFriction, "StribeckCylinder", "Friction of the cylinder that falls with speed: "
        "F (1 + 0.7 exp(−|v|/12 mm/s)) tanh(v/0.7 mm/s). Source: Stribeck (1902); exponential form of Bo, Pavelescu, "
        "Wear 82 (1982) 277.", {"rod_level": ("N", 3.0, 60.0)}, cylinder_friction_force=lambda e, s, z:
        (e.rod_level * (1.0 + 0.7 * jnp.exp(-jnp.abs(s.cylinder_velocity) / 12e-3)) + s.cylinder_friction_level)
        * jnp.tanh(s.cylinder_velocity / 0.7e-3)),
    law(library.KarnoppFriction, "CreepingCylinder", "Friction of elastic cylinder seals: F r, "
        "dr/dt = (v − |v| r)/50 µm. Source: Dahl, AIAA J. 14 (1976) 1675, exponent 1.",
        {"rod_level": ("N", 3.0, 80.0)}, states={"sheared": "-"}, cylinder_friction_force=lambda e, s, z:
        (e.rod_level + s.cylinder_friction_level) * z.sheared, rates=lambda e, s, z:
        {"sheared": (s.cylinder_velocity - jnp.abs(s.cylinder_velocity) * z.sheared) / 50e-6}),
    law(library.ForceConstantDroop, "FlatTopDroop", "A force constant that is flat about mid-stroke: Km (1 − κ "
        "(x/x_m)⁴). "
        "Source: overhung coils, whose field is flat over the gap; Klippel, J. Audio Eng. Soc. 54 (2006) 907.",
        {"edge_loss": ("-", 0.03, 0.4)}, force_constant_factor=lambda e, s, z:
        1.0 - e.edge_loss * jnp.square(jnp.square(travel_share(s)))),
    law(library.ForceConstantDroop, "TiltedDroop", "A force constant that falls along the stroke and towards its ends: "
        "Km (1 − κ (0.6 x/x_m + 0.4 |x|/x_m)), |x| rounded within 0.5 mm. Source: a magnet that is mounted askew; "
        "geometry.",
        {"tilt_loss": ("-", 0.02, 0.2)}, force_constant_factor=lambda e, s, z: 1.0 - e.tilt_loss
        * (0.6 * travel_share(s) + 0.4 * (jnp.sqrt(jnp.square(travel_share(s)) + 0.01) - 0.1))),
    law(library.MagneticSaturation, "KneeSaturation", "Saturation with a knee: F_e = Km i/(1 + (b i)⁴)^¼. "
        "Source: magnetisation curves that are straight up to a knee; power interpolation, chosen.",
        {"knee_slope": ("1/A", 0.06, 0.4)}, motor_force_factor=lambda e, s, z:
        1.0 / jnp.sqrt(jnp.sqrt(1.0 + jnp.square(jnp.square(e.knee_slope * s.current))))),
    law(library.MagneticSaturation, "BiasedSaturation", "Saturation by a current whose field adds to that of the "
        "magnets: F_e = Km i/(1 + b max(i + 1 A, 0)), rounded within 0.5 A. "
        "Source: armature reaction of one sign; Hanselman, Brushless Motors (2012); form chosen.",
        {"added_field": ("1/A", 0.004, 0.1)}, motor_force_factor=lambda e, s, z:
        1.0 / (1.0 + e.added_field * smooth_positive(s.current + 1.0, 0.5))),
    law(library.ReluctanceForce, "ToothedInductance", "An inductance that varies along the teeth: L (1 + λ sin(2π x/9 "
        "mm)), "
        "with its force and voltage. Source: permeance waves of slotted iron; Boldea, Linear Electric Machines (2013).",
        {"tooth_share": ("-", -0.3, 0.3)}, coil_inductance_factor=lambda e, s, z:
        1.0 + e.tooth_share * jnp.sin(2.0 * jnp.pi * s.piston_position / 9e-3),
        coil_voltage_change=lambda e, s, z: -s.current * s.piston_velocity * _toothed_gradient(e, s),
        mover_force=lambda e, s, z: 0.5 * jnp.square(s.current) * _toothed_gradient(e, s)),
    law(library.ReluctanceForce, "EnteringIronInductance", "An inductance that rises where the coil enters the iron: "
        "L (1 + λ tanh(x/1.8 mm)), with its force and voltage. Source: plunger solenoids, Roters (1941); form chosen.",
        {"entry_share": ("-", -0.35, 0.35)}, coil_inductance_factor=lambda e, s, z:
        1.0 + e.entry_share * jnp.tanh(s.piston_position / 1.8e-3),
        coil_voltage_change=lambda e, s, z: -s.current * s.piston_velocity * _entering_gradient(e, s),
        mover_force=lambda e, s, z: 0.5 * jnp.square(s.current) * _entering_gradient(e, s)),
    law(library.CoggingForce, "NarrowToothCogging", "Cogging of narrow teeth: −0.8 A sin u/(1.3 − cos u). "
        "Source: field of a periodic row of poles, Poisson's kernel.",
        {"tooth_force": ("N", 0.2, 5.0), "tooth_length": ("m", 3e-3, 14e-3), "tooth_shift": TURN}, mover_force=_narrow),
    law(library.CoggingForce, "GrowingCogging", "Cogging that grows along the stroke: −A (1 + 0.8 x/x_m) sin u. "
        "Source: overlap of teeth that changes with position; geometry.",
        {"tooth_force": ("N", 0.2, 5.0), "tooth_length": ("m", 2.5e-3, 12e-3), "tooth_shift": TURN},
        mover_force=lambda e, s, z: -e.tooth_force * (1.0 + 0.8 * travel_share(s)) * jnp.sin(_wave(e, s))),
    law(library.EddyDrag, "LateDrag", "Eddy-current drag that builds up with a lag: −c w, 4 ms dw/dt = v − w. "
        "Source: inductance of eddy paths; Davis, Reitz, J. Applied Physics 42 (1971) 4119, one time constant.",
        {"brake_size": ("N*s/m", 2.0, 40.0)}, states={"followed": "m/s"},
        mover_force=lambda e, s, z: -e.brake_size * z.followed,
        rates=lambda e, s, z: {"followed": (s.piston_velocity - z.followed) / 4e-3}),
    law(library.EddyDrag, "SkinDepthDrag", "Eddy-current drag ∝ √v at high speed: −c v/(1 + (v/v_e)²)^¼. "
        "Source: skin depth in thick conductors; Stoll, The Analysis of Eddy Currents (1974).",
        {"brake_size": ("N*s/m", 1.5, 40.0), "brake_speed": ("m/s", 0.02, 0.15)}, mover_force=lambda e, s, z:
        -e.brake_size * s.piston_velocity / jnp.sqrt(jnp.sqrt(1.0 + jnp.square(s.piston_velocity / e.brake_speed)))),
    law(library.InverterDeadTime, "RippledDeadTime", "Dead time averaged over a current ripple of ±0.7 A: "
        "−V (|i + 0.7 A| − |i − 0.7 A|)/1.4 A, rounded within 0.1 A. Source: dead time averaged over the ripple of a "
        "switching period; Holmes, Lipo, Pulse Width Modulation (2003).", {"rail_loss": ("V", 0.3, 4.0)},
        coil_voltage_change=_rippled),
    law(library.InverterDeadTime, "UnequalLegs", "Dead time with a larger voltage loss at positive currents: "
        "−V (w + 0.5 w²), w = tanh(i/60 mA). Source: unequal switches of two legs; form chosen.",
        {"rail_loss": ("V", 0.2, 3.0)}, coil_voltage_change=lambda e, s, z: -e.rail_loss
        * (jnp.tanh(s.current / 0.06) + 0.5 * jnp.square(jnp.tanh(s.current / 0.06)))),
    law(library.SupplySag, "DrainedCapacitor", "A supply whose capacitor the load discharges: R q, "
        "6 ms dq/dt = max(u i, 0)/20 V − q. Source: energy of a link capacitor behind a weak source; linearised.",
        {"link_resistance": ("ohm", 0.1, 2.5)}, states={"drain": "A"}, supply_voltage_change=lambda e, s, z:
        -jnp.minimum(e.link_resistance * jnp.maximum(z.drain, 0.0), s.supply_voltage), rates=lambda e, s, z:
        {"drain": (smooth_positive(s.voltage * s.current, 1.0) / 20.0 - z.drain) / 6e-3}),
    law(library.SupplySag, "RectifierSag", "A rectifier whose capacitor is recharged 100 times a second: "
        "R |i| (1 + 0.9 sin(2π 100 Hz t)). Source: ripple of a capacitor-input rectifier; Schade, Proc. IRE 31 (1943) "
        "341; first harmonic.", {"charge_resistance": ("ohm", 0.1, 2.0)}, supply_voltage_change=lambda e, s, z:
        -jnp.minimum(e.charge_resistance * jnp.abs(s.current) * (1.0 + 0.9 * jnp.sin(2.0 * jnp.pi * 100.0 * s.time)),
                     s.supply_voltage)),
    law(library.AmplifierLag, "DelayedAmplifier", "An amplifier with a dead time: u(t − τ), in Padé's "
        "approximation (2, 2). Source: computing and modulation delay of digital drives; Padé (1892).",
        {"dead_interval": ("s", 0.04e-3, 0.5e-3)}, states={"part": "V", "slope": "V"},
        coil_voltage_change=lambda e, s, z: -z.slope, rates=_pade),
    law(library.AmplifierLag, "SlewingAmplifier", "An amplifier whose output has a limited slew rate: "
        "du_a/dt = d/(τ √(1 + (d/1.5 V)²)), d = u − u_a. Source: slew rate of input stages; Gray, Meyer, Analysis and "
        "Design of Analog Integrated Circuits.", {"small_time": ("s", 0.03e-3, 0.8e-3)}, states={"behind": "V"},
        coil_voltage_change=lambda e, s, z: z.behind - s.voltage, rates=_slewing),
    law(library.CoilHeating, "FannedHeating", "A coil that is cooled by its own motion: R (1 + 0.0039 ϑ), "
        "dϑ/dt = q R i² − ϑ (0.3 + |v|/10 mm/s)/s. Source: forced convection of voice coils; Klippel (2004).",
        {"heat_rise": ("K/J", 0.4, 12.0)}, states={"excess": "K"},
        coil_resistance_factor=lambda e, s, z: 1.0 + 0.0039 * z.excess, rates=lambda e, s, z:
        {"excess": e.heat_rise * s.resistance * jnp.square(s.current) - z.excess * (0.3 + _speed(s) / 0.01)}),
    law(library.CoilHeating, "DiffusedHeating", "Coil heating with three lags: R (1 + 0.0039 Σ ϑ_k), lags of 8, 50 and "
        "300 ms, each with the steady temperature rise q 0.3 s R i². Source: Foster networks of thermal impedances; "
        "IEC 60747.",
        {"heat_gain": ("K/J", 0.05, 2.5)}, states={"film": "K", "wire": "K", "former": "K"}, rates=_network,
        coil_resistance_factor=lambda e, s, z: 1.0 + 0.0039 * (z.film + z.wire + z.former)),
    law(library.ConstantBiasForce, "CreepingBias", "A force that relaxes in part: −F (0.4 + 0.6 exp(−t/0.15 s)), "
        "either sign. Source: stress relaxation, Maxwell (1867); the time is chosen.",
        {"steady_pull": ("N", -5.0, 5.0)},
        mover_force=lambda e, s, z: -e.steady_pull * (0.4 + 0.6 * jnp.exp(-s.time / 0.15))),
    law(library.ConstantBiasForce, "OneRodBias", "Pressure on a rod in chamber A: −F (0.5 + 0.5 p_A/0.5 MPa), gauge, "
        "either sign. Source: statics.", {"steady_pull": ("N", -4.0, 4.0)},
        mover_force=lambda e, s, z: -e.steady_pull * 0.5 * (1.0 + gauge_pressures(s)[0] / USUAL)),
    law(library.ParasiticSpring, "RelaxingSpring", "A rubber spring that relaxes: −k (0.45 x + 0.55 (x − x_r)), "
        "25 ms dx_r/dt = x − x_r. Source: Zener, Elasticity and Anelasticity of Metals (1948).",
        {"rubber_rate": ("N/m", 80.0, 5000.0)}, states={"set_in": "m"}, mover_force=lambda e, s, z:
        -e.rubber_rate * (s.piston_position - 0.55 * z.set_in),
        rates=lambda e, s, z: {"set_in": (s.piston_position - z.set_in) / 25e-3}),
    law(library.ParasiticSpring, "TautCable", "A cable that is taut beyond −0.5 mm: −k max(x + 0.5 mm, 0), rounded "
        "within 0.3 mm. Source: statics.", {"rubber_rate": ("N/m", 80.0, 6000.0)}, mover_force=lambda e, s, z:
        -e.rubber_rate * smooth_positive(s.piston_position + 0.5e-3, 0.3e-3)),
    law(library.AsymmetricFriction, "NarrowingLip", "Friction of the forward stroke only, growing along the stroke: "
        "F_a (1 + 0.7 x/x_m) max(th(v), 0). Source: a lip in a conical bore; geometry.",
        {"ahead_level": ("N", 0.3, 5.0)}, mover_friction=lambda e, s, z:
        e.ahead_level * (1.0 + 0.7 * travel_share(s)) * jnp.maximum(smooth_sign(s.sliding_velocity), 0.0)),
    law(library.AsymmetricFriction, "FloatingLip", "Friction of the forward stroke only, falling with speed: "
        "F_a max(th(v), 0)/(1 + |v|/80 mm/s). Source: Stribeck (1902) for lip seals; form chosen.",
        {"ahead_level": ("N", 0.5, 8.0)}, mover_friction=lambda e, s, z: e.ahead_level
        * jnp.maximum(smooth_sign(s.sliding_velocity), 0.0) / (1.0 + jnp.abs(s.sliding_velocity) / 0.08)),
    law(library.AsymmetricDamping, "ThinningDamping", "Viscous friction that differs between the directions and thins "
        "at high speed: −c |v|/√(1 + (v/80 mm/s)²). Source: shear thinning, Cross (1965); form chosen.",
        {"screw_size": ("N*s/m", -60.0, 60.0)}, mover_force=lambda e, s, z:
        -e.screw_size * _speed(s) / jnp.sqrt(1.0 + jnp.square(s.piston_velocity / 0.08))),
    law(library.AsymmetricDamping, "TaperedDamping", "Viscous friction that differs between the directions and grows "
        "towards one end: −c |v| (1 + 0.8 x/x_m). Source: a tapered film under a slanting guide; geometry.",
        {"screw_size": ("N*s/m", -60.0, 60.0)},
        mover_force=lambda e, s, z: -e.screw_size * _speed(s) * (1.0 + 0.8 * travel_share(s))),
    law(library.StrokeDependentFriction, "OneEndFriction", "Dry friction that grows towards one end: F_s (max(x, "
        "0)/x_m)² th(v), "
        "rounded within 0.3 mm. Source: a bore that narrows at one end; geometry.", {"reach_size": ("N", 0.7, 14.0)},
        mover_friction=lambda e, s, z: e.reach_size * smooth_sign(s.sliding_velocity)
        * jnp.square(smooth_positive(s.sliding_position, 0.3e-3) / REFERENCE_TRAVEL)),
    law(library.StrokeDependentFriction, "WavyBoreFriction", "Dry friction that varies along a wavy bore: "
        "F_s (1 − cos(2π x/5 mm))/2 th(v). Source: waviness of honed bores; form chosen.",
        {"reach_size": ("N", 0.5, 8.0)}, mover_friction=lambda e, s, z: 0.5 * e.reach_size
        * (1.0 - jnp.cos(2.0 * jnp.pi * s.sliding_position / 5e-3)) * smooth_sign(s.sliding_velocity)),
    law(library.SealFriction, "DifferenceSeal", "Friction of a seal between the two chambers: μ S_p |p_A − p_B| th(v), "
        "rounded within 20 kPa. Source: double-acting seals; Müller, Nau, Fluid Sealing Technology (1998).",
        {"ring_friction": ("-", 0.006, 0.2)}, mover_friction=lambda e, s, z: e.ring_friction * s.piston_area
        * jnp.sqrt(jnp.square(s.chamber_pressure_a - s.chamber_pressure_b) + 4e8) * smooth_sign(s.sliding_velocity)),
    law(library.SealFriction, "MixedFilmSeal", "Seal friction that falls with speed: "
        "μ S_p Σ p (0.4 + 1.2 exp(−|v|/60 mm/s)) th(v). Source: mixed lubrication of seals, Stribeck (1902).",
        {"ring_friction": ("-", 0.006, 0.2)}, mover_friction=lambda e, s, z: e.ring_friction * s.piston_area
        * sum(gauge_pressures(s)) * (0.4 + 1.2 * jnp.exp(-jnp.abs(s.sliding_velocity) / 0.06))
        * smooth_sign(s.sliding_velocity)),
    law(library.CouplingCompliance, "RoundedCoupling", "A coupling with rounded faces: k Δ √(0.1 + |Δ|/40 µm) + "
        "20 N·s/m Δ̇. Source: Hertz (1881), force with the power 1.5; preload chosen.",
        {"bond_compliance": ("m/N", 2e-7, 8e-6)}, coupling_force=lambda e, s, z: s.coupling_deflection
        / e.bond_compliance * jnp.sqrt(0.1 + jnp.abs(s.coupling_deflection) / 40e-6) + 20.0 * s.coupling_velocity),
    law(library.CouplingCompliance, "BoltedCoupling", "A coupling that is stiffer in compression than in tension: "
        "k Δ (1 + 0.6 tanh(Δ/3 µm)) + 20 N·s/m Δ̇. Source: joints that open under tension; VDI 2230.",
        {"bond_compliance": ("m/N", 2e-7, 1e-5)}, coupling_force=lambda e, s, z: s.coupling_deflection
        / e.bond_compliance * (1.0 + 0.6 * jnp.tanh(s.coupling_deflection / 3e-6)) + 20.0 * s.coupling_velocity),
    law(library.Backlash, "OilFilledPlay", "Backlash filled with oil: 1e6 N/m beyond ±b/2, and 400 N·s/m Δ̇ "
        "everywhere. Source: squeeze films in joints; Hamrock, Fundamentals of Fluid Film Lubrication; linear.",
        {"key_play": ("m", 4e-6, 120e-6)}, coupling_force=_filled_play),
    law(library.Backlash, "SprungPlay", "Backlash that a soft ring bridges: 8e4 N/m, and 1e6 N/m more beyond ±b/2. "
        "Source: two-stage stiffness of couplings with elastomer rings; statics.",
        {"key_play": ("m", 4e-6, 120e-6)}, coupling_force=_sprung_play),
    law(library.ValveFlowForce, "CavitatedJet", "A flow force that cavitation limits: −K A 80 kPa tanh(Δp/80 kPa). "
        "Source: cavitating orifices, choked flow; Nurick, J. Fluids Eng. 98 (1976) 681; form chosen.",
        {"thrust": ("-", 0.2, 2.5)}, check_valve_force=lambda e, s, z:
        -e.thrust * s.valve_area * 80e3 * jnp.tanh(s.pressure_drop / 80e3)),
    law(library.ValveFlowForce, "LateJet", "A flow force that develops as the valve lifts: −K A Δp y/(y + 0.3 mm). "
        "Source: jets that detach from the seat as it opens; Johnston, Edge, Vaughan (1991); form chosen.",
        {"thrust": ("-", 0.2, 2.5)}, check_valve_force=lambda e, s, z: -e.thrust * s.valve_area * s.pressure_drop
        * jnp.maximum(s.lift, 0.0) / (jnp.maximum(s.lift, 0.0) + 0.3e-3)),
    law(library.ValveAdhesion, "SqueezeFilmAdhesion", "Suction by the oil film under the ball as it lifts off: "
        "−F max(ẏ, 0)/(10 mm/s)/(1 + y/15 µm)³. Source: Stefan (1874); Reynolds (1886).",
        {"squeeze_force": ("N", 0.05, 6.0)}, check_valve_force=_stefan),
    law(library.ValveAdhesion, "BreakingNeck", "A liquid bridge that breaks at a lift of 45 µm: −F (3 w² − 2 w³), "
        "w = 1 − y/45 µm, while it opens. Source: rupture of liquid bridges; Willett et al., Langmuir 16 (2000) 9396; "
        "form chosen.", {"neck_force": ("N", 0.05, 4.0)}, check_valve_force=_meniscus),
    law(library.SuctionSeatLeakage, "SoftSuctionSeat", SOFT_TEXT.format("suction"), SEAT,
        suction_valve_area=_soft_seat),
    law(library.SuctionSeatLeakage, "SuctionChip", CHIP_TEXT.format("suction"), SEAT, suction_valve_area=_washed_out),
    law(library.DeliverySeatLeakage, "SoftDeliverySeat", SOFT_TEXT.format("delivery"), SEAT,
        delivery_valve_area=_soft_seat),
    law(library.DeliverySeatLeakage, "DeliveryChip", CHIP_TEXT.format("delivery"), SEAT,
        delivery_valve_area=_washed_out),
    law(library.HoseCompliance, "TrappedPocketHose", "A gas pocket trapped at the outlet: C (0.35 MPa/p)². "
        "Source: isothermal gas, Boyle; a small accumulator.", {"pocket_compliance": ("m^3/Pa", 1e-14, 1e-11)},
        outlet_capacity=lambda e, s, z: e.pocket_compliance * jnp.square(0.35e6 / s.outlet_pressure)),
    law(library.HoseCompliance, "BulgingHose", "A thin hose that expands more at high pressure: C (0.4 + 0.8 (p/0.6 "
        "MPa)²). "
        "Source: large strain of thin-walled rubber tubes; Treloar, The Physics of Rubber Elasticity; form chosen.",
        {"pocket_compliance": ("m^3/Pa", 1e-14, 5e-12)}, outlet_capacity=lambda e, s, z:
        e.pocket_compliance * (0.4 + 0.8 * jnp.square(jnp.minimum(s.outlet_pressure / 0.6e6, 3.0)))),
    law(library.OutletLineInertance, "TrailingLineInertance", TRAIL_TEXT.format("line to the load"),
        COLUMN | {"wall_loss": ("Pa*s/m^3", 1e8, 2e9)}, **_trailing("outlet", outlet_line_drop)),
    law(library.OutletLineInertance, "EasingLineInertance", EASE_TEXT.format("line to the load"),
        COLUMN | {"wall_loss": ("Pa*s/m^3", 3e8, 6e9)}, **_easing("outlet", outlet_line_drop)),
    law(library.OutletLineResistance, "FlowRegulator", "A regulator in the line that closes as pressure rises: "
        "R (1 + 0.8 tanh((p − p_s − 0.4 MPa)/0.12 MPa)). Source: pressure-compensated valves; Merritt (1967); form "
        "chosen.", {"spool_size": ("Pa*s/m^3", 1e8, 8e9)}, outlet_line_resistance=lambda e, s, z: e.spool_size
        * (1.0 + 0.8 * jnp.tanh((s.outlet_pressure - s.accumulator_pressure - 0.4e6) / 0.12e6))),
    law(library.OutletLineResistance, "WarmingLine", "A cold line that warms up: R (0.35 + 0.65 exp(−t/0.13 s)). "
        "Source: Hagen-Poiseuille with a viscosity that falls; the time is chosen.",
        {"spool_size": ("Pa*s/m^3", 2e8, 1e10)}, outlet_line_resistance=lambda e, s, z:
        e.spool_size * (0.35 + 0.65 * jnp.exp(-s.time / 0.13))),
    law(library.SuctionLineResistance, "SuctionScreen", "A screen whose resistance grows with the square of the flow: "
        "R (0.3 + (v/0.2 m/s)²), v the speed of the plungers. Source: Forchheimer (1901), higher term alone.",
        {"screen_size": ("Pa*s/m^3", 2e7, 3e9)}, suction_line_resistance=lambda e, s, z:
        e.screen_size * (0.3 + jnp.square(s.sliding_velocity / 0.2))),
    law(library.SuctionLineResistance, "ShearedSuctionLine", "A suction line with cold oil that thins with a lag as it "
        "flows: R (0.25 + 1/(1 + w)), 60 ms dw/dt = |v|/50 mm/s − w. "
        "Source: thixotropy; Barnes, J. Non-Newtonian Fluid Mech. 70 (1997) 1; form chosen.",
        {"screen_size": ("Pa*s/m^3", 2e7, 4e9)}, states={"loosened": "-"},
        suction_line_resistance=lambda e, s, z: e.screen_size * (0.25 + 1.0 / (1.0 + z.loosened)),
        rates=lambda e, s, z: {"loosened": (jnp.abs(s.sliding_velocity) / 0.05 - z.loosened) / 60e-3}),
    law(library.SuctionLineInertance, "TrailingSuctionInertance", TRAIL_TEXT.format("suction line"),
        COLUMN | {"wall_loss": ("Pa*s/m^3", 1e7, 4e8)}, **_trailing("suction", suction_line_drop)),
    law(library.SuctionLineInertance, "EasingSuctionInertance", EASE_TEXT.format("suction line"),
        COLUMN | {"wall_loss": ("Pa*s/m^3", 3e7, 1e9)}, **_easing("suction", suction_line_drop)),
    law(library.OilTemperature, "VogelViscosity", "Viscosity exp(B/(T − 170 K)), over that at 40 °C. "
        "Source: Vogel, Phys. Z. 22 (1921) 645.", {"vogel_constant": ("K", 400.0, 1300.0)},
        oil_viscosity_factor=lambda e, s, z:
        jnp.exp(e.vogel_constant * (1.0 / (s.oil_temperature - 170.0) - 1.0 / 143.15))),
    law(library.OilTemperature, "WaltherViscosity", "Viscosity with log log(ν + 0.7) linear in log T, 46 mm²/s at "
        "40 °C. Source: Walther (1931); ASTM D341.", {"walther_slope": ("-", 1.5, 4.5)},
        oil_viscosity_factor=_walther),
    law(library.PressureViscosity, "LateGapViscosity", "Viscosity that rises only above 0.4 MPa in the gap: "
        "1 + b max(p̄ − 0.4 MPa, 0)/0.5 MPa, rounded within 50 kPa. Source: gaps that tighten under load; form chosen.",
        {"gap_stiffening": ("-", 0.02, 0.4)}, gap_viscosity_factor=lambda e, s, z:
        1.0 + e.gap_stiffening * smooth_positive(_gap_mean(s) - 0.4e6, 50e3) / USUAL),
    law(library.PressureViscosity, "BubblyGapViscosity", "Viscosity in the gap that rises as bubbles dissolve: "
        "1 + b (1 − exp(−p̄/0.25 MPa)). Source: viscosity of oil with bubbles; Hayward (1961); form chosen.",
        {"gap_stiffening": ("-", 0.02, 0.3)}, gap_viscosity_factor=lambda e, s, z:
        1.0 + e.gap_stiffening * (1.0 - jnp.exp(-_gap_mean(s) / 0.25e6))),
    law(library.CylinderSealFriction, "BothSidesSeal", "Cylinder friction that grows with both pressures: "
        "μ A (p_h + 0.8 p_r), gauge. Source: seals on both sides of the piston; O-ring friction as in the library.",
        {"packing": ("-", 0.003, 0.08)}, cylinder_friction_level=lambda e, s, z: e.packing * s.cylinder_area
        * (gauge(s, "head_pressure") + 0.8 * gauge(s, "rod_pressure"))),
    law(library.CylinderSealFriction, "SeatedSeal", "Cylinder friction that grows with the head pressure until the "
        "seal is fully pressed on: μ A p_1 tanh(p/p_1), p_1 = 0.3 MPa. Source: gaps that rings fill; form chosen.",
        {"packing": ("-", 0.004, 0.15)}, cylinder_friction_level=lambda e, s, z: e.packing * s.cylinder_area
        * 0.3e6 * jnp.tanh(gauge(s, "head_pressure") / 0.3e6)),
    law(library.LoadSpring, "GasSpringLoad", "A gas spring as load: −(k x_0/1.2) ((1 − x/x_0)^(−1.2) − 1), "
        "x_0 = 32 mm. Source: polytropic gas in a closed volume.", {"gas_rate": ("N/m", 60.0, 3e5)},
        cylinder_force=_gas_load),
    law(library.LoadSpring, "ToggleLoad", "A load spring that softens: −k x/√(1 + (x/4 mm)²). "
        "Source: toggle linkages, whose lever shortens; statics.", {"gas_rate": ("N/m", 100.0, 5e5)},
        cylinder_force=lambda e, s, z: -e.gas_rate * s.cylinder_position
        / jnp.sqrt(1.0 + jnp.square(s.cylinder_position / 4e-3))),
    law(library.CylinderLeakageRise, "WornZoneLeakage", "Leakage of the cylinder beyond a worn zone: "
        "k 6 mm (1 + tanh((x − 5 mm)/1.2 mm))/2. Source: wear where the rod works most; form chosen.",
        {"wear_slope": ("m^2/(s*Pa)", 1e-12, 1e-10)}, cylinder_leakage_change=lambda e, s, z: e.wear_slope * 3e-3
        * (1.0 + jnp.tanh((s.cylinder_position - 5e-3) / 1.2e-3))),
    law(library.CylinderLeakageRise, "EarlyLeakage", "Leakage of the cylinder that grows fast at the start of its "
        "stroke: k √(x 8 mm), linear below 0.2 mm. Source: a groove of falling depth; form chosen.",
        {"wear_slope": ("m^2/(s*Pa)", 5e-13, 1e-10)}, cylinder_leakage_change=lambda e, s, z: e.wear_slope
        * jnp.sqrt(8e-3) * jnp.maximum(s.cylinder_position, 0.0)
        / jnp.sqrt(jnp.maximum(s.cylinder_position, 0.0) + 0.2e-3)),
)  # fmt: skip
