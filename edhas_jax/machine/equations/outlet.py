"""Outlet section: load orifice of the bench, outlet node with relief valve, and the return to the accumulator."""

from edhas_jax.machine.equations.orifice_flow import orifice_flow
from edhas_jax.machine.interface import slots
from edhas_jax.machine.interface.signals import Signals
from edhas_jax.machine.interface.slots import apply_slot


def set_load_flow(m, s: Signals) -> None:
    """Set the flow through the load orifice, from outlet node to accumulator, in series with a line if there is one."""
    drop, area = s.outlet_pressure - s.accumulator_pressure, m.load.load_orifice_area
    resistance = apply_slot(slots.OUTLET_LINE_RESISTANCE, None, s)
    flow = apply_slot(slots.OUTLET_LINE_FLOW, None, s)
    orifice_drop = drop
    if flow is not None:
        orifice_drop = m.orifice.pressure_drop(area, flow, m.oil.oil_density)
    elif resistance is not None:
        orifice_drop = m.orifice.pressure_drop_in_series(area, drop, resistance, m.oil.oil_density)
        flow = m.orifice.flow(area, orifice_drop, m.oil.oil_density)
    else:
        flow = orifice_flow(m, s, "load orifice", area, ("outlet_pressure", "accumulator_pressure"))
    s.define(outlet_flow=flow, return_flow=flow, load_drop=orifice_drop)
    s.record_power("load orifice", "delivered", orifice_drop, flow)
    if resistance is not None:
        s.define(outlet_line_resistance=resistance)
        s.record_power("outlet line", "fluid", drop - orifice_drop, flow)


def outlet_rates(m, s: Signals) -> dict:
    """The rates of outlet pressure and accumulator gas volume.

    V_d/β dp_d/dt = Q_dA + Q_dB − Q_out − Q_rv,   dV_gas/dt = −(Q_return + Q_LA + Q_LB + Q_rv − Q_sA − Q_sB)
    """
    p = s.outlet_pressure
    relief = m.outlet.relief_flow(p)
    into_accumulator = s.return_flow + relief - s.flow_from_accumulator
    if s.effect_contributions("chamber_leakage"):
        into_accumulator = into_accumulator + s.leakage_a + s.leakage_b
    s.define(relief_flow=relief, accumulator_flow=into_accumulator)
    s.record_power("relief valve", "fluid", p - s.accumulator_pressure, relief)
    s.record_power("accumulator gas", "stored", s.accumulator_pressure, into_accumulator)
    capacity = apply_slot(slots.OUTLET_CAPACITY, None, s)
    flow = s.delivery_flow_a + s.delivery_flow_b - s.outlet_flow - relief
    rates = m.oil.rate("outlet_pressure", flow, m.outlet.outlet_volume, s, capacity)
    return rates | {"gas_volume_change": -into_accumulator}
