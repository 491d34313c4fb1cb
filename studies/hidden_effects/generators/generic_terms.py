"""Generic terms: single algebraic terms in the variables of an equation, each an effect with one coefficient c.

A law that one of them nearly equals is too simple to be withheld as something that the library never had.
"""

from collections.abc import Callable

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects import Effect

# reference values (SI) that make the variables of order one, so that coefficients are comparable
SPEED, POSITION, CURRENT, PRESSURE, DEFLECTION = 0.2, 3.5e-3, 3.0, 0.5e6, 1e-4
LIFT, AMBIENT_PRESSURE = 0.5e-3, 0.1e6
SPEED_SMOOTHING, CURRENT_SMOOTHING = 5e-3, 0.05  # m/s and A; width of the smoothed sign functions
ROOT_SMOOTHING, CONTACT_SMOOTHING = 1e-4, 1e-6  # keep the derivative of a root finite at zero
COEFFICIENT_LIMIT, PLAUSIBLE_COEFFICIENT = 1e3, 4.0  # multiples of a term's typical size


def _term(
    slot: str, name: str, text: str, size: float, unit: str, term: Callable,
    plausible: tuple[float, float] | None = None,
) -> type[Effect]:  # fmt: skip
    """Create the class of an effect that adds c · term(signals) to a slot.

    Args:
        slot: slot of the machine.
        name: distinguishes the terms of a slot; part of the effect's id.
        text: the term as shown to the user.
        size: typical value of c, in `unit`.
        unit: unit of the slot.
        term: function of the signals.
        plausible: plausible range of c; either sign by default.
    """
    limit, typical = COEFFICIENT_LIMIT * size, PLAUSIBLE_COEFFICIENT * size
    body = {
        "__doc__": f"Generic term: c · {text}.",
        "__module__": __name__,
        "__annotations__": {"coefficient": float},
        "coefficient": par(
            size, unit, (-limit, limit), f"c in c · {text}", plausible=plausible or (-typical, typical)
        ),
        "text": text,
        slot: lambda self, s, z: self.coefficient * term(s),
    }
    return type("".join(part.title() for part in f"{slot}_{name}".split("_")), (Effect,), body)


def _smooth_sign(speed):
    return jnp.tanh(speed / SPEED_SMOOTHING)


def _signed_root(x):
    return x / jnp.sqrt(jnp.sqrt(jnp.square(x) + ROOT_SMOOTHING))


def _power_three_halves(x):
    return jnp.abs(x) * jnp.sqrt(jnp.abs(x) + CONTACT_SMOOTHING)


def _signed_square(x):
    return x * jnp.abs(x)


def _speed(s):
    return s.piston_velocity / SPEED


def _position(s):
    return s.piston_position / POSITION


def _current(s):
    return s.current / CURRENT


def _pressure_drop(s):
    return (s.chamber_pressure - s.accumulator_pressure) / PRESSURE


