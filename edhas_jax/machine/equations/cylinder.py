"""Cylinder section: reversing valve, both sides of the cylinder, and the load."""

import jax.numpy as jnp

from edhas_jax.machine.equations.orifice_flow import orifice_flow
from edhas_jax.machine.interface import slots
from edhas_jax.machine.interface.signals import Signals
from edhas_jax.machine.interface.slots import apply_slot


def cylinder_rates(m, y: dict, s: Signals) -> dict:
    """The rates of both cylinder pressures and of the load; sets outlet flow and return flow.

    (V_dc + A x_c)/β dp_h/dt = Q_h,in − Q_h,out − A v_c − K_il (p_h − p_r), the rod side likewise with s_c − x_c
    M_a dv_c/dt = (p_h − p_r) A − c_a v_c − F_fa − F_load − F_stop

    Args:
        m: the machine.
        y: state by name, SI.
        s: signals; those of reversing valve and cylinder are added.

    Returns:
        The rates of both pressures (strain pressures, see `Oil`), position and velocity of the cylinder.

    Source: Actuators 2022, 11(10), 281, Eq. (10), whose simplification of the low-pressure side is not made, and
    Eq. (11), with the force of the end stops added.
    """
    c = m.cylinder
    x, v = s.cylinder_position, s.cylinder_velocity
    head, rod = y["head_pressure"], y["rod_pressure"]
    s.define(
        spool=y["spool"], head_pressure=head, rod_pressure=rod,
        cylinder_velocity_at_step_start=s.step_start["cylinder_velocity"],
    )  # fmt: skip
    forward, backward = m.reversing_valve.areas(s.spool)
    edges = {
        "P to head": (forward, ("outlet_pressure", "head_pressure")),
        "rod to T": (forward, ("rod_pressure", "accumulator_pressure")),
        "P to rod": (backward, ("outlet_pressure", "rod_pressure")),
        "head to T": (backward, ("head_pressure", "accumulator_pressure")),
    }
    q = {edge: orifice_flow(m, s, f"reversing valve {edge}", area, ends) for edge, (area, ends) in edges.items()}
    for edge, (_, ends) in edges.items():
        s.record_power(f"reversing valve {edge}", "fluid", getattr(s, ends[0]) - getattr(s, ends[1]), q[edge])
    s.define(outlet_flow=q["P to head"] + q["P to rod"], return_flow=q["rod to T"] + q["head to T"])

    area = c.area()
    s.define(cylinder_area=area)
    conductance = apply_slot(slots.CYLINDER_LEAKAGE, c.cylinder_leakage, s)
    leakage = conductance * (head - rod)
    s.record_power("cylinder leakage", "fluid", head - rod, leakage)
    head_volume = c.cylinder_dead_volume + area * x
    rod_volume = c.cylinder_dead_volume + area * (c.cylinder_stroke - x)

    stop = m.stops.force(x, v, 0.0, c.cylinder_stroke)
    force = (head - rod) * area - c.cylinder_damping * v - c.load_force - stop
    force = apply_slot(slots.CYLINDER_FORCE, force, s)
    level = apply_slot(slots.CYLINDER_FRICTION_LEVEL, 0.0, s)
    local = s.with_local(cylinder_free_force=force, cylinder_friction_level=level)
    friction = apply_slot(slots.CYLINDER_FRICTION, None, local)
    s.define(cylinder_friction=jnp.zeros_like(v) if friction is None else friction)
    s.record_valid_range("cylinder_position", -0.2 * c.cylinder_stroke, 1.2 * c.cylinder_stroke)
    s.record_stored_energy("cylinder load", 0.5 * c.load_mass * jnp.square(v))
    s.record_power("cylinder damping", "mechanical", c.cylinder_damping * v, v)
    s.record_power("cylinder stops", "mechanical", stop, v)
    s.record_power("load", "delivered", c.load_force, v)
    s.record_effect_power("cylinder_friction_force", "mechanical", v)
    s.record_effect_power("cylinder_force", "mechanical", v, -1.0)
    force = force if friction is None else force - friction
    into_head = q["P to head"] - q["head to T"] - area * v - leakage
    into_rod = q["P to rod"] - q["rod to T"] + area * v + leakage
    rates = m.oil.rate("head_pressure", into_head, head_volume, s) | m.oil.rate("rod_pressure", into_rod, rod_volume, s)
    return rates | {"cylinder_position": v, "cylinder_velocity": force / c.load_mass}
