"""Electrical section: set point, controller, supply, amplifier and coil, up to the motor force."""

import jax.numpy as jnp

from edhas_jax.machine.components.coil_and_amplifier import CurrentAmplifier, VoltageAmplifier
from edhas_jax.machine.components.controllers import clip_to_supply
from edhas_jax.machine.effects.base import initial_effect_states
from edhas_jax.machine.interface.signals import Signals


def set_reference(reference, s: Signals, share=1.0) -> None:
    """Set the set point of the piston [m] and its rate [m/s], both multiplied by `share` (0 … 1)."""
    value, rate = reference.value_and_rate(s.time)
    s.define(reference=share * value, reference_velocity=share * rate)


def actuator_initial_state(m) -> dict:
    """The states of amplifier, controller, effects and mover at rest."""
    y = m.amplifier.initial() | m.sampling.initial(m.controller) | initial_effect_states(m.effects)
    return y | {"piston_position": 0.0, "piston_velocity": 0.0}


def set_electrical_signals(m, y: dict, s: Signals) -> None:
    """Set the signals from the controller's command to the coil current and the motor force."""
    s.define(piston_position=y["piston_position"], piston_velocity=y["piston_velocity"])
    if isinstance(m.amplifier, VoltageAmplifier):
        s.define(current=m.amplifier.current(y, s))
    s.define(unlimited_voltage=m.sampling.command(m.controller, y, s))
    s.define(voltage=clip_to_supply(s.unlimited_voltage, s))
    if isinstance(m.amplifier, CurrentAmplifier):
        s.define(current=m.amplifier.current(y, s))
    m.coil.set_signals(s)
    s.define(coil_voltage=m.amplifier.coil_voltage(s))
    if isinstance(m.amplifier, VoltageAmplifier):
        s.record_power("electrical input", "input", s.voltage, s.current)
        if s.effect_contributions("coil_inductance_factor"):  # ½ L i² is then not the energy supplied to the coil
            s.record_power("coil", "stored", s.coil_voltage - s.resistance * s.current - s.back_emf, s.current)
        else:
            s.record_stored_energy("coil", 0.5 * s.inductance * jnp.square(s.current))
    else:
        s.record_power("electrical input", "input", s.coil_voltage, s.current)
    s.record_power("copper", "copper", s.resistance * s.current, s.current)
    s.record_valid_range("piston_position", -0.6 * m.stops.pump_stroke, 0.6 * m.stops.pump_stroke)
    s.record_effect_power("coil_voltage_change", "copper", s.current, -1.0)