FORCE_TERMS = [
    _term("mover_force", name, text, 1.0, "N", term)
    for name, text, term in (
        ("constant", "1", lambda s: 1.0 + 0.0 * s.piston_position),
        ("position", "x/3.5 mm", _position),
        ("speed_squared", "(v/0.2 m/s)·|v/0.2 m/s|", lambda s: _signed_square(_speed(s))),
        ("speed_cubed", "(v/0.2 m/s)³", lambda s: _speed(s) ** 3),
        ("sign_of_speed", "sgn v", lambda s: _smooth_sign(s.piston_velocity)),
        ("size_of_speed", "|v/0.2 m/s|", lambda s: jnp.abs(_speed(s))),
        ("position_cubed", "(x/3.5 mm)³", lambda s: _position(s) ** 3),
        ("position_squared", "(x/3.5 mm)²", lambda s: _position(s) ** 2),
        ("speed_at_ends", "(v/0.2 m/s)·(x/3.5 mm)²", lambda s: _speed(s) * _position(s) ** 2),
        ("speed_by_side", "(v/0.2 m/s)·(x/3.5 mm)", lambda s: _speed(s) * s.piston_position / POSITION),
        ("current_squared", "(i/3 A)·|i/3 A|", lambda s: _signed_square(_current(s))),
        ("current_by_side", "(i/3 A)·(x/3.5 mm)", lambda s: _current(s) * s.piston_position / POSITION),
    )
]
VOLTAGE_TERMS = [
    _term("coil_voltage_change", name, text, 0.3, "V", term)
    for name, text, term in (
        ("current_squared", "(i/3 A)·|i/3 A|", lambda s: _signed_square(_current(s))),
        ("sign_of_current", "sgn i", lambda s: jnp.tanh(s.current / CURRENT_SMOOTHING)),
        ("speed_squared", "(v/0.2 m/s)·|v/0.2 m/s|", lambda s: _signed_square(_speed(s))),
        ("speed_at_ends", "(v/0.2 m/s)·(x/3.5 mm)²", lambda s: _speed(s) * _position(s) ** 2),
        ("speed_by_side", "(v/0.2 m/s)·(x/3.5 mm)", lambda s: _speed(s) * s.piston_position / POSITION),
    )
]
LEAKAGE_TERMS = [
    _term("chamber_leakage", name, text, 2e-7, "m^3/s", term)
    for name, text, term in (
        ("root_of_pressure", "√Δp/√0.5 MPa, signed", lambda s: _signed_root(_pressure_drop(s))),
        ("pressure_squared", "(Δp/0.5 MPa)·|Δp/0.5 MPa|", lambda s: _signed_square(_pressure_drop(s))),
        ("pressure", "Δp/0.5 MPa", _pressure_drop),
    )
]
VALVE_FORCE_TERMS = [
    _term("check_valve_force", name, text, 0.05, "N", term)
    for name, text, term in (
        ("speed_squared", "(ẏ/0.2 m/s)·|ẏ/0.2 m/s|", lambda s: _signed_square(s.lift_velocity / SPEED)),
        ("lift_squared", "(y/0.5 mm)²", lambda s: (s.lift / LIFT) ** 2),
        ("constant", "1", lambda s: 1.0 + 0.0 * s.lift),
    )
]
CAPACITY_TERMS = [
    _term("outlet_capacity", name, text, 1e-12, "m^3/Pa", term)
    for name, text, term in (
        ("constant", "1", lambda s: 1.0 + 0.0 * s.outlet_pressure),
        ("pressure", "p/0.5 MPa", lambda s: s.outlet_pressure / PRESSURE),
        ("inverse_pressure", "0.5 MPa/p", lambda s: PRESSURE / s.outlet_pressure),
    )
]
VALVE_AREA_TERMS = [
    _term(slot, "pressure", "|Δp|/0.5 MPa", 1e-8, "m^2", lambda s: jnp.abs(s.pressure_drop) / PRESSURE)
    for slot in ("suction_valve_area", "delivery_valve_area")
]
LINE_TERMS = [
    _term(
        "outlet_line_resistance", "turbulent", "√(p/0.5 MPa)", 3e8, "Pa*s/m^3",
        lambda s: _signed_root(s.outlet_pressure / PRESSURE),
    ),
    _term("suction_line_resistance", "turbulent", "|v/0.2 m/s|", 3e8, "Pa*s/m^3", lambda s: jnp.abs(_speed(s))),
]  # fmt: skip
COMPRESSIBILITY_TERMS = [
    _term("oil_compressibility", name, text, 1e-10, "1/Pa", term)
    for name, text, term in (
        ("constant", "1", lambda s: 1.0 + 0.0 * s.pressure),
        ("pressure", "p/0.5 MPa", lambda s: s.pressure / PRESSURE),
        ("inverse_pressure", "0.1 MPa/p", lambda s: AMBIENT_PRESSURE / s.pressure),
    )
] + [  # free gas of 0.01 … 10 %
    _term(
        "oil_compressibility", "gas", "(0.1 MPa/p)²", 3e-8, "1/Pa", lambda s: jnp.square(AMBIENT_PRESSURE / s.pressure),
        plausible=(1e-9, 1e-6),
    )
]  # fmt: skip
# Hertz contact with Hunt-Crossley loss; the plausible range gives deflections of 4 … 400 µm at 40 N
COUPLING_TERMS = [
    _term(
        "coupling_force", "contact", "(|Δ|/0.1 mm)^1.5·(sgn Δ + Δ̇/(1 m/s))", 200.0, "N",
        lambda s: (
            _power_three_halves(s.coupling_deflection / DEFLECTION)
            * (jnp.sign(s.coupling_deflection) + s.coupling_velocity)
        ),
        plausible=(5.0, 5000.0),
    )
]  # fmt: skip
GENERIC_TERMS: tuple[type[Effect], ...] = (
    *FORCE_TERMS, *VOLTAGE_TERMS, *LEAKAGE_TERMS, *VALVE_FORCE_TERMS, *CAPACITY_TERMS, *VALVE_AREA_TERMS, *LINE_TERMS,
    *COMPRESSIBILITY_TERMS, *COUPLING_TERMS,
)  # fmt: skip
