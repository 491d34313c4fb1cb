"""Other laws of mechanisms of the library, for the tuning cases."""

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

ANGLE = ("rad", -math.pi, math.pi)
GAUGE = 0.5e6  # Pa, a typical pressure in the pump


def _power(x, exponent, width):
    """|x|^exponent with the sign of x, linear within `width` of zero."""
    return x * jnp.exp(0.5 * (exponent - 1.0) * jnp.log(x * x + width * width))


def _travel(s):
    return s.piston_position / REFERENCE_TRAVEL


def _gap_over_pressure(e, s):
    """Laminar flow [m³/s] through a concentric annular gap 20 mm long."""
    conductance = jnp.pi * s.piston_diameter * e.gap**3 / (12.0 * s.viscosity * 20e-3)
    return conductance * (s.chamber_pressure - s.accumulator_pressure)


def bouc_wen(v, r, beta, gamma):
    """δ dr/dt of Bouc-Wen hysteresis with the slip length δ at speed v: v − β |v| r |r| − γ v r²."""
    return v - beta * jnp.abs(v) * r * jnp.abs(r) - gamma * v * r * r


def _bouc_wen(e, s, z):
    return {"bent": bouc_wen(s.sliding_velocity, z.bent, 0.7, 0.3) / e.bend_length}


def _herschel_bulkley(e, s, z):
    v = s.sliding_velocity
    return e.yield_level * jnp.tanh(v / 2.5e-3) + e.consistency * _power(v / 0.1, 0.6, 0.02)


def _released(e, s, z):
    air = e.released_air * s.atmospheric_pressure / jnp.square(s.pressure)
    return air * (1.0 + 2.5 * smooth_positive(1.0 - s.pressure / 0.25e6, 0.05))


def _gauss(s):
    u = (s.piston_position - 0.8e-3) / 2e-3
    return u, jnp.exp(-u * u)


def _gauss_gradient(e, s):
    u, bell = _gauss(s)
    return s.coil_inductance * e.iron_share * -2.0 * u * bell / 2e-3


def _cubic_gradient(e, s):
    return 3.0 * s.coil_inductance * e.cubic_share * jnp.square(_travel(s)) / REFERENCE_TRAVEL


def _angle(e, s):
    return 2.0 * jnp.pi * s.piston_position / e.wave_length + e.wave_shift


def _beat(e, s, z):
    u = _angle(e, s)
    return -0.6 * e.wave_size * (jnp.sin(u) + jnp.sin(0.618 * u + e.second_shift))


def _logarithmic_drag(e, s, z):
    v = s.piston_velocity
    return -e.drag_size * e.drag_speed * jnp.log(1.0 + jnp.abs(v) / e.drag_speed) * jnp.where(v < 0.0, -1.0, 1.0)


def _warm_drag_rates(e, s, z):
    return {"warmth": jnp.square(s.piston_velocity / 0.2) / 0.06 - z.warmth / 0.4}


def _shockley(e, s, z):
    i = s.current
    return -e.diode_drop * jnp.log(1.0 + jnp.abs(i) / 0.03) / math.log(101.0) * jnp.tanh(i / 0.02)


def _one_way(e, s, z):
    ahead = s.voltage - z.follower
    return {"follower": ahead / (e.rise_time * (1.6 - 0.6 * jnp.tanh(ahead / 0.5)))}


def _scored(e, s, z):
    x = s.sliding_position
    zones = jnp.exp(-jnp.square((x - 2.4e-3) / 0.5e-3)) + 0.6 * jnp.exp(-jnp.square((x + 1.7e-3) / 0.5e-3))
    return e.scored_size * zones * smooth_sign(s.sliding_velocity)


def _exponential_seal(e, s, z):
    pressed = sum(0.6e6 * (jnp.exp(p / 0.6e6) - 1.0) for p in gauge_pressures(s))
    return e.lip_size * s.piston_area * pressed * smooth_sign(s.sliding_velocity)


def _hydrodynamic_seal(e, s, z):
    v, pressure = s.sliding_velocity, sum(gauge_pressures(s))
    return e.lip_size * s.piston_area * pressure * v / (jnp.abs(v) + 0.06)


def _rubber_contact(e, s, z):
    d = s.coupling_deflection
    depth = jnp.clip(jnp.abs(d) - 0.5 * e.slot_play, 0.0, 150e-6)
    direction = jnp.where(d > 0.0, 1.0, -1.0)
    force = 15.0 * (jnp.exp(depth / 20e-6) - 1.0) + 15.0 * direction * s.coupling_velocity
    return direction * jnp.where(depth > 0.0, jnp.maximum(force, 0.0), 0.0)


def _worn_play(e, s, z):
    d = s.coupling_deflection
    depth = jnp.abs(d) - 0.5 * e.slot_play * (1.0 + 0.7 * jnp.tanh(_travel(s)))
    direction = jnp.where(d > 0.0, 1.0, -1.0)
    force = 1e6 * depth + 20.0 * s.coupling_velocity * direction
    return direction * jnp.where(depth > 0.0, jnp.maximum(force, 0.0), 0.0)


def _reattached(e, s, z):
    bell = jnp.exp(-jnp.square((s.lift - 0.25e-3) / 0.12e-3))
    return -e.jet_size * s.valve_area * s.pressure_drop * (1.0 - 0.9 * bell)


def _turning_ball(e, s, z):
    return e.mark_area * (1.0 + 0.8 * jnp.sin(2.0 * jnp.pi * e.ball_turns * s.time + e.ball_start))


