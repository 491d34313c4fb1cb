"""Formulas for what no effect of the library explains: single terms in the variables of an equation.

Each is an effect with one coefficient, so that it is tried like any other: mounted, fitted together with all that is
uncertain, and judged on runs that no fit has seen.
"""

from collections.abc import Callable

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects import Effect

# scales of speed, position, current, pressure and deflection, so that coefficients compare; pressure around
V, X, A, P, D, P0 = 0.2, 3.5e-3, 3.0, 0.5e6, 1e-4, 0.1e6


def _term(slot: str, name: str, text: str, size: float, unit: str, term: Callable, plausible=None) -> type[Effect]:
    """An effect that enters `slot` with coefficient · term(s), of either sign unless it says what is `plausible`."""
    body = {
        "__doc__": f"A form that is not in the library: c · {text}.",
        "__module__": __name__,
        "__annotations__": {"coefficient": float},
        "coefficient": par(
            size, unit, (-1e3 * size, 1e3 * size), f"c in c · {text}", plausible=plausible or (-4 * size, 4 * size)
        ),
        "text": text,
        slot: lambda self, s, z: self.coefficient * term(s),
    }
    return type("".join(part.title() for part in f"{slot}_{name}".split("_")), (Effect,), body)


def _smooth_sign(v):
    return jnp.tanh(v / 5e-3)


def _root(x):
    return x / jnp.sqrt(jnp.sqrt(jnp.square(x) + 1e-4))


def _contact(depth):
    return jnp.abs(depth) * jnp.sqrt(jnp.abs(depth) + 1e-6)


def _drop(s):
    return s.chamber_pressure - s.accumulator_pressure


FORCES = [
    _term("mover_force", name, text, 1.0, "N", term)
    for name, text, term in (
        ("constant", "1", lambda s: 1.0 + 0.0 * s.piston_position),
        ("position", "x/3.5 mm", lambda s: s.piston_position / X),
        ("speed_squared", "(v/0.2 m/s)·|v/0.2 m/s|", lambda s: s.piston_velocity / V * jnp.abs(s.piston_velocity / V)),
        ("speed_cubed", "(v/0.2 m/s)³", lambda s: (s.piston_velocity / V) ** 3),
        ("sign_of_speed", "sgn v", lambda s: _smooth_sign(s.piston_velocity)),
        ("size_of_speed", "|v/0.2 m/s|", lambda s: jnp.abs(s.piston_velocity / V)),
        ("position_cubed", "(x/3.5 mm)³", lambda s: (s.piston_position / X) ** 3),
        ("position_squared", "(x/3.5 mm)²", lambda s: (s.piston_position / X) ** 2),
        ("speed_at_ends", "(v/0.2 m/s)·(x/3.5 mm)²", lambda s: s.piston_velocity / V * (s.piston_position / X) ** 2),
        ("speed_by_side", "(v/0.2 m/s)·(x/3.5 mm)", lambda s: s.piston_velocity / V * s.piston_position / X),
        ("current_squared", "(i/3 A)·|i/3 A|", lambda s: s.current / A * jnp.abs(s.current / A)),
        ("current_by_side", "(i/3 A)·(x/3.5 mm)", lambda s: s.current / A * s.piston_position / X),
    )
]
VOLTAGES = [
    _term("coil_voltage_change", name, text, 0.3, "V", term)
    for name, text, term in (
        ("current_squared", "(i/3 A)·|i/3 A|", lambda s: s.current / A * jnp.abs(s.current / A)),
        ("sign_of_current", "sgn i", lambda s: jnp.tanh(s.current / 0.05)),
        ("speed_squared", "(v/0.2 m/s)·|v/0.2 m/s|", lambda s: s.piston_velocity / V * jnp.abs(s.piston_velocity / V)),
        ("speed_at_ends", "(v/0.2 m/s)·(x/3.5 mm)²", lambda s: s.piston_velocity / V * (s.piston_position / X) ** 2),
        ("speed_by_side", "(v/0.2 m/s)·(x/3.5 mm)", lambda s: s.piston_velocity / V * s.piston_position / X),
    )
]
FLOWS = [
    _term("chamber_leakage", name, text, 2e-7, "m^3/s", term)
    for name, text, term in (
        ("root_of_pressure", "√Δp/√0.5 MPa, signed", lambda s: _root(_drop(s) / P)),
        ("pressure_squared", "(Δp/0.5 MPa)·|Δp/0.5 MPa|", lambda s: _drop(s) / P * jnp.abs(_drop(s) / P)),
        ("pressure", "Δp/0.5 MPa", lambda s: _drop(s) / P),
    )
]
BALLS = [
    _term("check_valve_force", name, text, 0.05, "N", term)
    for name, text, term in (
        ("speed_squared", "(ẏ/0.2 m/s)·|ẏ/0.2 m/s|", lambda s: s.lift_velocity / V * jnp.abs(s.lift_velocity / V)),
        ("lift_squared", "(y/0.5 mm)²", lambda s: (s.lift / 0.5e-3) ** 2),
        ("constant", "1", lambda s: 1.0 + 0.0 * s.lift),
    )
]
CAPACITIES = [
    _term("outlet_capacity", name, text, 1e-12, "m^3/Pa", term)
    for name, text, term in (
        ("constant", "1", lambda s: 1.0 + 0.0 * s.outlet_pressure),
        ("pressure", "p/0.5 MPa", lambda s: s.outlet_pressure / P),
        ("inverse_pressure", "0.5 MPa/p", lambda s: P / s.outlet_pressure),
    )
]
SEATS = [
    _term(slot, "pressure", "|Δp|/0.5 MPa", 1e-8, "m^2", lambda s: jnp.abs(s.pressure_drop) / P)
    for slot in ("suction_valve_area", "delivery_valve_area")
]
LINES = [
    _term(
        "outlet_line_resistance", "turbulent", "√(p/0.5 MPa)", 3e8, "Pa*s/m^3", lambda s: _root(s.outlet_pressure / P)
    ),
    _term(
        "suction_line_resistance", "turbulent", "|v/0.2 m/s|", 3e8, "Pa*s/m^3", lambda s: jnp.abs(s.piston_velocity / V)
    ),
]
OILS = [
    _term("oil_compressibility", name, text, 1e-10, "1/Pa", term)
    for name, text, term in (
        ("constant", "1", lambda s: 1.0 + 0.0 * s.pressure),
        ("pressure", "p/0.5 MPa", lambda s: s.pressure / P),
        ("inverse_pressure", "0.1 MPa/p", lambda s: P0 / s.pressure),
    )
] + [  # free gas of 0.01 … 10 %
    _term(
        "oil_compressibility", "gas", "(0.1 MPa/p)²", 3e-8, "1/Pa", lambda s: jnp.square(P0 / s.pressure),
        plausible=(1e-9, 1e-6),
    )
]  # fmt: skip
# Hertz's law of a contact with the loss of Hunt and Crossley; rods and joints give 4 … 400 µm at 40 N
JOINTS = [
    _term(
        "coupling_force", "contact", "(|Δ|/0.1 mm)^1.5·(sgn Δ + Δ̇/(1 m/s))", 200.0, "N",
        lambda s: _contact(s.coupling_deflection / D) * (jnp.sign(s.coupling_deflection) + s.coupling_velocity),
        plausible=(5.0, 5000.0),
    )
]  # fmt: skip
FORMS: tuple[type[Effect], ...] = (
    *FORCES, *VOLTAGES, *FLOWS, *BALLS, *CAPACITIES, *SEATS, *LINES, *OILS, *JOINTS
)  # fmt: skip
