"""The equations section by section: what the rigs have in common, each section written once.

A section takes the machine `m`, the state `y` and the signals `s` known so far; it adds the signals it determines and
returns the rates of its states.
"""

import dataclasses
from collections.abc import Callable

import jax.numpy as jnp

from edhas_jax.compiler.one_sided_minmax import one_sided_max, one_sided_min
from edhas_jax.core.structs import parameters
from edhas_jax.machine.components.coil_and_amplifier import CurrentAmplifier, VoltageAmplifier
from edhas_jax.machine.components.controllers import limited
from edhas_jax.machine.effects.base import initial_states, own_states
from edhas_jax.machine.equations_of_motion import move_pump, slide
from edhas_jax.machine.interface import slots
from edhas_jax.machine.interface.signals import Passage, Signals
from edhas_jax.machine.interface.slots import enter

MANIFOLD_VOLUME = 10e-6  # m³ of oil between a suction line and the suction valves


def first_signals(m, y: dict, t, h, law: Callable | None = None) -> Signals:
    """Time, and the parameters of the machine's parts; those of an effect stay its own."""
    parts = [getattr(m, f.name) for f in dataclasses.fields(m) if f.name != "effects"]
    known = {p.name: getattr(part, p.name) for part in parts for p in parameters(type(part))}
    return Signals(known | {"time": t, "time_step": h}, own_states(m.effects, y), law=law)


def passage(m, s: Signals, name: str, area, ends: tuple[str, str]):
    """The flow [m³/s] through an orifice between two nodes; a step replaces its slopes, see `passage_slopes`."""
    drop = getattr(s, ends[0]) - getattr(s, ends[1])
    s.notes.passages[name] = Passage(drop, area, ends)
    flow = m.orifice.flow(area, drop, m.oil.oil_density)
    return flow if s.law is None else s.law(name, flow, area, drop)


def passage_slopes(m, passages: dict[str, Passage], pressure_rates: dict, h) -> dict:
    """{name: (flow per area, flow per pressure drop)}: the slopes by which a step of `h` linearises each orifice.

    They are the tangents, except where these would mislead. The tangent of the square-root law is half its chord: where
    a pressure drop is about to change by more than its own size in one step, a linear prediction lands on the other
    side, and can do so for ever, with plausible looks. There the slope is led over to twice the chord, which ends at
    the equilibrium of the drop. In all steps that resolve the change nothing is altered, so the order stays two.
    """
    slopes = {}
    for name, (drop, area, ends) in passages.items():
        chord, tangent, inverse = m.orifice.conductance(drop, m.oil.oil_density)
        rates = [pressure_rates[end] for end in ends if end in pressure_rates]
        change = jnp.abs(rates[0] - rates[1] if len(rates) == 2 else rates[0])
        overshoot = one_sided_min(one_sided_max(h * change * inverse - 1.0, 0.0), 1.0)
        slopes[name] = chord * drop, area * (tangent + overshoot * (2.0 * chord - tangent))
    return slopes


def set_point(reference, t, share) -> dict:
    """Set point of the piston and its rate, both times `share`."""
    value, rate = reference.at(t)
    return {"reference": share * value, "reference_velocity": share * rate}


def start_drive(m) -> dict:
    """The states of the actuator at rest, effects included."""
    y = m.amplifier.initial() | m.sampling.initial(m.controller) | initial_states(m.effects)
    return y | {"piston_position": 0.0, "piston_velocity": 0.0}


def start_pump(m) -> dict:
    """The states of the pump at rest, every pressure at that of the accumulator."""
    y = dict.fromkeys(
        ("chamber_pressure_a", "chamber_pressure_b", "outlet_pressure"), m.accumulator.accumulator_pressure
    )
    if slots.taken(slots.SUCTION_LINE_RESISTANCE, m.effects):
        y["suction_pressure"] = m.accumulator.accumulator_pressure
    if slots.taken(slots.COUPLING_FORCE, m.effects):
        y |= {"coupling_deflection": 0.0, "coupling_velocity": 0.0}
    y["gas_volume_change"] = 0.0
    for kind in ("suction", "delivery"):
        for side in ("a", "b"):
            y |= {f"{kind}_lift_{side}": 0.0, f"{kind}_lift_velocity_{side}": 0.0}
    return y


def drive(m, y: dict, s: Signals) -> None:
    """Controller, amplifier, coil: from the set point to the motor force."""
    s.set(piston_position=y["piston_position"], piston_velocity=y["piston_velocity"])
    if isinstance(m.amplifier, VoltageAmplifier):
        s.set(current=m.amplifier.current(y, s))
    s.set(unlimited_voltage=m.sampling.command(m.controller, y, s))
    s.set(voltage=limited(s.unlimited_voltage, s))
    if isinstance(m.amplifier, CurrentAmplifier):
        s.set(current=m.amplifier.current(y, s))
    m.coil.observe(s)
    s.set(coil_voltage=m.amplifier.coil_voltage(s))
    if isinstance(m.amplifier, VoltageAmplifier):
        s.bond("electrical input", "input", s.voltage, s.current)
        if s.entered("coil_inductance_factor"):  # ½ L i² is then not what flowed in
            s.bond("coil", "stored", s.coil_voltage - s.resistance * s.current - s.back_emf, s.current)
        else:
            s.store("coil", 0.5 * s.inductance * jnp.square(s.current))
    else:
        s.bond("electrical input", "input", s.coil_voltage, s.current)
    s.bond("copper", "copper", s.resistance * s.current, s.current)
    s.limit("piston_position", -0.6 * m.stops.pump_stroke, 0.6 * m.stops.pump_stroke)
    s.bond_entered("coil_voltage_change", "copper", s.current, -1.0)


