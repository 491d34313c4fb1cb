"""Access to the parameters of a machine by name: list, find, read and change them."""

import dataclasses
import math
from collections import Counter
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.core import structs
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.structs import Parameter
from edhas_jax.core.units import UnitError, format_quantity, to_si, with_article
from edhas_jax.machine.components.adaptive_sliding_mode import AdaptiveSlidingMode
from edhas_jax.machine.components.coil_and_amplifier import CurrentAmplifier, VoltageAmplifier
from edhas_jax.machine.components.controller_sampling import Continuous, Sampled
from edhas_jax.machine.components.controllers import CascadeController, OpenLoop, PositionController
from edhas_jax.machine.components.set_points import Chirp, Recorded, Sine, Step
from edhas_jax.machine.effects import LIBRARY
from edhas_jax.machine.rigs import RIGS, Rig, components_by_name

SET_POINTS: dict[str, type] = {"sine": Sine, "step": Step, "chirp": Chirp, "recorded": Recorded}
COMPONENT_KINDS: dict[str, dict[str, type]] = {
    "amplifier": {"voltage": VoltageAmplifier, "current": CurrentAmplifier},
    "controller": {
        "position": PositionController,
        "cascade": CascadeController,
        "antsmc": AdaptiveSlidingMode,
        "open_loop": OpenLoop,
    },
    "sampling": {"continuous": Continuous, "sampled": Sampled},
    "reference": SET_POINTS,
    "target": SET_POINTS,
}
"""The components that a section of a configuration selects by `kind`, on the rigs of the package."""

DRIVE_LIMIT = 1e12  # SI, of the set points of a rig of one's own, whose unit only it knows
SLOWEST = 1e-4  # times and frequencies of these, over those of the drives of the package
ORDER_TOLERANCE = 1e-9  # relative rounding error up to which two values in a prescribed order count as equal


class ParameterError(ValueError):
    """A parameter does not exist on this machine, or a value is not allowed for it."""


def list_parameters(machine: Rig) -> list[tuple[Parameter, Any, str]]:
    """Every parameter of a machine.

    Returns:
        Tuples of declaration, present value (SI) and component (field name or effect id). With an open-loop controller
        the reference is a voltage, and its parameters are listed in volts.
    """
    return [
        (_as_mounted(p, path, machine), getattr(component, p.name), path)
        for path, component in components_by_name(machine).items()
        for p in structs.parameters(type(component))
    ]


def short_names(machine: Rig) -> dict[tuple[str, str], str]:
    """The name of each parameter in tables and files, by component and field: flat if unique, else `component.name`."""
    rows = list_parameters(machine)
    count = Counter(p.name for p, _, _ in rows)
    return {(path, p.name): p.name if count[p.name] == 1 else f"{path}.{p.name}" for p, _, path in rows}


def find_parameter(machine: Rig, name: str) -> tuple[Parameter, str]:
    """Find a parameter by name.

    Args:
        machine: the machine.
        name: flat or as `owner.name`, where the owner is a component, an effect or a class in snake case.

    Returns:
        The declaration, and the component (field name or effect id) that holds the parameter.

    Raises:
        ParameterError: unknown name (the message has similar ones), or ambiguous name (with the qualified names).
    """
    owner, _, flat = name.rpartition(".")
    rows = list_parameters(machine)
    named = [(p, path) for p, _, path in rows if p.name == flat]
    found = [(p, path) for p, path in named if owner in ("", path)] or [
        (p, path) for p, path in named if owner == structs.owner_id(p.owner)
    ]
    if len(found) == 1:
        return found[0]
    if found:
        raise ParameterError(f"ambiguous; write one of {', '.join(f'{path}.{flat}' for _, path in found)}")
    if named:
        raise ParameterError(
            f"{owner} has no such parameter; write {' or '.join(f'{o}.{flat}' for _, o in named)}"
        )
    raise ParameterError(_unknown_reason(machine, owner, flat, [p.name for p, _, _ in rows]))


