"""Pump section: accumulator pressure, suction line, chambers with leakage, and check valves."""

import jax.numpy as jnp

from edhas_jax.machine.equations.motion import pump_mover_rates, set_plunger_motion
from edhas_jax.machine.equations.orifice_flow import orifice_flow
from edhas_jax.machine.interface import slots
from edhas_jax.machine.interface.signals import Signals
from edhas_jax.machine.interface.slots import apply_slot

MANIFOLD_VOLUME = 10e-6  # m³ of oil between a suction line and the suction valves


def pump_initial_state(m) -> dict:
    """The states of the pump at rest, every pressure at that of the accumulator."""
    y = dict.fromkeys(
        ("chamber_pressure_a", "chamber_pressure_b", "outlet_pressure"), m.accumulator.accumulator_pressure
    )
    if slots.is_used(slots.SUCTION_LINE_RESISTANCE, m.effects):
        y["suction_pressure"] = m.accumulator.accumulator_pressure
    if slots.is_used(slots.COUPLING_FORCE, m.effects):
        y |= {"coupling_deflection": 0.0, "coupling_velocity": 0.0}
    y["gas_volume_change"] = 0.0
    for kind in ("suction", "delivery"):
        for side in ("a", "b"):
            y |= {f"{kind}_lift_{side}": 0.0, f"{kind}_lift_velocity_{side}": 0.0}
    return y


def pump_rates(m, y: dict, s: Signals) -> dict:
    """The rates of chambers, check valves, suction manifold and mover; sets their signals."""
    gas_volume = m.accumulator.accumulator_gas_volume
    s.define(
        piston_area=m.pump.area(),
        viscosity=m.oil.viscosity(s),
        accumulator_pressure=m.accumulator.pressure(y["gas_volume_change"]),
        gas_volume=gas_volume + y["gas_volume_change"],
        outlet_pressure=y["outlet_pressure"],
        chamber_pressure_a=y["chamber_pressure_a"],
        chamber_pressure_b=y["chamber_pressure_b"],
    )
    s.record_valid_range("gas_volume", 0.02 * gas_volume, 50.0 * gas_volume)
    set_plunger_motion(y, s)
    has_line = "suction_pressure" in y
    if has_line:
        _set_suction_line_flow(y, s)
    rates = {}
    for side, sign in (("a", 1.0), ("b", -1.0)):
        rates |= chamber_rates(m, y, s, side, sign, "suction_pressure" if has_line else "accumulator_pressure")
    suction_flow = s.suction_flow_a + s.suction_flow_b
    if has_line:
        rates |= m.oil.rate("suction_pressure", s.suction_line_flow - suction_flow, MANIFOLD_VOLUME, s)
    s.define(flow_from_accumulator=s.suction_line_flow if has_line else suction_flow)
    return rates | pump_mover_rates(m, y, s)


def _set_suction_line_flow(y: dict, s: Signals) -> None:
    """Flow from accumulator to manifold: Q_l = (p_s − p_m)/R, or the state of an effect that models its inertia."""
    s.define(
        suction_pressure=y["suction_pressure"],
        suction_line_resistance=apply_slot(slots.SUCTION_LINE_RESISTANCE, None, s),
    )
    drop = s.accumulator_pressure - s.suction_pressure
    flow = apply_slot(slots.SUCTION_LINE_FLOW, None, s)
    s.define(suction_line_flow=drop / s.suction_line_resistance if flow is None else flow)
    s.record_power("suction line", "fluid", drop, s.suction_line_flow)


def chamber_rates(m, y: dict, s: Signals, side: str, sign: float, upstream: str) -> dict:
    """The rates of one pump chamber with its suction and its delivery valve, Eq. (5).

    V/β(p) dp/dt = S_p v − Q_d + Q_s − Q_L,   V = V_dead + S_p (stroke/2 − x)

    For chamber B, x and v have the opposite sign.

    Args:
        m: the machine.
        y: state by name, SI.
        s: signals; those of the chamber and its valves are added.
        side: "a" or "b".
        sign: 1 for chamber A, -1 for chamber B.
        upstream: signal of the pressure before the suction valve.

    Returns:
        The rates of chamber pressure (strain pressure, see `Oil`), lift and lift velocity of both valves.

    Source: Actuators 2022, 11(10), 281, Eq. (5).
    """
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
        ball = s.with_local(lift=lift, lift_velocity=speed, pressure_drop=drop, valve_area=m.valve.area(lift))
        flows[kind] = orifice_flow(m, s, f"{kind} valve {side}", apply_slot(slot, ball.valve_area, ball), ends)
        rates[f"{kind}_lift_{side}"] = speed
        rates[f"{kind}_lift_velocity_{side}"] = m.valve.acceleration(ball)
        s.define(**{f"{kind}_lift_{side}": lift, f"{kind}_flow_{side}": flows[kind]})
        overtravel = 0.5 * m.valve.valve_seat_diameter
        s.record_valid_range(f"{kind}_lift_{side}", -overtravel, m.valve.valve_max_lift + overtravel)
        s.record_power(f"{kind} valve {side}", "fluid", drop, flows[kind])
    flow = s.piston_area * v + flows["suction"] - flows["delivery"]
    gap_viscosity = apply_slot(slots.GAP_VISCOSITY, s.viscosity, s.with_local(chamber_pressure=p))
    local = s.with_local(chamber_pressure=p, plunger_velocity=v, viscosity=gap_viscosity)
    leakage = apply_slot(slots.CHAMBER_LEAKAGE, None, local)
    if leakage is not None:
        flow = flow - leakage
        s.record_power(f"leakage {side}", "fluid", p - s.accumulator_pressure, leakage)
    s.define(**{f"leakage_{side}": jnp.zeros_like(p) if leakage is None else leakage})
    return rates | m.oil.rate(chamber, flow, volume, s)
