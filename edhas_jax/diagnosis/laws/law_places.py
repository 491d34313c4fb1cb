"""The variables over which a law at a slot can be drawn as a curve."""

import functools

from edhas_jax.core import structs
from edhas_jax.machine.effects import EffectError
from edhas_jax.machine.effects.tabulated_law import LawPlace, rig_of, tabulated_class
from edhas_jax.machine.effects.validation import check_effect
from edhas_jax.machine.rig_base import KindOfMachine, Rig


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


@functools.cache
def _law_places(kind: KindOfMachine, effects: tuple[type, ...], slot: str) -> tuple[LawPlace, ...]:
    declared = next((s for s in kind.machine.slots if s.name == slot), None)
    if declared is None or declared.is_exclusive and not any(declared in effect.slots for effect in effects):
        return ()
    # what is known at a slot seldom depends on the effects, whose every combination would have to be tried
    return tuple(
        place
        for text in declared.over
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