def has_parameter(machine: Rig, name: str) -> bool:
    """Whether a machine has a parameter of that name."""
    try:
        find_parameter(machine, name)
    except ParameterError:
        return False
    return True


def get_parameter(machine: Rig, name: str) -> Any:
    """The value (SI) of a parameter.

    Args:
        machine: the machine.
        name: of the parameter, flat or as `owner.name`.

    Returns:
        The value as the machine holds it: a number or an array of JAX.

    Raises:
        ParameterError: unknown or ambiguous name.
    """
    try:
        p, path = find_parameter(machine, name)
    except ParameterError as error:
        raise ParameterError(f"{name}: {error}") from None
    return getattr(components_by_name(machine)[path], p.name)


def set_parameters(machine: Rig, values: Mapping[str, Any]) -> Rig:
    """A copy of the machine with some parameters changed.

    Args:
        machine: the machine.
        values: by flat name or `owner.name`, a number in SI, a JAX scalar (a traced one is not checked) or a text with
            unit ("15 µm").

    Raises:
        ParameterError: unknown or ambiguous name, not a number, a value outside the span, or two values in an order
            that a law excludes.
    """
    given: dict[tuple[str, str], str] = {}
    for name, value in values.items():
        try:
            p, path = find_parameter(machine, name)
            if (path, p.name) in given:
                raise ParameterError(f"given twice, also as {given[path, p.name]}")
            given[path, p.name] = name
            machine = replace_value(machine, path, p.name, parse_value(p, value))
        except (ParameterError, UnitError) as error:
            raise ParameterError(f"{name}: {error}") from None
    for path, p, problem in order_problems(machine):
        named = [given[path, n] for n in (p.name, p.at_least) if (path, n) in given]
        if named:
            raise ParameterError(f"{named[0]}: {problem}")
    return machine


def order_problems(machine: Rig) -> list[tuple[str, Parameter, str]]:
    """The parameters that are smaller than the one that their law prescribes as lower limit (`at_least`).

    Returns:
        Component, declaration and a sentence for each. Traced values are not checked.
    """
    problems = []
    for path, component in components_by_name(machine).items():
        for p in structs.parameters(type(component)):
            if not p.at_least:
                continue
            value, limit = getattr(component, p.name), getattr(component, p.at_least)
            if isinstance(value, jax.core.Tracer) or isinstance(limit, jax.core.Tracer):
                continue
            if np.all(np.asarray(value) >= np.asarray(limit) * (1.0 - ORDER_TOLERANCE)):
                continue
            value, limit = (format_quantity(float(np.min(x)), p.unit) for x in (value, limit))
            problems.append((path, p, f"{p.name} ({value}) must be at least {p.at_least} ({limit})"))
    return problems


def replace_value(machine: Rig, path: str, name: str, value: Any) -> Rig:
    """A copy of the machine with the parameter `name` of the component `path` set to a value in SI, unchecked."""
    for i, effect in enumerate(machine.effects):
        if effect.id == path:
            changed = structs.replace(effect, **{name: value})
            return structs.replace(machine, effects=(*machine.effects[:i], changed, *machine.effects[i + 1 :]))
    return structs.replace(machine, **{path: structs.replace(getattr(machine, path), **{name: value})})


def replace_values(machine: Rig, values: Mapping[str, Any]) -> Rig:
    """A copy of the machine with the parameters of these names set to values in SI, numbers or arrays, unchecked."""
    for name, value in values.items():
        p, path = find_parameter(machine, name)
        machine = replace_value(machine, path, p.name, value)
    return machine


