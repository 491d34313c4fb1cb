"""Laws for tuning: those of mechanisms of the library, and those of mechanisms that it does not have."""

import math

import jax.numpy as jnp

from edhas_jax.machine import effects as library
from edhas_jax.machine.effects.reference_scales import REFERENCE_TRAVEL, smooth_sign
from studies.hidden_effects.generators.functions import (
    arctan,
    gauge_pressures,
    outlet_line_drop,
    signed_root,
    suction_line_drop,
    triangle,
)
from studies.hidden_effects.generators.laws import law

ANGLE = ("rad", -math.pi, math.pi)
SCRATCH_PRESSURE = 0.2e6  # Pa, at which a scratch has its stated area


def _sign(x):
    return jnp.where(x < 0.0, -1.0, 1.0)


def _yield_rate(e, s, z):
    v = s.sliding_velocity
    left = 1.0 - z.force / e.dahl_level * _sign(v)
    return {"force": e.dahl_stiffness * v * left * jnp.abs(left)}


def _saturating_drag(e, s, z):
    v = s.piston_velocity
    return -e.eddy_size * e.eddy_speed * (1.0 - jnp.exp(-jnp.abs(v) / e.eddy_speed)) * _sign(v)


def _sliding(e, s, z):
    v = s.sliding_velocity
    return e.sliding_level * jnp.tanh(v / 4e-3) + e.linear_part * v + e.quadratic_part * v * jnp.abs(v)


def _root_seal(e, s, z):
    a, b = (jnp.sqrt(5e5 * (p + 1.0)) for p in gauge_pressures(s))
    return e.seal_size * s.piston_area * (a + b) * smooth_sign(s.sliding_velocity)


def _phase(e, s):
    return 2.0 * jnp.pi * s.piston_position / e.cogging_length + e.cogging_shift


def _two_harmonics(e, s, z):
    u = _phase(e, s)
    return -e.cogging_size * (jnp.sin(u) + 0.5 * jnp.sin(2.0 * u + e.harmonic_shift))


def _filter_rates(e, s, z):
    omega = 1.4 / e.filter_time
    return {"filtered": omega * z.slope, "slope": omega * (s.voltage - z.filtered - 1.4 * z.slope)}


def _inductance_gradient(e, s):
    return -2.0 * s.coil_inductance * e.inductance_curvature * s.piston_position / REFERENCE_TRAVEL**2


def _hertzian_play(e, s, z):
    d = s.coupling_deflection
    depth = jnp.maximum(jnp.abs(d) - 0.5 * e.play, 0.0)
    direction = jnp.where(d > 0.0, 1.0, -1.0)
    contact = depth * jnp.sqrt(depth + 1e-12)
    # 1e8 N/m^1.5 gives the stiffness of 1e6 N/m at 44 µm
    return direction * jnp.maximum(1e8 * contact * (1.0 + 0.3 * s.coupling_velocity * direction), 0.0)


def _concentric_leakage(e, s, z):
    conductance = jnp.pi * s.piston_diameter * e.leakage_gap**3 / (12.0 * s.viscosity * 20e-3)
    return conductance * (s.chamber_pressure - s.accumulator_pressure)


def _turning_jet(e, s, z):
    angle = jnp.minimum(0.8 + 0.7e3 * jnp.maximum(s.lift, 0.0), 0.5 * jnp.pi)
    return -e.flow_force_size * s.valve_area * s.pressure_drop * jnp.cos(angle)


def _adhesion(e, s, z):
    film = jnp.exp(-jnp.maximum(s.lift, 0.0) / 15e-6)
    return -e.adhesion_size * film * 0.5 * (1.0 + jnp.tanh(s.lift_velocity / 0.5e-3))


def _scratch(e, s, z):
    return e.scratch_size * jnp.sqrt(jnp.abs(s.pressure_drop) / SCRATCH_PRESSURE + 1e-6)


def _pressure_viscosity(e, s, z):
    mean = 0.5 * jnp.maximum(s.chamber_pressure + s.accumulator_pressure, 0.0)
    return 1.0 + e.viscosity_rise * mean * mean / 0.5e6


