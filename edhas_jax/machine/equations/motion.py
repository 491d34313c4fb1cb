"""Equations of motion of the mover: coil carrier and plungers as one body, or as two joined by a coupling."""

import jax.numpy as jnp

from edhas_jax.machine.interface import slots
from edhas_jax.machine.interface.signals import Signals
from edhas_jax.machine.interface.slots import apply_slot


def set_plunger_motion(y: dict, s: Signals) -> None:
    """Set position and velocity of the plungers: those of the coil carrier, less the coupling's deflection if any."""
    if "coupling_deflection" not in y:
        s.define(sliding_position=s.piston_position, sliding_velocity=s.piston_velocity)
        return
    s.define(coupling_deflection=y["coupling_deflection"], coupling_velocity=y["coupling_velocity"])
    s.define(
        sliding_position=s.piston_position - s.coupling_deflection,
        sliding_velocity=s.piston_velocity - s.coupling_velocity,
    )


def mover_rates(m, y: dict, s: Signals, mass, damping, pressure_force) -> dict:
    """The mover as one body: M dv/dt = F_e − c v − (p_A − p_B) S_p − F_f − F_stop.

    Args:
        m: the machine.
        y: state by name, SI.
        s: signals; stop force and friction force are added.
        mass: M [kg].
        damping: c [N·s/m].
        pressure_force: (p_A − p_B) S_p [N], 0 without a pump.

    Returns:
        The rates of mover, amplifier and controller.

    Source: Actuators 2022, 11(10), 281, Eq. (3), with the force of the end stops added.
    """
    v = s.piston_velocity
    s.record_stored_energy("mover", 0.5 * mass * jnp.square(v))
    s.record_power("mover damping", "mechanical", damping * v, v)
    force = _force_on_coil_carrier(s, s.motor_force - damping * v) - _force_against_plungers(m, s, pressure_force)
    return _actuator_rates(m, y, s, force / mass)


def pump_mover_rates(m, y: dict, s: Signals) -> dict:
    """The mover of a pump: one body, or coil carrier and plungers with the force F_k of a coupling between them.

    M dv/dt = F_e − c v − F_k,   m_add dv_p/dt = F_k − c_p v_p − (p_A − p_B) S_p − F_f − F_stop,   dΔ/dt = v − v_p

    The controller measures the coil carrier; friction, stops and chambers act on the plungers, which lag it by Δ.

    Returns:
        The rates of mover, coupling, amplifier and controller.
    """
    pressure_force = (s.chamber_pressure_a - s.chamber_pressure_b) * s.piston_area
    mover, plungers = m.mover, m.pump
    coupling = apply_slot(slots.COUPLING_FORCE, None, s)
    if coupling is None:
        mass, damping = mover.mover_mass + plungers.plunger_mass, mover.mover_damping + plungers.pump_damping
        return mover_rates(m, y, s, mass, damping, pressure_force)
    v, v_p = s.piston_velocity, s.sliding_velocity
    s.record_stored_energy("mover", 0.5 * mover.mover_mass * jnp.square(v))
    s.record_stored_energy("plungers", 0.5 * plungers.plunger_mass * jnp.square(v_p))
    s.record_power("mover damping", "mechanical", mover.mover_damping * v, v)
    s.record_power("plunger damping", "mechanical", plungers.pump_damping * v_p, v_p)
    s.record_effect_power("coupling_force", "mechanical", s.coupling_velocity)
    carrier = _force_on_coil_carrier(s, s.motor_force - mover.mover_damping * v) - coupling
    plunger = coupling - plungers.pump_damping * v_p - _force_against_plungers(m, s, pressure_force)
    carrier, plunger = carrier / mover.mover_mass, plunger / plungers.plunger_mass
    coupling_rates = {"coupling_deflection": s.coupling_velocity, "coupling_velocity": carrier - plunger}
    return _actuator_rates(m, y, s, carrier) | coupling_rates


def _force_on_coil_carrier(s: Signals, force):
    """`force` [N] with the contributions of effects to the coil carrier."""
    force = apply_slot(slots.MOVER_FORCE, force, s)
    s.record_effect_power("mover_force", "mechanical", s.piston_velocity, -1.0)
    if s.effect_contributions("motor_force_factor"):
        s.record_power("back-EMF", "mechanical", s.back_emf, s.current)
        s.record_power("motor force", "mechanical", -s.motor_force, s.piston_velocity)
    return force


def _force_against_plungers(m, s: Signals, pressure_force):
    """Force [N] against the motion of the plungers (of the mover without a pump): end stops, pressure, friction."""
    x, v = s.sliding_position, s.sliding_velocity
    half = 0.5 * m.stops.pump_stroke
    stop = m.stops.force(x, v, -half, half)
    friction = apply_slot(slots.MOVER_FRICTION, None, s)
    s.define(stop_force=stop, friction_force=jnp.zeros_like(v) if friction is None else friction)
    s.record_power("end stops", "mechanical", stop, v)
    s.record_effect_power("mover_friction", "mechanical", v)
    force = stop + pressure_force
    return force if friction is None else force + friction


def _actuator_rates(m, y: dict, s: Signals, acceleration) -> dict:
    """The rates of the mover, and of amplifier and controller, which need the signals of the mover."""
    rates = {"piston_position": s.piston_velocity, "piston_velocity": acceleration}
    return rates | m.amplifier.rates(s) | m.sampling.rates(m.controller, y, s)
