"""The equations of motion of the mover: coil carrier and plungers as one body, or as two that a coupling joins."""

import jax.numpy as jnp

from edhas_jax.machine.interface import slots
from edhas_jax.machine.interface.signals import Signals
from edhas_jax.machine.interface.slots import enter


def slide(y: dict, s: Signals) -> None:
    """Where and how fast the plungers slide; coil carrier and plungers are one body unless a coupling gives way."""
    if "coupling_deflection" not in y:
        s.set(sliding_position=s.piston_position, sliding_velocity=s.piston_velocity)
        return
    s.set(coupling_deflection=y["coupling_deflection"], coupling_velocity=y["coupling_velocity"])
    s.set(
        sliding_position=s.piston_position - s.coupling_deflection,
        sliding_velocity=s.piston_velocity - s.coupling_velocity,
    )


def move(m, y: dict, s: Signals, mass, damping, pressure_force) -> dict:
    """One body: M dv/dt = F_e − c v − (p_A − p_B) S_p − F_f − F_stop."""
    v = s.piston_velocity
    s.store("mover", 0.5 * mass * jnp.square(v))
    s.bond("mover damping", "mechanical", damping * v, v)
    force = _motor_side(s, s.motor_force - damping * v) - _plunger_side(m, s, pressure_force)
    return _rates(m, y, s, force / mass)


def move_pump(m, y: dict, s: Signals) -> dict:
    """The mover of a pump: one body, or coil carrier and plungers with a coupling between them.

    M dv/dt = F_e − c v − F_k,   m_add dv_p/dt = F_k − c_p v_p − (p_A − p_B) S_p − F_f − F_stop,   dΔ/dt = v − v_p

    The controller sees the coil carrier; friction, stops and chambers the plungers, which lag behind it by Δ.
    """
    pressure_force = (s.chamber_pressure_a - s.chamber_pressure_b) * s.piston_area
    mover, plungers = m.mover, m.pump
    coupling = enter(slots.COUPLING_FORCE, None, s)
    if coupling is None:
        mass, damping = mover.mover_mass + plungers.plunger_mass, mover.mover_damping + plungers.pump_damping
        return move(m, y, s, mass, damping, pressure_force)
    v, v_p = s.piston_velocity, s.sliding_velocity
    s.store("mover", 0.5 * mover.mover_mass * jnp.square(v))
    s.store("plungers", 0.5 * plungers.plunger_mass * jnp.square(v_p))
    s.bond("mover damping", "mechanical", mover.mover_damping * v, v)
    s.bond("plunger damping", "mechanical", plungers.pump_damping * v_p, v_p)
    s.bond_entered("coupling_force", "mechanical", s.coupling_velocity)
    carrier = _motor_side(s, s.motor_force - mover.mover_damping * v) - coupling
    plunger = coupling - plungers.pump_damping * v_p - _plunger_side(m, s, pressure_force)
    carrier, plunger = carrier / mover.mover_mass, plunger / plungers.plunger_mass
    own = {"coupling_deflection": s.coupling_velocity, "coupling_velocity": carrier - plunger}
    return _rates(m, y, s, carrier) | own


def _motor_side(s: Signals, force):
    """`force` with what acts on the coil carrier."""
    force = enter(slots.MOVER_FORCE, force, s)
    s.bond_entered("mover_force", "mechanical", s.piston_velocity, -1.0)
    if s.entered("motor_force_factor"):
        s.bond("back-EMF", "mechanical", s.back_emf, s.current)
        s.bond("motor force", "mechanical", -s.motor_force, s.piston_velocity)
    return force


def _plunger_side(m, s: Signals, pressure_force):
    """The force against the motion of the plungers, or of a mover without: end stops, pressure, friction."""
    x, v = s.sliding_position, s.sliding_velocity
    half = 0.5 * m.stops.pump_stroke
    stop = m.stops.force(x, v, -half, half)
    friction = enter(slots.MOVER_FRICTION, None, s)
    s.set(stop_force=stop, friction_force=jnp.zeros_like(v) if friction is None else friction)
    s.bond("end stops", "mechanical", stop, v)
    s.bond_entered("mover_friction", "mechanical", v)
    force = stop + pressure_force
    return force if friction is None else force + friction


def _rates(m, y: dict, s: Signals, acceleration) -> dict:
    """The rates of the mover, and of amplifier and controller, which needed its forces."""
    rates = {"piston_position": s.piston_velocity, "piston_velocity": acceleration}
    return rates | m.amplifier.rates(s) | m.sampling.rates(m.controller, y, s)