def pump(m, y: dict, s: Signals) -> dict:
    """Accumulator pressure, suction line, chambers, leakage and check valves; the mover with its plungers."""
    s.set(
        piston_area=m.pump.area(),
        viscosity=m.oil.viscosity(s),
        accumulator_pressure=m.accumulator.pressure(y["gas_volume_change"]),
        gas_volume=m.accumulator.accumulator_gas_volume + y["gas_volume_change"],
        outlet_pressure=y["outlet_pressure"],
        chamber_pressure_a=y["chamber_pressure_a"],
        chamber_pressure_b=y["chamber_pressure_b"],
    )
    s.limit("gas_volume", 0.02 * m.accumulator.accumulator_gas_volume, 50.0 * m.accumulator.accumulator_gas_volume)
    slide(y, s)
    has_line = "suction_pressure" in y
    if has_line:
        _suction_line(y, s)
    rates = {}
    for side, sign in (("a", 1.0), ("b", -1.0)):
        rates |= _chamber(m, y, s, side, sign, "suction_pressure" if has_line else "accumulator_pressure")
    drawn = s.suction_flow_a + s.suction_flow_b
    if has_line:
        rates |= m.oil.rate("suction_pressure", s.suction_line_flow - drawn, MANIFOLD_VOLUME, s)
    s.set(drawn_flow=s.suction_line_flow if has_line else drawn)
    return rates | move_pump(m, y, s)


def _suction_line(y: dict, s: Signals) -> None:
    """The line from accumulator to manifold: Q_l = (p_s − p_m)/R, or a state of the effect that gives it inertia."""
    s.set(
        suction_pressure=y["suction_pressure"],
        suction_line_resistance=enter(slots.SUCTION_LINE_RESISTANCE, None, s),
    )
    drop = s.accumulator_pressure - s.suction_pressure
    flow = enter(slots.SUCTION_LINE_FLOW, None, s)
    s.set(suction_line_flow=drop / s.suction_line_resistance if flow is None else flow)
    s.bond("suction line", "fluid", drop, s.suction_line_flow)


def _chamber(m, y: dict, s: Signals, side: str, sign: float, upstream: str) -> dict:
    """One chamber with its two valves: V/β dp/dt = S_p v − Q_d + Q_s − Q_L."""
    p = getattr(s, f"chamber_pressure_{side}")
    v = s.sliding_velocity if sign > 0 else -s.sliding_velocity
    x = s.sliding_position if sign > 0 else -s.sliding_position
    volume = m.pump.volume(0.5 * m.stops.pump_stroke - x)
    rates = {}
    flows = {}
    chamber = f"chamber_pressure_{side}"
    for kind, ends, slot in (
        ("suction", (upstream, chamber), slots.SUCTION_VALVE_AREA),
        ("delivery", (chamber, "outlet_pressure"), slots.DELIVERY_VALVE_AREA),
    ):
        drop = getattr(s, ends[0]) - getattr(s, ends[1])
        lift, speed = y[f"{kind}_lift_{side}"], y[f"{kind}_lift_velocity_{side}"]
        ball = s.at(lift=lift, lift_velocity=speed, pressure_drop=drop, valve_area=m.valve.area(lift))
        flows[kind] = passage(m, s, f"{kind} valve {side}", enter(slot, ball.valve_area, ball), ends)
        rates[f"{kind}_lift_{side}"] = speed
        rates[f"{kind}_lift_velocity_{side}"] = m.valve.acceleration(ball)
        s.set(**{f"{kind}_lift_{side}": lift, f"{kind}_flow_{side}": flows[kind]})
        give = 0.5 * m.valve.valve_seat_diameter
        s.limit(f"{kind}_lift_{side}", -give, m.valve.valve_max_lift + give)
        s.bond(f"{kind} valve {side}", "fluid", drop, flows[kind])
    flow = s.piston_area * v + flows["suction"] - flows["delivery"]
    gap = enter(slots.GAP_VISCOSITY, s.viscosity, s.at(chamber_pressure=p))
    local = s.at(chamber_pressure=p, plunger_velocity=v, viscosity=gap)
    leakage = enter(slots.CHAMBER_LEAKAGE, None, local)
    if leakage is not None:
        flow = flow - leakage
        s.bond(f"leakage {side}", "fluid", p - s.accumulator_pressure, leakage)
    s.set(**{f"leakage_{side}": jnp.zeros_like(p) if leakage is None else leakage})
    return rates | m.oil.rate(chamber, flow, volume, s)


