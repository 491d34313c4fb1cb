"""The variables over which a law at a slot can be drawn as a curve."""

import functools

from edhas_jax.core import structs
from edhas_jax.machine.effects import EffectError
from edhas_jax.machine.effects.tabulated_law import LawPlace, rig_of, tabulated_class
from edhas_jax.machine.effects.validation import check_effect
from edhas_jax.machine.rig_base import KindOfMachine, Rig

# variables of a slot, the most usual first; behind a colon the signals by which the curve is multiplied
_COIL = ("current", "piston_velocity", "piston_position", "voltage")
_CYLINDER = ("cylinder_velocity", "cylinder_position", "head_pressure")
_VALVE_AREA = ("lift", "pressure_drop")
_VARIABLES: dict[str, tuple[str, ...]] = {
    "supply_voltage_change": ("current", "voltage"),
    "coil_voltage_change": _COIL,
    "coil_resistance_factor": _COIL,
    "coil_inductance_factor": ("piston_position", "current"),
    "force_constant_factor": ("piston_position", "current"),
    "motor_force_factor": ("current", "piston_position"),
    "mover_force": (
        "piston_position", "piston_velocity", "current", "chamber_pressure_a", "piston_position:current",
        "piston_position:piston_velocity", "piston_position:current:current",
    ),
    "mover_friction": (
        "piston_velocity", "piston_position", "current", "chamber_pressure_a", "piston_position:piston_velocity",
        "piston_velocity:outlet_pressure",
    ),
    "coupling_force": ("coupling_deflection", "coupling_velocity"),
    "check_valve_force": ("lift", "pressure_drop", "lift_velocity", "lift:pressure_drop", "lift:lift_velocity"),
    "suction_valve_area": _VALVE_AREA,
    "delivery_valve_area": _VALVE_AREA,
    "chamber_leakage": ("chamber_pressure", "plunger_velocity", "plunger_velocity:chamber_pressure"),
    "gap_viscosity_factor": ("chamber_pressure",),
    "suction_line_resistance": ("piston_velocity",),
    "outlet_line_resistance": ("outlet_pressure",),
    "outlet_capacity": ("outlet_pressure",),
    "oil_compressibility": ("pressure",),
    "oil_viscosity_factor": ("piston_velocity",),
    "cylinder_force": _CYLINDER,
    "cylinder_friction_force": _CYLINDER,
    "cylinder_friction_level": _CYLINDER,
    "cylinder_leakage_change": _CYLINDER,
}  # fmt: skip

# slots whose use changes the states of a machine: a curve alone is no model of a coupling or of a line
STRUCTURAL_SLOTS = ("coupling_force", "suction_line_resistance", "suction_line_flow", "outlet_line_flow", "oil_gas")

# typical size of a term at a slot, SI: about what an effect of the library contributes at its plausible values
_TYPICAL_SIZES = {
    "supply_voltage_change": 1.0, "coil_voltage_change": 0.3, "coil_resistance_factor": 0.1,
    "coil_inductance_factor": 0.1, "force_constant_factor": 0.1, "motor_force_factor": 0.1, "mover_force": 1.0,
    "mover_friction": 1.0, "coupling_force": 10.0, "check_valve_force": 0.05, "suction_valve_area": 1e-7,
    "delivery_valve_area": 1e-7, "chamber_leakage": 2e-7, "gap_viscosity_factor": 0.1, "suction_line_resistance": 3e8,
    "outlet_line_resistance": 3e8, "outlet_capacity": 1e-12, "oil_compressibility": 1e-10,
    "oil_viscosity_factor": 0.1, "cylinder_force": 10.0, "cylinder_friction_force": 10.0,
    "cylinder_friction_level": 10.0, "cylinder_leakage_change": 1e-13,
}  # fmt: skip


def law_places(machine: Rig, slot: str) -> tuple[LawPlace, ...]:
    """The curves that can be drawn at a slot of a machine, the most usual first.

    Args:
        machine: the machine; signals that it does not have, or knows only after the slot, are left out.
        slot: name of the slot.

    Returns:
        One place for each variable, and for each product of a curve with further signals; none for a slot that only
        has a meaning together with states of its own.
    """
    return _law_places(KindOfMachine(machine), tuple(type(e) for e in machine.effects), slot)


def free_places(machine: Rig) -> tuple[LawPlace, ...]:
    """The places of a machine, over one variable each, at which a law can be added where no effect acts so far."""
    names = [slot.name for slot in machine.slots if slot.name not in STRUCTURAL_SLOTS]
    return tuple(place for name in names for place in law_places(machine, name) if not place.factors)


def typical_size(place: LawPlace, factor_size: float = 1.0) -> float:
    """The size of a curve that matters at a place, SI.

    Args:
        place: the place.
        factor_size: typical magnitude of the product of the place's factors, SI.
    """
    declared = place.declaration
    return (declared.typical_size if declared.over else _TYPICAL_SIZES[place.slot]) / factor_size


@functools.cache
def _law_places(kind: KindOfMachine, effects: tuple[type, ...], slot: str) -> tuple[LawPlace, ...]:
    declared = next((s for s in kind.machine.slots if s.name == slot), None)
    variables = () if declared is None else declared.over or _VARIABLES.get(slot, ())
    if not variables or (slot in STRUCTURAL_SLOTS and not any(declared in effect.slots for effect in effects)):
        return ()
    # what is known at a slot seldom depends on the effects, whose every combination would have to be tried
    return tuple(
        place
        for text in variables
        if (place := _place(kind, (), slot, text) or _place(kind, effects, slot, text)) is not None
    )


@functools.cache
def _place(kind: KindOfMachine, effects: tuple[type, ...], slot: str, text: str) -> LawPlace | None:
    """The place of a curve over the variable and factors of a text; None where a machine cannot have it."""
    machine = structs.replace(kind.machine, effects=tuple(effect() for effect in effects))
    variable, *factors = text.split(":")
    place = LawPlace(slot, variable, tuple(factors), rig_of(machine))
    try:
        check_effect(tabulated_class("a_curve", place, 2)(node_1=0.0, node_2=1.0), machine)
    except EffectError:
        return None
    return place