def _mass_force(e, s, z):
    omega = 2.0 * jnp.pi * e.tuned_frequency
    return omega * omega * z.displacement + 0.2 * omega * z.speed


_SCRATCH_TEXT = ("A fine scratch in the seat of the {} valves with laminar flow: area ∝ √Δp, so that Q ∝ Δp. "
                 "Source: laminar leakage of seat valves at small openings; Merritt (1967).")  # fmt: skip
LAWS = (
    law(library.LugreFriction, "StaticSlidingFriction",
        "Coulomb, viscous and quadratic friction without bristles: F_C tanh(v/4 mm/s) + c v + q v |v|. "
        "Source: Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083, static friction models.",
        {"sliding_level": ("N", 2.0, 10.0), "linear_part": ("N*s/m", 1.0, 5.0),
         "quadratic_part": ("N*s^2/m^2", 1.0, 20.0)}, mover_friction=_sliding),
    law(library.LugreFriction, "SlowYieldFriction",
        "Dahl's friction with the exponent 2: dF/dt = σ v (1 − r)², r = (F/F_C) sgn v, a slow approach to F_C. "
        "Source: Dahl, Aerospace Corporation TOR-158(3107-18) (1968); AIAA J. 14 (1976) 1675.",
        {"dahl_level": ("N", 2.0, 10.0), "dahl_stiffness": ("N/m", 4e3, 4e4)}, states={"force": "N"},
        mover_friction=lambda e, s, z: z.force, rates=_yield_rate),
    law(library.CoggingForce, "TriangularCogging", "Cogging as a triangle wave over the position. Source: the simplest "
        "form of an attraction that is constant between the positions of rest of wide teeth; chosen.",
        {"cogging_size": ("N", 0.2, 5.0), "cogging_length": ("m", 3e-3, 14e-3), "cogging_shift": ANGLE},
        mover_force=lambda e, s, z: -e.cogging_size * triangle(_phase(e, s))),
    law(library.CoggingForce, "TwoHarmonicCogging", "Cogging with its second harmonic: −A (sin u + 0.5 sin(2 u + ψ)). "
        "Source: Fourier series of cogging forces; Gieras, Piech, Tomczuk, Linear Synchronous Motors (2011).",
        {"cogging_size": ("N", 0.2, 5.0), "cogging_length": ("m", 4e-3, 16e-3), "cogging_shift": ANGLE,
         "harmonic_shift": ANGLE}, mover_force=_two_harmonics),
    law(library.EddyDrag, "RationalEddyDrag",
        "Eddy drag that falls slowly beyond its largest value: −c v/(1 + |v|/v_e)², largest at v_e. "
        "Source: fitted forms of eddy-current brakes, Simeu, Georges, Control Eng. Practice 4 (1996) 19.",
        {"eddy_size": ("N*s/m", 1.0, 40.0), "eddy_speed": ("m/s", 0.05, 0.5)}, mover_force=lambda e, s, z:
        -e.eddy_size * s.piston_velocity / jnp.square(1.0 + jnp.abs(s.piston_velocity) / e.eddy_speed)),
    law(library.EddyDrag, "ExponentialEddyDrag", "Eddy drag that saturates: −c v_e (1 − exp(−|v|/v_e)) sgn v. "
        "Source: an empirical saturation curve, as for drag torques of clutches and brakes.",
        {"eddy_size": ("N*s/m", 1.0, 40.0), "eddy_speed": ("m/s", 0.05, 0.5)}, mover_force=_saturating_drag),
    law(library.ParasiticSpring, "HardeningSpring", "A spring that hardens: −k x (1 + (x/3 mm)²). "
        "Source: Duffing, Erzwungene Schwingungen bei veränderlicher Eigenfrequenz (1918).",
        {"spring_size": ("N/m", 50.0, 3000.0)}, mover_force=lambda e, s, z:
        -e.spring_size * s.piston_position * (1.0 + jnp.square(s.piston_position / 3e-3))),
    law(library.ConstantBiasForce, "TrailingBias",
        "A magnet's pull that falls along the stroke: −F (1 − 0.4 x/x_m), either sign. "
        "Source: force of a magnet over a small change of its gap, first terms of 1/(g + x)².",
        {"bias_size": ("N", -5.0, 5.0)},
        mover_force=lambda e, s, z: -e.bias_size * (1.0 - 0.4 * s.piston_position / REFERENCE_TRAVEL)),
    law(library.AsymmetricFriction, "ForwardHardFriction", "Dry friction in the forward stroke only, which sets in at "
        "once: F_a max(tanh(v/1 mm/s), 0) (1 + v/0.3 m/s). Source: lip seals, whose lip digs in when it moves against "
        "the film; Müller, Nau, Fluid Sealing Technology (1998).", {"forward_size": ("N", 0.3, 5.0)},
        mover_friction=lambda e, s, z: e.forward_size * jnp.maximum(jnp.tanh(s.sliding_velocity / 1e-3), 0.0)
        * (1.0 + s.sliding_velocity / 0.3)),
    law(library.AsymmetricDamping, "QuadraticAsymmetricDamping",
        "Drag that differs between the directions with the square of speed: −c v²/0.2 m/s, either sign. Source: flow "
        "drag in a passage that has another loss coefficient in each direction; Idelchik, Handbook of Hydraulic "
        "Resistance.", {"asymmetry_size": ("N*s/m", -60.0, 60.0)},
        mover_force=lambda e, s, z: -e.asymmetry_size * jnp.square(s.piston_velocity) / 0.2),
    law(library.StrokeDependentFriction, "LinearEndFriction",
        "Dry friction in proportion to the distance from mid-stroke: F_s |x|/x_m th(v). "
        "Source: friction of a tilted guide under a side load that grows with the overhang.",
        {"end_size": ("N", 0.5, 10.0)}, mover_friction=lambda e, s, z:
        e.end_size * jnp.abs(s.sliding_position) / REFERENCE_TRAVEL * smooth_sign(s.sliding_velocity)),
    law(library.SealFriction, "RootSealFriction", "Seal friction in proportion to the root of the pressure: "
        "μ S_p (√(p_A p_1) + √(p_B p_1)) th(v), p_1 = 0.5 MPa. "
        "Source: contact width of O-rings that grows less than the pressure; Müller, Nau (1998).",
        {"seal_size": ("-", 0.005, 0.2)}, mover_friction=_root_seal),
    law(library.CouplingCompliance, "HardeningCoupling",
        "A coupling that hardens: k Δ (1 + (Δ/40 µm)²) + 20 N·s/m Δ̇, with the compliance 1/k. "
        "Source: preloaded joints, whose contact area grows with the load; the form is chosen.",
        {"rod_compliance": ("m/N", 1e-7, 1e-5)}, coupling_force=lambda e, s, z: s.coupling_deflection / e.rod_compliance
        * (1.0 + jnp.square(s.coupling_deflection / 40e-6)) + 20.0 * s.coupling_velocity),
    law(library.Backlash, "HertzianBacklash", "Play with contacts after Hertz: k (|Δ| − b/2)^1.5 beyond the play, "
        "k = 1e8 N/m^1.5, and damping in contact. "
        "Source: Hertz (1881); Hunt, Crossley, J. Applied Mechanics 42 (1975) 440.",
        {"play": ("m", 2e-6, 100e-6)}, coupling_force=_hertzian_play),
    law(library.ForceConstantDroop, "CosineDroop",
        "A force constant that falls as a cosine: Km (1 − 2 κ (1 − cos(π x/(2 x_m)))), x_m = 5 mm. "
        "Source: fundamental of the field of a magnet array.", {"droop_size": ("-", 0.015, 0.15)},
        force_constant_factor=lambda e, s, z: 1.0 - 2.0 * e.droop_size
        * (1.0 - jnp.cos(0.5 * jnp.pi * s.piston_position / REFERENCE_TRAVEL))),
    law(library.MagneticSaturation, "RationalSaturation",
        "Saturation from the first ampere on: F_e = Km i/(1 + |i| b). "
        "Source: Fröhlich's magnetisation curve B = H/(a + b H), ETZ 2 (1881).",
        {"saturation_slope": ("1/A", 0.002, 0.1)},
        motor_force_factor=lambda e, s, z: 1.0 / (1.0 + jnp.abs(s.current) * e.saturation_slope)),
    law(library.InverterDeadTime, "ArctanDeadTime", "Dead time with a wide transition: −V (2/π) atan(i/0.1 A). "
        "Source: clamping of the current around zero; Jeong, Park, IEEE Trans. Ind. Electron. 38 (1991) 108.",
        {"lost_voltage": ("V", 0.2, 3.0)},
        coil_voltage_change=lambda e, s, z: -e.lost_voltage * (2.0 / math.pi) * arctan(s.current / 0.1)),
    law(library.InverterDeadTime, "OffsetDeadTime",
        "Dead time with a hard step where the current is not zero: −V sgn(i − i_0), as of unequal switches. Source: "
        "unequal device drops of a half bridge; Choi, Sul, IEEE Trans. Power Electron. 11 (1996) 221.",
        {"lost_voltage": ("V", 0.2, 3.0), "step_current": ("A", -0.15, 0.15)},
        coil_voltage_change=lambda e, s, z: -e.lost_voltage * jnp.tanh((s.current - e.step_current) / 5e-3)),
    law(library.AmplifierLag, "SecondOrderAmplifier",
        "An amplifier with a second-order low-pass of damping 0.7: ü_a = ω² (u − u_a) − 1.4 ω u̇_a, τ = 1.4/ω. "
        "Source: output filter of a switching amplifier; Erickson, Maksimović, Fundamentals of Power Electronics.",
        {"filter_time": ("s", 0.05e-3, 2e-3)}, states={"filtered": "V", "slope": "V"},
        coil_voltage_change=lambda e, s, z: z.filtered - s.voltage, rates=_filter_rates),
    law(library.CoilHeating, "MagnetHeating", "A coil that heats up together with its magnets: R (1 + 0.0039 ϑ), "
        "Km (1 − 0.0011 ϑ), C dϑ/dt = R i² − ϑ/3 K/W. "
        "Source: temperature coefficient of the remanence of NdFeB magnets, −0.11 %/K; IEC 60404-8-1.",
        {"heating_rate": ("K/J", 0.02, 1.0)}, states={"warmth": "K"},
        coil_resistance_factor=lambda e, s, z: 1.0 + 0.0039 * z.warmth,
        force_constant_factor=lambda e, s, z: 1.0 - 0.0011 * z.warmth,
        rates=lambda e, s, z:
        {"warmth": e.heating_rate * (s.resistance * jnp.square(s.current) - z.warmth / 3.0)}),
    law(library.SupplySag, "SquaredSag",
        "A supply whose voltage drops with the square of the current: R i²/10 A, at most the whole voltage. "
        "Source: a supply in current limit folds back progressively; the form is chosen.",
        {"sag_size": ("ohm", 0.05, 2.0)}, supply_voltage_change=lambda e, s, z:
        -jnp.minimum(e.sag_size * jnp.square(s.current) / 10.0, s.supply_voltage)),
    law(library.ReluctanceForce, "ParabolicInductance",
        "An inductance that is largest at mid-stroke: L (1 − λ (x/x_m)²), with its force and voltage. "
        "Source: Klippel, J. Audio Eng. Soc. 54 (2006) 907: inductance of a voice coil over displacement.",
        {"inductance_curvature": ("-", -0.5, 0.5)}, coil_inductance_factor=lambda e, s, z:
        1.0 - e.inductance_curvature * jnp.square(s.piston_position / REFERENCE_TRAVEL),
        coil_voltage_change=lambda e, s, z: -s.current * s.piston_velocity * _inductance_gradient(e, s),
        mover_force=lambda e, s, z: 0.5 * jnp.square(s.current) * _inductance_gradient(e, s)),
    law(library.PistonLeakage, "ConcentricLeakage", "Laminar leakage past a concentric plunger, without the flow that "
        "it drags along: π d δ³ Δp/(12 μ L). Source: Blackburn, Reethof, Shearer, Fluid Power Control (1960).",
        {"leakage_gap": ("m", 12e-6, 35e-6)}, chamber_leakage=_concentric_leakage),
    law(library.PistonLeakage, "OrificeLeakage",
        "Leakage through a short scratch in the bore, an orifice: Q = A √(2 Δp/ρ), linear below 1 kPa. "
        "Source: Merritt, Hydraulic Control Systems (1967), sharp-edged orifices.",
        {"scratch_area": ("m^2", 1e-9, 1e-7)},
        chamber_leakage=lambda e, s, z: e.scratch_area
        * signed_root(2.0 * (s.chamber_pressure - s.accumulator_pressure) / s.oil_density, 2e3 / 860.0)),
    law(library.EntrainedAir, "PolytropicAir",
        "Air that does not have the time to take the temperature of the oil: V ∝ p^(−1/1.4). "
        "Source: Gholizadeh, Burton, Schoenau, Int. J. Fluid Power 13 (2012) 7.", {"free_air": ("-", 0.002, 0.015)},
        oil_gas=lambda e, s, z: e.free_air * s.atmospheric_pressure, oil_compressibility=lambda e, s, z:
        e.free_air / (1.4 * s.pressure) * (s.atmospheric_pressure / s.pressure) ** (1.0 / 1.4)),
    law(library.HoseCompliance, "StiffeningHose", "A hose that stiffens with pressure: C/(1 + (p/0.6 MPa)²). "
        "Source: measured hoses, whose expansion per pressure falls once the braid carries the load.",
        {"hose_size": ("m^3/Pa", 1e-14, 1e-11)},
        outlet_capacity=lambda e, s, z: e.hose_size / (1.0 + jnp.square(s.outlet_pressure / 0.6e6))),
    law(library.ValveFlowForce, "FadingFlowForce",
        "A flow force that fades as the valve opens: −K A Δp exp(−y/0.4 mm). "
        "Source: Johnston, Edge, Vaughan, Proc. IMechE I 205 (1991) 263: poppet forces that depend on opening; form "
        "chosen.", {"flow_force_size": ("-", 0.1, 1.5)}, check_valve_force=lambda e, s, z: -e.flow_force_size
        * s.valve_area * s.pressure_drop * jnp.exp(-jnp.maximum(s.lift, 0.0) / 0.4e-3)),
    law(library.ValveFlowForce, "TurningJetForce", "A flow force whose jet turns towards the plane of the seat: "
        "−K A Δp cos(0.8 rad + 0.7 rad y/1 mm), down to 0. "
        "Source: von Mises' jet angle, which changes with opening; Merritt (1967).",
        {"flow_force_size": ("-", 0.15, 2.0)}, check_valve_force=_turning_jet),
    law(library.ValveAdhesion, "ExponentialAdhesion",
        "Adhesion of the ball that falls exponentially with lift: −F exp(−y/15 µm) while it opens. "
        "Source: chosen; measured adhesion of reed and plate valves falls within some tens of micrometres.",
        {"adhesion_size": ("N", 0.1, 5.0)}, check_valve_force=_adhesion),
    law(library.SuctionSeatLeakage, "SuctionScratch", _SCRATCH_TEXT.format("suction"),
        {"scratch_size": ("m^2", 1e-9, 3e-7)}, suction_valve_area=_scratch),
    law(library.DeliverySeatLeakage, "DeliveryScratch", _SCRATCH_TEXT.format("delivery"),
        {"scratch_size": ("m^2", 1e-9, 3e-7)}, delivery_valve_area=_scratch),
    law(library.OutletLineInertance, "TurbulentLineInertance",
        "A line with inertia and turbulent loss: I dQ/dt = Δp − k |Q| Q. "
        "Source: rigid-column theory with Darcy-Weisbach friction; Wylie, Streeter, Fluid Transients (1978).",
        {"line_mass": ("kg/m^4", 1e6, 5e7), "line_loss": ("kg/m^7", 5e11, 1e13)}, states={"line_flow": "m^3/s"},
        outlet_line_resistance=lambda e, s, z: e.line_loss * jnp.abs(z.line_flow),
        outlet_line_flow=lambda e, s, z: z.line_flow,
        rates=lambda e, s, z: {"line_flow": outlet_line_drop(s, z.line_flow) / e.line_mass}),
    law(library.OutletLineResistance, "TurbulentLine",
        "A line whose resistance grows with the flow, as the root of the pressure: R √((p − p_s)/0.5 MPa). "
        "Source: Darcy-Weisbach friction.", {"line_size": ("Pa*s/m^3", 1e8, 1e10)},
        outlet_line_resistance=lambda e, s, z:
        e.line_size * jnp.sqrt(jnp.maximum(s.outlet_pressure - s.accumulator_pressure, 0.0) / 0.5e6 + 1e-4)),
    law(library.SuctionLineResistance, "TurbulentSuctionLine", "A suction line whose resistance grows with the flow: "
        "R (0.2 + |v|/0.2 m/s), v the speed of the plungers. Source: Darcy-Weisbach friction.",
        {"suction_size": ("Pa*s/m^3", 1e7, 3e9)},
        suction_line_resistance=lambda e, s, z: e.suction_size * (0.2 + jnp.abs(s.sliding_velocity) / 0.2)),
    law(library.SuctionLineInertance, "TurbulentSuctionInertance",
        "A suction line with inertia and turbulent loss: I dQ/dt = p_s − p_m − (R + k |Q|) Q. "
        "Source: rigid-column theory with Darcy-Weisbach friction; Wylie, Streeter, Fluid Transients (1978).",
        {"suction_mass": ("kg/m^4", 1e6, 5e7), "suction_loss": ("kg/m^7", 2e11, 4e12)}, states={"line_flow": "m^3/s"},
        suction_line_resistance=lambda e, s, z: 5e6 + e.suction_loss * jnp.abs(z.line_flow),
        suction_line_flow=lambda e, s, z: z.line_flow,
        rates=lambda e, s, z: {"line_flow": suction_line_drop(s, z.line_flow) / e.suction_mass}),
    law(library.OilTemperature, "SlotteViscosity", "Viscosity by a power of the temperature in °C: μ (ϑ/40 °C)^(−m). "
        "Source: Slotte's formula, Wied. Ann. Phys. 14 (1881) 13.", {"slotte_exponent": ("-", 0.8, 2.2)},
        oil_viscosity_factor=lambda e, s, z:
        jnp.maximum((s.oil_temperature - 273.15) / 40.0, 0.05) ** (-e.slotte_exponent)),
    law(library.PressureViscosity, "SquarePressureViscosity", "Viscosity that rises with the square of the pressure in "
        "the gap: 1 + a p̄²/0.5 MPa, p̄ = (p + p_s)/2. "
        "Source: second-order term of pressure-viscosity fits; chosen alone, as a contrast to Barus' law.",
        {"viscosity_rise": ("1/Pa", 1e-8, 1e-7)}, gap_viscosity_factor=_pressure_viscosity),
    law(library.KarnoppFriction, "SmoothCylinderFriction", "Dry friction of the cylinder without standstill: "
        "F tanh(v/1 mm/s). "
        "Source: Andersson, Söderberg, Björklund, Tribology Int. 40 (2007) 580, smooth Coulomb friction.",
        {"cylinder_level": ("N", 3.0, 80.0)}, cylinder_friction_force=lambda e, s, z:
        (e.cylinder_level + s.cylinder_friction_level) * jnp.tanh(s.cylinder_velocity / 1e-3)),
    law(library.CylinderSealFriction, "RootCylinderSeal",
        "Both dry friction levels of the cylinder grow with the root of the head pressure: μ A √(p 0.5 MPa). Source: "
        "contact width of O-rings that grows less than the pressure; Müller, Nau, Fluid Sealing Technology (1998).",
        {"ring_size": ("-", 0.003, 0.1)}, cylinder_friction_level=lambda e, s, z: e.ring_size * s.cylinder_area
        * jnp.sqrt(0.5e6 * (jnp.maximum(s.head_pressure - s.atmospheric_pressure, 0.0) + 1.0))),
    law(library.LoadSpring, "HardeningLoadSpring", "A load spring that hardens: −k x (1 + (x/5 mm)²). "
        "Source: Duffing, Erzwungene Schwingungen bei veränderlicher Eigenfrequenz (1918).",
        {"load_stiffness": ("N/m", 50.0, 3e5)}, cylinder_force=lambda e, s, z:
        -e.load_stiffness * s.cylinder_position * (1.0 + jnp.square(s.cylinder_position / 5e-3))),
    law(library.CylinderLeakageRise, "QuadraticLeakageRise",
        "Leakage of the cylinder that grows with the square of the position: k x²/5 mm. "
        "Source: a conical bore, first term; chosen.", {"bore_slope": ("m^2/(s*Pa)", 5e-13, 1e-10)},
        cylinder_leakage_change=lambda e, s, z: e.bore_slope * jnp.square(s.cylinder_position) / 5e-3),
)  # fmt: skip
UNLISTED = (
    law(None, "CrossLeakage",
        "Leakage between the two chambers, past the seal of a common plunger: Q = k (p_A − p_B). "
        "Source: laminar gap flow.", {"cross_conductance": ("m^3/(s*Pa)", 5e-15, 2e-12)},
        confused_with=("piston_leakage", "suction_seat_leakage", "delivery_seat_leakage"),
        chamber_leakage=lambda e, s, z:
        e.cross_conductance * (2.0 * s.chamber_pressure - s.chamber_pressure_a - s.chamber_pressure_b)),
    law(None, "ForceRipple", "A force constant that is periodic in the position: Km (1 + ε sin(2π x/τ + φ)). Source: "
        "harmonics of the field of a magnet array; Gieras, Piech, Tomczuk, Linear Synchronous Motors (2011).",
        {"ripple_share": ("-", 0.005, 0.15), "ripple_length": ("m", 2e-3, 4e-3), "ripple_shift": ANGLE},
        confused_with=("force_constant_droop", "cogging_force"), force_constant_factor=lambda e, s, z: 1.0
        + e.ripple_share * jnp.sin(2.0 * jnp.pi * s.piston_position / e.ripple_length + e.ripple_shift)),
    law(None, "BallFriction", "Dry friction of the balls in their guides: −F tanh(ẏ/10 mm/s). Source: Coulomb.",
        {"ball_friction": ("N", 0.005, 0.5)}, confused_with=("valve_adhesion", "valve_flow_force"),
        check_valve_force=lambda e, s, z: -e.ball_friction * jnp.tanh(s.lift_velocity / 0.01)),
    law(None, "EddyPathCoil", "Eddy currents in the iron beside the coil, a resistance that is shorted at low "
        "frequency: −R_e (i − i_s), di_s/dt = (i − i_s)/τ, τ = 0.8 ms. Source: semi-inductance of voice coils; "
        "Vanderkooy, J. Audio Eng. Soc. 37 (1989) 119, with one time constant.",
        {"iron_resistance": ("ohm", 0.02, 3.0)}, states={"slow_current": "A"},
        confused_with=("amplifier_lag", "inverter_dead_time", "reluctance_force"),
        coil_voltage_change=lambda e, s, z: -e.iron_resistance * (s.current - z.slow_current),
        rates=lambda e, s, z: {"slow_current": (s.current - z.slow_current) / 0.8e-3}),
    law(None, "TunedMass", "A mass on a spring that the motor force excites, as of a housing: "
        "F = 0.12 kg s (ω² x + 0.2 ω v), ω = 2π f, ẍ = −F_e/0.2 kg − ω² x − 0.2 ω v. "
        "Source: Den Hartog, Mechanical Vibrations (1934).",
        {"mass_share": ("-", 0.01, 0.5), "tuned_frequency": ("Hz", 50.0, 150.0)},
        states={"displacement": "m", "speed": "m/s"},
        confused_with=("coupling_compliance", "backlash", "parasitic_spring"),
        mover_force=lambda e, s, z: 0.12 * e.mass_share * _mass_force(e, s, z),
        rates=lambda e, s, z: {"displacement": z.speed, "speed": -s.motor_force / 0.2 - _mass_force(e, s, z)}),
)  # fmt: skip