def load(m, s: Signals) -> None:
    """The load of the bench: an orifice from outlet node to accumulator, in series with a line where there is one."""
    drop, area = s.outlet_pressure - s.accumulator_pressure, m.load.load_orifice_area
    resistance = enter(slots.OUTLET_LINE_RESISTANCE, None, s)
    flow = enter(slots.OUTLET_LINE_FLOW, None, s)
    across = drop
    if flow is not None:
        across = m.orifice.drop(area, flow, m.oil.oil_density)
    elif resistance is not None:
        across = m.orifice.drop_in_series(area, drop, resistance, m.oil.oil_density)
        flow = m.orifice.flow(area, across, m.oil.oil_density)
    else:
        flow = passage(m, s, "load orifice", area, ("outlet_pressure", "accumulator_pressure"))
    s.set(outlet_flow=flow, return_flow=flow, load_drop=across)
    s.bond("load orifice", "delivered", across, flow)
    if resistance is not None:
        s.set(outlet_line_resistance=resistance)
        s.bond("outlet line", "fluid", drop - across, flow)


def outlet(m, s: Signals) -> dict:
    """Outlet node and accumulator: what the load returns, plunger leakage and relief flow come back."""
    p = s.outlet_pressure
    relief = m.outlet.relief_flow(p)
    back = s.return_flow + relief - s.drawn_flow
    if s.entered("chamber_leakage"):
        back = back + s.leakage_a + s.leakage_b
    s.set(relief_flow=relief, accumulator_flow=back)
    s.bond("relief valve", "fluid", p - s.accumulator_pressure, relief)
    s.bond("accumulator gas", "stored", s.accumulator_pressure, back)
    capacity = enter(slots.OUTLET_CAPACITY, None, s)
    flow = s.delivery_flow_a + s.delivery_flow_b - s.outlet_flow - relief
    return m.oil.rate("outlet_pressure", flow, m.outlet.outlet_volume, s, capacity) | {"gas_volume_change": -back}


def cylinder(m, y: dict, s: Signals, known: dict) -> dict:
    """Reversing valve, both sides of the cylinder and its load; sets outlet and return flow."""
    c = m.cylinder
    x, v = s.cylinder_position, s.cylinder_velocity
    head, rod = y["head_pressure"], y["rod_pressure"]
    s.set(spool=y["spool"], head_pressure=head, rod_pressure=rod, caught_velocity=known["cylinder_velocity"])
    forward, backward = m.reversing_valve.areas(s.spool)
    edges = {
        "P to head": (forward, ("outlet_pressure", "head_pressure")),
        "rod to T": (forward, ("rod_pressure", "accumulator_pressure")),
        "P to rod": (backward, ("outlet_pressure", "rod_pressure")),
        "head to T": (backward, ("head_pressure", "accumulator_pressure")),
    }
    q = {edge: passage(m, s, f"reversing valve {edge}", area, ends) for edge, (area, ends) in edges.items()}
    for edge, (_, ends) in edges.items():
        s.bond(f"reversing valve {edge}", "fluid", getattr(s, ends[0]) - getattr(s, ends[1]), q[edge])
    s.set(outlet_flow=q["P to head"] + q["P to rod"], return_flow=q["rod to T"] + q["head to T"])

    area = c.area()
    s.set(cylinder_area=area)
    conductance = enter(slots.CYLINDER_LEAKAGE, c.cylinder_leakage, s)
    leakage = conductance * (head - rod)
    s.bond("cylinder leakage", "fluid", head - rod, leakage)
    volumes = c.cylinder_dead_volume + area * x, c.cylinder_dead_volume + area * (c.cylinder_stroke - x)

    stop = m.stops.force(x, v, 0.0, c.cylinder_stroke)
    free = (head - rod) * area - c.cylinder_damping * v - c.load_force - stop
    free = enter(slots.CYLINDER_FORCE, free, s)
    level = enter(slots.CYLINDER_FRICTION_LEVEL, 0.0, s)
    local = s.at(cylinder_free_force=free, cylinder_friction_level=level)
    friction = enter(slots.CYLINDER_FRICTION, None, local)
    s.set(cylinder_friction=jnp.zeros_like(v) if friction is None else friction)
    s.limit("cylinder_position", -0.2 * c.cylinder_stroke, 1.2 * c.cylinder_stroke)
    s.store("cylinder load", 0.5 * c.load_mass * jnp.square(v))
    s.bond("cylinder damping", "mechanical", c.cylinder_damping * v, v)
    s.bond("cylinder stops", "mechanical", stop, v)
    s.bond("load", "delivered", c.load_force, v)
    s.bond_entered("cylinder_friction_force", "mechanical", v)
    s.bond_entered("cylinder_force", "mechanical", v, -1.0)
    force = free if friction is None else free - friction
    into_head = q["P to head"] - q["head to T"] - area * v - leakage
    into_rod = q["P to rod"] - q["rod to T"] + area * v + leakage
    rates = m.oil.rate("head_pressure", into_head, volumes[0], s) | m.oil.rate("rod_pressure", into_rod, volumes[1], s)
    return rates | {"cylinder_position": v, "cylinder_velocity": force / c.load_mass}