def _pressed_open(e, s, z):
    return e.mark_area * (0.4 + jnp.abs(s.pressure_drop) / 0.4e6)


def _one_sided_loss(e, flow):
    return e.forward_loss * (1.0 + 0.6 * jnp.tanh(flow / 1e-5))


def _gauge_head(s):
    return jnp.maximum(s.head_pressure - s.atmospheric_pressure, 0.0)


def _mean_gap(s):
    return 0.5 * jnp.maximum(s.chamber_pressure + s.accumulator_pressure, 0.0)


MARKS = {"mark_area": ("m^2", 1e-9, 3e-7)}
TURNING = MARKS | {"ball_turns": ("Hz", 3.0, 9.0), "ball_start": ANGLE}
TURNING_TEXT = ("Leakage past a scratched, slowly turning ball of the {} valves: A (1 + 0.8 sin(2π f t + φ)). "
                "Source: seat balls that turn under uneven flow, which evens their wear; form chosen.")  # fmt: skip
OPENED_TEXT = ("A crack in the seat of the {} valves that pressure opens: A (0.4 + |Δp|/0.4 MPa). "
               "Source: elastic opening of a crack, linear fracture mechanics (Sneddon 1946).")  # fmt: skip
LINE = {"line_mass": ("kg/m^4", 1e6, 5e7)}
LAWS = (
    law(library.LugreFriction, "BoucWenFriction",
        "Hysteretic friction: F r, δ dr/dt = v − 0.7 |v| r |r| − 0.3 v r². Source: Wen, J. Eng. Mech. Div. ASCE 102 "
        "(1976) 249, exponent 2.", {"bend_level": ("N", 2.0, 10.0), "bend_length": ("m", 30e-6, 400e-6)},
        states={"bent": "-"}, mover_friction=lambda e, s, z: e.bend_level * z.bent, rates=_bouc_wen),
    law(library.LugreFriction, "GreaseFriction",
        "Friction of a grease with a yield stress: F_y tanh(v/2.5 mm/s) + K (v/0.1 m/s)^0.6. "
        "Source: Herschel, Bulkley, Kolloid-Z. 39 (1926) 291.",
        {"yield_level": ("N", 1.5, 8.0), "consistency": ("N", 0.5, 4.0)}, mover_friction=_herschel_bulkley),
    law(library.PistonLeakage, "EntranceLossLeakage", "Gap flow with the loss of a sharp entrance: laminar at small, "
        "∝ √Δp at large pressure drops; 2 k Δp/(1 + √(1 + |Δp|/0.12 MPa)). "
        "Source: Shah, London, Laminar Flow Forced Convection in Ducts (1978), developing flow.",
        {"gap": ("m", 14e-6, 40e-6)}, chamber_leakage=lambda e, s, z: 2.0 * _gap_over_pressure(e, s)
        / (1.0 + jnp.sqrt(1.0 + jnp.abs(s.chamber_pressure - s.accumulator_pressure) / 0.12e6))),
    law(library.PistonLeakage, "CentringLeakage", "Leakage past a plunger that the oil film centres at speed: "
        "k Δp (1 + 1.5/(1 + |v|/60 mm/s)²). Source: eccentric gaps, Blackburn, Reethof, Shearer (1960); "
        "film of Reynolds (1886); the change is chosen.", {"gap": ("m", 12e-6, 35e-6)},
        chamber_leakage=lambda e, s, z: _gap_over_pressure(e, s)
        * (1.0 + 1.5 / jnp.square(1.0 + jnp.abs(s.plunger_velocity) / 0.06))),
    law(library.EntrainedAir, "ReleasedAir", "Air, of which more comes out of solution below 0.25 MPa: "
        "α p_atm/p² (1 + 2.5 max(1 − p/0.25 MPa, 0)). Source: Henry's law; Zhou, Vacca, Manhartsgruber, "
        "J. Fluids Eng. 135 (2013) 091101, for the release below saturation.", {"released_air": ("-", 0.002, 0.015)},
        oil_gas=lambda e, s, z: e.released_air * s.atmospheric_pressure, oil_compressibility=_released),
    law(library.EntrainedAir, "VanishingAir",
        "Air that dissolves exponentially with pressure: α p_atm/p² exp(−(p − p_atm)/0.35 MPa). "
        "Source: exponential approach to saturation; LMS Imagine HYD models describe it; form chosen.",
        {"vanishing_air": ("-", 0.003, 0.02)}, oil_gas=lambda e, s, z: e.vanishing_air * s.atmospheric_pressure,
        oil_compressibility=lambda e, s, z: e.vanishing_air * s.atmospheric_pressure / jnp.square(s.pressure)
        * jnp.exp(-jnp.maximum(s.pressure - s.atmospheric_pressure, 0.0) / 0.35e6)),
    law(library.KarnoppFriction, "DwellCylinderFriction", "Friction of the cylinder that grows with dwell time: "
        "F (0.8 + 0.6 w) tanh(v/1 mm/s), 60 ms dw/dt = exp(−(v/4 mm/s)²) − w. "
        "Source: Gonthier, McPhee, Lange, Piedboeuf, Multibody System Dynamics 11 (2004) 209.",
        {"dwell_level": ("N", 3.0, 80.0)}, states={"rest": "-"}, cylinder_friction_force=lambda e, s, z:
        (e.dwell_level * (0.8 + 0.6 * z.rest) + s.cylinder_friction_level) * jnp.tanh(s.cylinder_velocity / 1e-3),
        rates=lambda e, s, z: {"rest": (jnp.exp(-jnp.square(s.cylinder_velocity / 4e-3)) - z.rest) / 0.06}),
    law(library.KarnoppFriction, "GreasedCylinder", "Friction of the cylinder with a grease: "
        "F (tanh(v/0.8 mm/s) + 0.6 (v/0.1 m/s)^0.5). Source: Herschel, Bulkley, Kolloid-Z. 39 (1926) 291.",
        {"greased_level": ("N", 3.0, 60.0)}, cylinder_friction_force=lambda e, s, z: s.cylinder_friction_level
        * jnp.tanh(s.cylinder_velocity / 0.8e-3) + e.greased_level
        * (jnp.tanh(s.cylinder_velocity / 0.8e-3) + 0.6 * _power(s.cylinder_velocity / 0.1, 0.5, 0.02))),
    law(library.ForceConstantDroop, "OneEndDroop", "A force constant that falls only beyond −1 mm: "
        "Km (1 − κ (max(x + 1 mm, 0)/x_m)²). Source: a coil that leaves the field at one end; geometry.",
        {"end_loss": ("-", 0.02, 0.25)}, force_constant_factor=lambda e, s, z:
        1.0 - e.end_loss * jnp.square(jnp.maximum(s.piston_position + 1e-3, 0.0) / REFERENCE_TRAVEL)),
    law(library.ForceConstantDroop, "FringeDroop", "A bell-shaped force constant: Km (1 − κ (1 − exp(−(x/2.2 mm)²))). "
        "Source: fringing of a short gap, Gaussian approximation; Leupold, Permanent Magnet Devices (1996).",
        {"fringe_loss": ("-", 0.02, 0.2)}, force_constant_factor=lambda e, s, z:
        1.0 - e.fringe_loss * (1.0 - jnp.exp(-jnp.square(s.piston_position / 2.2e-3)))),
    law(library.MagneticSaturation, "ExponentialSaturation", "Saturation by an exponential magnetisation curve: "
        "F_e = Km i (1 − exp(−u))/u, u = b |i|. Source: Macfadyen, Simpson, Slater, Wood, Proc. IEE 120 (1973) 902.",
        {"curve_slope": ("1/A", 0.004, 0.2)}, motor_force_factor=lambda e, s, z:
        (1.0 - jnp.exp(-e.curve_slope * jnp.abs(s.current) - 1e-6)) / (e.curve_slope * jnp.abs(s.current) + 1e-6)),
    law(library.MagneticSaturation, "DiffusingSaturation", "Saturation that lags the current: "
        "F_e = Km i/(1 + b m²), 5 ms dm/dt = |i| − m. Source: magnetic diffusion into solid poles; Stoll, The Analysis "
        "of Eddy Currents (1974), one time constant.", {"late_square": ("1/A^2", 0.0005, 0.03)}, states={"soaked": "A"},
        motor_force_factor=lambda e, s, z: 1.0 / (1.0 + e.late_square * jnp.square(z.soaked)),
        rates=lambda e, s, z: {"soaked": (jnp.abs(s.current) - z.soaked) / 5e-3}),
    law(library.ReluctanceForce, "IronPieceInductance", "An inductance with a peak where the coil passes a piece of "
        "iron: L (1 + λ exp(−((x − 0.8 mm)/2 mm)²)), with its force and voltage. "
        "Source: magnetic co-energy; the shape is chosen.", {"iron_share": ("-", 0.03, 0.4)},
        coil_inductance_factor=lambda e, s, z: 1.0 + e.iron_share * _gauss(s)[1],
        coil_voltage_change=lambda e, s, z: -s.current * s.piston_velocity * _gauss_gradient(e, s),
        mover_force=lambda e, s, z: 0.5 * jnp.square(s.current) * _gauss_gradient(e, s)),
    law(library.ReluctanceForce, "CubicInductance", "An inductance with a cubic term: L (1 + λ (x/x_m)³), "
        "with its force and voltage. Source: power series of voice coils; Klippel, J. Audio Eng. Soc. 54 (2006) 907.",
        {"cubic_share": ("-", -0.5, 0.5)}, coil_inductance_factor=lambda e, s, z: 1.0 + e.cubic_share * _travel(s) ** 3,
        coil_voltage_change=lambda e, s, z: -s.current * s.piston_velocity * _cubic_gradient(e, s),
        mover_force=lambda e, s, z: 0.5 * jnp.square(s.current) * _cubic_gradient(e, s)),
    law(library.CoggingForce, "LeaningCogging", "Cogging with asymmetric waves: −A sin(u + 0.7 sin u). Source: "
        "skewed teeth under load; Bianchi, Bolognani, IEEE Trans. Ind. Appl. 38 (2002) 1259; form chosen.",
        {"wave_size": ("N", 0.2, 5.0), "wave_length": ("m", 3e-3, 15e-3), "wave_shift": ANGLE},
        mover_force=lambda e, s, z: -e.wave_size * jnp.sin(_angle(e, s) + 0.7 * jnp.sin(_angle(e, s)))),
    law(library.CoggingForce, "BeatingCogging", "Cogging of two pitches whose ratio is 0.618: "
        "−0.6 A (sin u + sin(0.618 u + ψ)). Source: slot and end effects of different pitch; Zhu, Xia, Howe, Jewell, "
        "IEEE Trans. Magn. 33 (1997) 4175.",
        {"wave_size": ("N", 0.2, 5.0), "wave_length": ("m", 2.5e-3, 10e-3), "wave_shift": ANGLE, "second_shift": ANGLE},
        mover_force=_beat),
    law(library.EddyDrag, "LogarithmicDrag", "Eddy-current drag that grows with the logarithm of speed: "
        "−c v_e ln(1 + |v|/v_e) sgn v. Source: empirical curve of thick brake discs; form chosen.",
        {"drag_size": ("N*s/m", 1.0, 40.0), "drag_speed": ("m/s", 0.03, 0.4)}, mover_force=_logarithmic_drag),
    law(library.EddyDrag, "WarmingDrag", "Eddy-current drag that falls as its conductor heats up: −c v/(1 + w), "
        "dw/dt = (v/0.2 m/s)²/60 ms − w/0.4 s. Source: Joule's law, and resistivity linear in temperature.",
        {"drag_size": ("N*s/m", 1.5, 50.0)}, states={"warmth": "-"},
        mover_force=lambda e, s, z: -e.drag_size * s.piston_velocity / (1.0 + z.warmth), rates=_warm_drag_rates),
    law(library.InverterDeadTime, "PulseDroppingDeadTime", "Dead time that acts less at a large commanded voltage: "
        "−V tanh(i/50 mA) (1 − 0.7 |u|/(|u| + 5 V)). Source: pulses shorter than the dead time are dropped; "
        "Leggate, Kerkman, IEEE Trans. Ind. Electron. 44 (1997) 191; form chosen.", {"pulse_loss": ("V", 0.3, 4.0)},
        coil_voltage_change=lambda e, s, z: -e.pulse_loss * jnp.tanh(s.current / 0.05)
        * (1.0 - 0.7 * jnp.abs(s.voltage) / (jnp.abs(s.voltage) + 5.0))),
    law(library.InverterDeadTime, "DiodeDrop", "Drop at freewheeling diodes: −V ln(1 + |i|/30 mA)/ln(101) sgn i. "
        "Source: Shockley, Bell System Tech. J. 28 (1949) 435.", {"diode_drop": ("V", 0.2, 3.0)},
        coil_voltage_change=_shockley),
    law(library.SupplySag, "BatterySag", "A battery as supply, with polarisation: R (0.5 |i| + w), 40 ms dw/dt = 0.5 "
        "|i| − w. Source: Randles, Discuss. Faraday Soc. 1 (1947) 11: resistance and one charge transfer.",
        {"cell_resistance": ("ohm", 0.1, 2.0)}, states={"polarised": "A"}, supply_voltage_change=lambda e, s, z:
        -jnp.minimum(e.cell_resistance * (0.5 * jnp.abs(s.current) + z.polarised), s.supply_voltage),
        rates=lambda e, s, z: {"polarised": (0.5 * jnp.abs(s.current) - z.polarised) / 0.04}),
    law(library.SupplySag, "FoldingSupply", "A supply that folds back at about 3 A: U/(1 + exp(−(|i| − 3 A)/0.5 A)). "
        "Source: foldback limiting of linear regulators; Horowitz, Hill, The Art of Electronics; form chosen.",
        {"fold": ("V", 0.5, 10.0)}, supply_voltage_change=lambda e, s, z:
        -jnp.minimum(e.fold * 0.5 * (1.0 + jnp.tanh((jnp.abs(s.current) - 3.0) / 1.0)), s.supply_voltage)),
    law(library.AmplifierLag, "LoadedAmplifier", "An amplifier that is slower under load: du_a/dt = (u − u_a)/τ', "
        "τ' = τ (0.4 + |i|/2 A). Source: output choke and finite open-loop gain; Sedra, Smith, Microelectronic "
        "Circuits.", {"unloaded_time": ("s", 0.05e-3, 1.5e-3)}, states={"output": "V"},
        coil_voltage_change=lambda e, s, z: z.output - s.voltage, rates=lambda e, s, z:
        {"output": (s.voltage - z.output) / (e.unloaded_time * (0.4 + jnp.abs(s.current) / 2.0))}),
    law(library.AmplifierLag, "OneWayAmplifier", "An amplifier whose output falls more slowly than it rises: "
        "du_a/dt = d/(τ (1.6 − 0.6 tanh(d/0.5 V))), d = u − u_a. Source: an output stage that sources more than it "
        "sinks; Horowitz, Hill; form chosen.", {"rise_time": ("s", 0.05e-3, 1.5e-3)}, states={"follower": "V"},
        coil_voltage_change=lambda e, s, z: z.follower - s.voltage, rates=_one_way),
    law(library.CoilHeating, "JointHeating", "A poor joint in the coil whose resistance rises with its temperature: "
        "R (1 + s (ϑ/5 K)²), dϑ/dt = R i²/(2 J/K) − ϑ/0.5 s. Source: PTC behaviour of a poor joint; form chosen.",
        {"joint_rise": ("-", 0.02, 0.6)}, states={"heat": "K"},
        coil_resistance_factor=lambda e, s, z: 1.0 + e.joint_rise * jnp.square(z.heat / 5.0),
        rates=lambda e, s, z: {"heat": s.resistance * jnp.square(s.current) / 2.0 - z.heat / 0.5}),
    law(library.CoilHeating, "InsulatedHeating", "Heating of the winding with two lags: R (1 + 0.0039 ϑ), 50 ms dϑ/dt "
        "= ϑ_i − ϑ, dϑ_i/dt = q R i² − ϑ_i/2 s. Source: two thermal masses in series; form chosen.",
        {"heat_up": ("K/J", 0.03, 1.0)}, states={"inner": "K", "outer": "K"},
        coil_resistance_factor=lambda e, s, z: 1.0 + 0.0039 * z.outer, rates=lambda e, s, z:
        {"inner": e.heat_up * s.resistance * jnp.square(s.current) - z.inner / 2.0,
         "outer": (z.inner - z.outer) / 0.05}),
    law(library.ConstantBiasForce, "SettingBias", "A force that falls with the distance travelled: −F (0.4 + 0.6 "
        "exp(−w/60 mm)), dw/dt = |v|, either sign. Source: set of a preloaded seal; the length is chosen.",
        {"pull": ("N", -5.0, 5.0)}, states={"way": "m"},
        mover_force=lambda e, s, z: -e.pull * (0.4 + 0.6 * jnp.exp(-z.way / 0.06)),
        rates=lambda e, s, z: {"way": jnp.abs(s.piston_velocity)}),
    law(library.ConstantBiasForce, "MagnetisedBias", "The pull of iron that the coil magnetises a little: "
        "−F (1 + 0.35 tanh(i/1 A)), either sign. Source: remanence of soft iron; Bozorth, Ferromagnetism (1951).",
        {"pull": ("N", -5.0, 5.0)}, mover_force=lambda e, s, z: -e.pull * (1.0 + 0.35 * jnp.tanh(s.current / 1.0))),
    law(library.ParasiticSpring, "BuckledSpring", "A flexure near buckling: −k x (1 − 0.8/√(1 + (x/2.5 mm)²)). "
        "Source: von Mises' truss, ZAMM 3 (1923) 406.", {"flexure_rate": ("N/m", 100.0, 5000.0)},
        mover_force=lambda e, s, z: -e.flexure_rate * s.piston_position
        * (1.0 - 0.8 / jnp.sqrt(1.0 + jnp.square(s.piston_position / 2.5e-3)))),
    law(library.ParasiticSpring, "TendonSpring",
        "A spring that stiffens exponentially: −k x_0 sinh(x/x_0), x_0 = 1.6 mm. "
        "Source: Fung, Am. J. Physiology 213 (1967) 1532.", {"flexure_rate": ("N/m", 30.0, 2000.0)},
        mover_force=lambda e, s, z: -e.flexure_rate * 0.8e-3
        * (jnp.exp(s.piston_position / 1.6e-3) - jnp.exp(-s.piston_position / 1.6e-3))),
    law(library.AsymmetricFriction, "PressedLip", "Friction of the forward stroke only, growing with p_A: "
        "F_a (0.3 + p_A/0.5 MPa) max(th(v), 0). Source: pressure-energised lips; Nau, Tribology Int. 32 (1999) 463.",
        {"lip_level": ("N", 0.3, 5.0)}, mover_friction=lambda e, s, z: e.lip_level
        * (0.3 + gauge_pressures(s)[0] / GAUGE) * jnp.maximum(smooth_sign(s.sliding_velocity), 0.0)),
    law(library.AsymmetricFriction, "RunningInFriction", "Friction of the forward stroke only, falling with time: "
        "F_a (0.3 + 0.7 exp(−t/0.15 s)) max(th(v), 0). Source: running-in of lips; Blau, Wear 38 (2005) 1007.",
        {"lip_level": ("N", 0.4, 6.0)}, mover_friction=lambda e, s, z: e.lip_level
        * (0.3 + 0.7 * jnp.exp(-s.time / 0.15)) * jnp.maximum(smooth_sign(s.sliding_velocity), 0.0)),
    law(library.AsymmetricDamping, "WavyDamping", "Viscous friction that differs between the directions along a wavy "
        "guide: −c |v| (1 + 0.6 cos(2π x/4 mm)). Source: Reynolds film over a wavy surface; form chosen.",
        {"guide_size": ("N*s/m", -60.0, 60.0)}, mover_force=lambda e, s, z: -e.guide_size * jnp.abs(s.piston_velocity)
        * (1.0 + 0.6 * jnp.cos(2.0 * jnp.pi * s.piston_position / 4e-3))),
    law(library.AsymmetricDamping, "LoadedGuideDamping", "Viscous friction that differs between the directions and "
        "grows with current: −c |v| (0.2 + 2 i²/(i² + (3 A)²)). Source: side pull of the motor on its guide; form "
        "chosen.",
        {"guide_size": ("N*s/m", -60.0, 60.0)}, mover_force=lambda e, s, z: -e.guide_size * jnp.abs(s.piston_velocity)
        * (0.2 + 2.0 * jnp.square(s.current) / (jnp.square(s.current) + 9.0))),
    law(library.StrokeDependentFriction, "ScoredFriction", "Dry friction in two scored zones, at 2.4 mm and −1.7 mm. "
        "Source: scoring near the ends of a bore; form chosen.", {"scored_size": ("N", 0.5, 10.0)},
        mover_friction=_scored),
    law(library.StrokeDependentFriction, "DraggingEnds", "Friction at the ends of the stroke that grows with speed: "
        "F_s (x/x_m)² v/√(v² + (60 mm/s)²). Source: squeeze and shear of oil in narrow ends; form chosen.",
        {"end_level": ("N", 0.5, 15.0)}, mover_friction=lambda e, s, z: e.end_level
        * jnp.square(s.sliding_position / REFERENCE_TRAVEL) * s.sliding_velocity
        / jnp.sqrt(jnp.square(s.sliding_velocity) + 0.06**2)),
    law(library.SealFriction, "ExponentialSeal", "Seal friction that grows exponentially with pressure: "
        "μ S_p Σ p_1 (exp(p/p_1) − 1) th(v), p_1 = 0.6 MPa. Source: extrusion of soft rings; form chosen.",
        {"lip_size": ("-", 0.003, 0.1)}, mover_friction=_exponential_seal),
    law(library.SealFriction, "HydrodynamicSeal", "Seal friction with a full oil film: μ S_p Σ p v/(|v| + 60 mm/s). "
        "Source: Hirano, Kaneta, inverse hydrodynamic theory of seals (1971); form chosen.",
        {"lip_size": ("-", 0.008, 0.25)}, mover_friction=_hydrodynamic_seal),
    law(library.CouplingCompliance, "SofteningCoupling", "A coupling that softens under load: "
        "k Δ/(1 + |Δ|/50 µm) + 20 N·s/m Δ̇. Source: Payne effect of filled rubber; form chosen.",
        {"joint_compliance": ("m/N", 1e-7, 6e-6)}, coupling_force=lambda e, s, z: s.coupling_deflection
        / (e.joint_compliance * (1.0 + jnp.abs(s.coupling_deflection) / 50e-6)) + 20.0 * s.coupling_velocity),
    law(library.CouplingCompliance, "RubbingCoupling", "A coupling with friction in its clamp: "
        "k (Δ + 12 µm tanh(Δ̇/1.5 mm/s)) + 5 N·s/m Δ̇. Source: Goodman, Klumpp, J. Applied Mechanics 23 (1956) 421.",
        {"joint_compliance": ("m/N", 2e-7, 1e-5)}, coupling_force=lambda e, s, z: (s.coupling_deflection
        + 12e-6 * jnp.tanh(s.coupling_velocity / 1.5e-3)) / e.joint_compliance + 5.0 * s.coupling_velocity),
    law(library.Backlash, "RubberBacklash", "Backlash between rubber faces: contact force 15 N (exp(d/20 µm) − 1) and "
        "15 N·s/m beyond ±b/2. Source: exponential bumpers; form chosen.", {"slot_play": ("m", 4e-6, 100e-6)},
        coupling_force=_rubber_contact),
    law(library.Backlash, "WornBacklash", "Backlash that is larger at one end of the stroke: b (1 + 0.7 tanh(x/x_m)), "
        "with contacts of 1e6 N/m. Source: wear of a guide where it works most; form chosen.",
        {"slot_play": ("m", 4e-6, 100e-6)}, coupling_force=_worn_play),
    law(library.ValveFlowForce, "ReattachedJet", "A flow force that nearly vanishes where the jet reattaches: "
        "−K A Δp (1 − 0.9 exp(−((y − 0.25 mm)/0.12 mm)²)). Source: Takenaka, Yamane, Iwamizu, Bull. JSME 7 (1964), "
        "thrust of disc valves; form chosen.", {"jet_size": ("-", 0.15, 1.8)}, check_valve_force=_reattached),
    law(library.ValveFlowForce, "SteepFlowForce", "A flow force with the power 1.4 of the pressure drop: "
        "−K A 0.1 MPa (Δp/0.1 MPa)^1.4. Source: contraction that grows with the jet's momentum; form chosen.",
        {"jet_size": ("-", 0.1, 1.2)}, check_valve_force=lambda e, s, z:
        -e.jet_size * s.valve_area * 0.1e6 * _power(s.pressure_drop / 0.1e6, 1.4, 0.05)),
    law(library.ValveAdhesion, "FarAdhesion", "Adhesion with a long range: −F/(1 + y/25 µm) while the valve opens. "
        "Source: capillary bridges, force ∝ 1/gap; Israelachvili, Intermolecular and Surface Forces; form chosen.",
        {"bridge_force": ("N", 0.05, 3.0)}, check_valve_force=lambda e, s, z: -e.bridge_force
        / (1.0 + jnp.maximum(s.lift, 0.0) / 25e-6) * 0.5 * (1.0 + jnp.tanh(s.lift_velocity / 2e-3))),
    law(library.ValveAdhesion, "SuckedBall", "Adhesion of a ball that pressure presses into an elastic seat: "
        "−F tanh(|Δp|/60 kPa) exp(−max(y, 0)/30 µm), at any speed. Source: Hertz contact that holds by its rim; form "
        "chosen.", {"bridge_force": ("N", 0.05, 4.0)}, check_valve_force=lambda e, s, z: -e.bridge_force
        * jnp.tanh(jnp.abs(s.pressure_drop) / 60e3) * jnp.exp(-jnp.maximum(s.lift, 0.0) / 30e-6)),
    law(library.SuctionSeatLeakage, "TurningSuctionBall", TURNING_TEXT.format("suction"), TURNING,
        suction_valve_area=_turning_ball),
    law(library.SuctionSeatLeakage, "CrackedSuctionSeat", OPENED_TEXT.format("suction"), MARKS,
        suction_valve_area=_pressed_open),
    law(library.DeliverySeatLeakage, "TurningDeliveryBall", TURNING_TEXT.format("delivery"), TURNING,
        delivery_valve_area=_turning_ball),
    law(library.DeliverySeatLeakage, "CrackedDeliverySeat", OPENED_TEXT.format("delivery"), MARKS,
        delivery_valve_area=_pressed_open),
    law(library.HoseCompliance, "BraidedHose", "A hose that its braid stiffens above about 0.5 MPa: "
        "C (1 − 0.8 tanh((p − 0.5 MPa)/80 kPa))/1.8. Source: lock angle of braids; form chosen.",
        {"wall_compliance": ("m^3/Pa", 1e-14, 1e-11)}, outlet_capacity=lambda e, s, z:
        e.wall_compliance * (1.0 - 0.8 * jnp.tanh((s.outlet_pressure - 0.5e6) / 80e3)) / 1.8),
    law(library.HoseCompliance, "MullinsHose",
        "A rubber hose that softens as it is worked: C (1 − 0.7 exp(−t/0.12 s)). "
        "Source: Mullins, Rubber Chemistry and Technology 42 (1969) 339.",
        {"wall_compliance": ("m^3/Pa", 1e-14, 1e-11)},
        outlet_capacity=lambda e, s, z: e.wall_compliance * (1.0 - 0.7 * jnp.exp(-s.time / 0.12))),
    law(library.OutletLineInertance, "MixedLineInertance", "A line with inertance and a loss ∝ Q^1.5: "
        "I dQ/dt = Δp − k √|Q| Q. Source: transition flow, between Hagen-Poiseuille and Darcy-Weisbach.",
        LINE | {"mixed_loss": ("kg/(s*m^5.5)", 2e10, 3e11)}, states={"moving": "m^3/s"},
        outlet_line_resistance=lambda e, s, z: e.mixed_loss * jnp.sqrt(jnp.abs(z.moving) + 1e-8),
        outlet_line_flow=lambda e, s, z: z.moving,
        rates=lambda e, s, z: {"moving": outlet_line_drop(s, z.moving) / e.line_mass}),
    law(library.OutletLineInertance, "OneWayLineInertance", "A line with inertance whose loss is larger forward: "
        "R (1 + 0.6 tanh(Q/0.6 L/min)). Source: Tesla, US patent 1329559 (1920), fluidic diodes; form chosen.",
        LINE | {"forward_loss": ("Pa*s/m^3", 1e8, 2e9)}, states={"moving": "m^3/s"},
        outlet_line_resistance=lambda e, s, z: _one_sided_loss(e, z.moving), outlet_line_flow=lambda e, s, z: z.moving,
        rates=lambda e, s, z: {"moving": outlet_line_drop(s, z.moving) / e.line_mass}),
    law(library.OutletLineResistance, "CouplingPoppet", "A quick coupling whose poppet opens with pressure: "
        "R (0.35 + exp(−(p − p_s)/0.15 MPa)). Source: spring-loaded poppet in the line; form chosen.",
        {"poppet_size": ("Pa*s/m^3", 2e8, 1e10)}, outlet_line_resistance=lambda e, s, z: e.poppet_size
        * (0.35 + jnp.exp(-jnp.maximum(s.outlet_pressure - s.accumulator_pressure, 0.0) / 0.15e6))),
    law(library.OutletLineResistance, "SiltingLine",
        "A line that silts up steadily: R (0.4 + t/0.4 s). Source: Hermia, "
        "Trans. IChemE 60 (1982) 183, blocking laws; linear in time here.", {"silt_size": ("Pa*s/m^3", 1e8, 8e9)},
        outlet_line_resistance=lambda e, s, z: e.silt_size * (0.4 + s.time / 0.4)),
    law(library.SuctionLineResistance, "ThinningSuctionLine", "A suction line with oil that thins as it "
        "flows: R (0.4 + exp(−|v|/80 mm/s)). Source: thixotropic cold oil; Barnes, J. Non-Newtonian Fluid Mech. 70 "
        "(1997) 1; form chosen.", {"cold_size": ("Pa*s/m^3", 2e7, 4e9)}, suction_line_resistance=lambda e, s, z:
        e.cold_size * (0.4 + jnp.exp(-jnp.abs(s.sliding_velocity) / 0.08))),
    law(library.SuctionLineResistance, "BlockingStrainer",
        "A strainer that clogs steadily: R (0.3 + t/0.35 s). Source: "
        "Hermia, Trans. IChemE 60 (1982) 183, intermediate blocking.", {"block_size": ("Pa*s/m^3", 2e7, 3e9)},
        suction_line_resistance=lambda e, s, z: e.block_size * (0.3 + s.time / 0.35)),
    law(library.SuctionLineInertance, "MixedSuctionInertance", "A suction line with inertance and a loss ∝ Q^1.5: "
        "I dQ/dt = Δp − k √|Q| Q. Source: transition flow, between Hagen-Poiseuille and Darcy-Weisbach.",
        LINE | {"mixed_loss": ("kg/(s*m^5.5)", 1e10, 1e11)}, states={"moving": "m^3/s"},
        suction_line_resistance=lambda e, s, z: 5e6 + e.mixed_loss * jnp.sqrt(jnp.abs(z.moving) + 1e-8),
        suction_line_flow=lambda e, s, z: z.moving,
        rates=lambda e, s, z: {"moving": suction_line_drop(s, z.moving) / e.line_mass}),
    law(library.SuctionLineInertance, "OneWaySuctionInertance", "A suction line with inertance whose loss is larger "
        "forward: R (1 + 0.6 tanh(Q/0.6 L/min)). Source: entrance losses of a re-entrant pipe; Idelchik; form chosen.",
        LINE | {"forward_loss": ("Pa*s/m^3", 1e7, 3e8)}, states={"moving": "m^3/s"},
        suction_line_resistance=lambda e, s, z: _one_sided_loss(e, z.moving),
        suction_line_flow=lambda e, s, z: z.moving,
        rates=lambda e, s, z: {"moving": suction_line_drop(s, z.moving) / e.line_mass}),
    law(library.OilTemperature, "CurvedViscosity", "Viscosity whose logarithm is curved over temperature: "
        "exp(−b ΔT (1 − ΔT/60 K)), ΔT = T − 313 K. Source: second-order fit of ASTM D341 charts; form chosen.",
        {"curved_slope": ("1/K", 0.015, 0.05)}, oil_viscosity_factor=lambda e, s, z: jnp.exp(
        -e.curved_slope * (s.oil_temperature - 313.15) * (1.0 - (s.oil_temperature - 313.15) / 60.0))),
    law(library.OilTemperature, "AbsoluteViscosity", "Viscosity by a power of absolute temperature: (T/313 K)^(−n). "
        "Source: Cornelissen, Waterman, Chem. Eng. Science 4 (1955) 238, simplest form.",
        {"absolute_power": ("-", 4.0, 16.0)},
        oil_viscosity_factor=lambda e, s, z: jnp.exp(-e.absolute_power * jnp.log(s.oil_temperature / 313.15))),
    law(library.PressureViscosity, "RootPressureViscosity", "Viscosity that rises with the root of the pressure in the "
        "gap: 1 + b √(p̄/0.5 MPa). Source: free-volume fits at low pressure; form chosen.",
        {"root_rise": ("-", 0.01, 0.2)},
        gap_viscosity_factor=lambda e, s, z: 1.0 + e.root_rise * jnp.sqrt(_mean_gap(s) / GAUGE + 1e-3)),
    law(library.PressureViscosity, "RisingGapViscosity", "Viscosity that rises with pressure, less at speed, where the "
        "film heats up: 1 + b (p̄/0.5 MPa)/(1 + |v|/0.1 m/s). Source: Barus' law and viscous heating; form chosen.",
        {"gap_rise": ("-", 0.01, 0.2)}, gap_viscosity_factor=lambda e, s, z: 1.0 + e.gap_rise * _mean_gap(s) / GAUGE
        / (1.0 + jnp.abs(s.piston_velocity) / 0.1)),
    law(library.CylinderSealFriction, "ExponentialCylinderSeal", "Cylinder friction that grows exponentially with the "
        "head pressure: μ A p_1 (exp(p/p_1) − 1), p_1 = 0.4 MPa. Source: extrusion of soft rings; form chosen.",
        {"ring_share": ("-", 0.002, 0.06)}, cylinder_friction_level=lambda e, s, z: e.ring_share * s.cylinder_area
        * 0.4e6 * (jnp.exp(jnp.minimum(_gauge_head(s) / 0.4e6, 4.0)) - 1.0)),
    law(library.CylinderSealFriction, "NarrowingCylinderSeal", "Cylinder friction that grows with pressure and along "
        "the stroke: μ A p (0.4 + 0.8 x/8 mm). Source: a bore that narrows; form chosen.",
        {"ring_share": ("-", 0.004, 0.1)}, cylinder_friction_level=lambda e, s, z: e.ring_share * s.cylinder_area
        * _gauge_head(s) * (0.4 + 0.8 * jnp.clip(s.cylinder_position / 8e-3, 0.0, 2.0))),
    law(library.LoadSpring, "TendonLoad", "A load spring that stiffens exponentially: −k x_0 (exp(x/x_0) − 1), "
        "x_0 = 5 mm. Source: Fung, Am. J. Physiology 213 (1967) 1532.", {"load_rate": ("N/m", 50.0, 1e5)},
        cylinder_force=lambda e, s, z:
        -e.load_rate * 5e-3 * (jnp.exp(jnp.clip(s.cylinder_position / 5e-3, -4.0, 4.0)) - 1.0)),
    law(library.LoadSpring, "BumperLoad", "A load spring with a bumper from 4 mm on: −k x − 3 k max(x − 4 mm, 0). "
        "Source: statics; rounded within 0.5 mm.", {"load_rate": ("N/m", 50.0, 2e5)}, cylinder_force=lambda e, s, z:
        -e.load_rate * (s.cylinder_position + 3.0 * smooth_positive(s.cylinder_position - 4e-3, 0.5e-3))),
    law(library.CylinderLeakageRise, "PressedOpenLeakage", "Leakage of the cylinder that grows with position and "
        "pressure: k x (0.3 + p_h/0.5 MPa). Source: a tube that widens under pressure; Lamé.",
        {"bore_share": ("m^2/(s*Pa)", 5e-13, 1e-10)}, cylinder_leakage_change=lambda e, s, z: e.bore_share
        * jnp.maximum(s.cylinder_position, 0.0) * (0.3 + _gauge_head(s) / GAUGE)),
    law(library.CylinderLeakageRise, "ChatterMarkLeakage", "Leakage of the cylinder past chatter marks 3 mm apart: "
        "k x (1 + 0.8 sin(2π x/3 mm)). Source: honing faults of bores; form chosen.",
        {"bore_share": ("m^2/(s*Pa)", 1e-12, 1e-10)}, cylinder_leakage_change=lambda e, s, z: e.bore_share
        * jnp.maximum(s.cylinder_position, 0.0) * (1.0 + 0.8 * jnp.sin(2.0 * jnp.pi * s.cylinder_position / 3e-3))),
)  # fmt: skip