def parse_value(p: Parameter, value: Any) -> Any:
    """The SI value for a parameter from a number in SI, a JAX scalar or a text with unit; a traced one is not checked.

    Raises:
        ParameterError: not a number, not finite, or outside the span.
        UnitError: a text that is not a quantity of this dimension.
    """
    if isinstance(value, str):
        value = to_si(value, p.unit, format_quantity(p.default, p.unit))
    is_number = isinstance(value, int | float | jax.Array | np.number | np.ndarray) and not isinstance(value, bool)
    if not is_number or np.shape(value) != () or not jnp.issubdtype(jnp.result_type(value), jnp.number):
        raise ParameterError(f'a number or a text such as "{format_quantity(p.default, p.unit)}" belongs here')
    if isinstance(value, jax.core.Tracer):
        return value
    if jnp.iscomplexobj(value) or not math.isfinite(value):
        raise ParameterError(f"{value} is not a finite number")
    low, high = p.span
    if not low <= value <= high:
        raise ParameterError(f"must lie in {format_span(p)} ({p.doc}); got {format_quantity(value, p.unit)}")
    return value if isinstance(value, jax.Array) else float(value)


def format_span(p: Parameter) -> str:
    """The allowed interval of a parameter as text, in units of convenient size."""
    return f"{format_quantity(p.span[0], p.unit)} … {format_quantity(p.span[1], p.unit)}"


def _as_mounted(p: Parameter, path: str, machine: Rig) -> Parameter:
    """The declaration of a parameter on this machine: with an open-loop controller the reference is in volts."""
    if path in machine.drives and p.unit == "m":
        value = machine.drives[path].value if p.name == "step_size" else 0.0
        low = -DRIVE_LIMIT if p.span[0] < 0.0 else 0.0
        return dataclasses.replace(p, unit=machine.drive_unit(path), span=(low, DRIVE_LIMIT), default=value)
    if path in machine.drives and p.unit in ("s", "Hz"):
        return dataclasses.replace(p, span=(SLOWEST * p.span[0], p.span[1] / SLOWEST))
    if path == "reference" and p.unit == "m" and machine.drive_unit(path) == "V":
        volts = (p.span[0] * 1e3, p.span[1] * 1e3)
        default = 12.0 if p.default else 0.0
        return dataclasses.replace(p, unit="V", span=volts, default=default, doc=p.doc.replace("set point", "command"))
    return p


def component_kinds(machine: Rig | type[Rig]) -> dict[str, dict[str, type]]:
    """The kinds that each section of a configuration of this machine can select, by section."""
    own = {name: SET_POINTS for name in machine.drives}
    return own | {name: kinds for name, kinds in COMPONENT_KINDS.items() if hasattr(machine, name)}


def _unknown_reason(machine: Rig, owner: str, flat: str, known: list[str]) -> str:
    """Why a parameter does not exist: its component or effect is not mounted, or the name is wrong."""
    for cls in LIBRARY:
        if flat in (p.name for p in structs.parameters(cls)) and owner in ("", cls.id):
            return f"belongs to the effect {cls.id}, which is not mounted"
    for section, kinds in COMPONENT_KINDS.items():
        names = {k: [p.name for p in structs.parameters(cls)] for k, cls in kinds.items() if cls is not Recorded}
        having = [k for k in names if flat in names[k]]
        if having and hasattr(machine, section) and owner in ("", section):
            return f"belongs to {with_article(section)} of kind {' or '.join(having)}, which is not mounted"
    for rig in RIGS.values():
        for path, component in components_by_name(rig()).items():
            if flat in (p.name for p in structs.parameters(type(component))) and owner in ("", path):
                return f"belongs to the {path.replace('_', ' ')}, which {machine.name} does not have"
    return f"unknown parameter; {suggest(flat, set(known))}"


def change(machine: Rig, **values: Any) -> Rig:
    """A copy of `machine` with parameters changed: `change(machine, piston_clearance="15 µm", frequency=20.0)`.

    Args:
        machine: the machine.
        values: by flat parameter name, a text with unit or a number in SI. `**{"owner.name": value}` gives qualified
            names.

    Raises:
        ParameterError: unknown or ambiguous name, not a number, or a value outside the span.
    """
    return set_parameters(machine, values)
