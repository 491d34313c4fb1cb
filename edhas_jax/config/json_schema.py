"""JSON schema of machine configurations, for completion and checks in editors."""

from collections.abc import Mapping
from typing import Any

from edhas_jax.config.law_reader import LAW_KEYS, LAW_KIND, MAX_FACTORS
from edhas_jax.config.machine_reader import SHORT_KEYS
from edhas_jax.config.recorded_signal import RECORDING_KEYS, Between
from edhas_jax.config.run_settings import SIMULATION_SETTINGS, setting_text
from edhas_jax.core import structs
from edhas_jax.core.structs import Parameter
from edhas_jax.core.units import format_quantity
from edhas_jax.machine.effects import LIBRARY
from edhas_jax.machine.effects.tabulated_law import LAW_SIGNALS
from edhas_jax.machine.interface.slots import SLOTS
from edhas_jax.machine.parameters import COMPONENT_KINDS, format_span
from edhas_jax.machine.rigs import RIGS, components_by_name
from edhas_jax.simulation.run_settings import Precision

USER_CLASS_PATTERN = r"^.+:\s*[A-Za-z_]\w*\s*$"  # file.py:ClassName
LAW_FILE_PATTERN = r"^.+\.ya?ml$"
QUANTITY_REFERENCE = {"$ref": "#/$defs/quantity"}


def json_schema() -> dict[str, Any]:
    """Build the schema from the declarations of rigs, components, effects and simulation settings.

    Returns:
        A JSON schema of draft 2020-12 as plain data.
    """
    sections = {name: _section_schema(kinds) for name, kinds in COMPONENT_KINDS.items()}
    sections["controller"] = _controller_schema()
    sections["target"] = {"anyOf": [QUANTITY_REFERENCE, sections["target"]]}
    effects = [{"enum": [cls.id for cls in LIBRARY]}, {"type": "string", "pattern": USER_CLASS_PATTERN}]
    effects += [{"type": "string", "pattern": LAW_FILE_PATTERN}, _law_schema()]
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "edhas_jax configuration",
        "type": "object",
        "required": ["rig"],
        "$defs": {"quantity": {"type": ["string", "number"], "description": 'a number with its unit, such as "12 mm"'}},
        "properties": {
            "name": {"type": ["string", "number"], "description": "name of the configuration"},
            "rig": {
                "anyOf": [{"enum": list(RIGS)}, {"type": "string", "pattern": USER_CLASS_PATTERN}],
                "description": "machine to simulate; your own as file.py:ClassName",
            },
            "effects": {
                "type": ["array", "null"],
                "description": "effects of the library, your own as file.py:ClassName, or tabulated laws (curve.yaml)",
                "items": {"anyOf": effects},
            },
            "parameters": {
                "type": ["object", "null"],
                "description": "any parameter of the machine or of its effects, by name or owner.name",
                "properties": {name: _parameter_schema(ps) for name, ps in sorted(_parameters_by_name().items())},
                "additionalProperties": QUANTITY_REFERENCE,
            },
            **sections,
            "simulation": _simulation_schema(),
        },
    }
    # a rig of one's own has a section for each of its drives
    built_in = {"properties": {"rig": {"enum": list(RIGS)}}}
    return schema | {"if": built_in, "then": {"propertyNames": {"enum": list(schema["properties"])}}}


def _law_schema() -> dict[str, Any]:
    """The schema of a tabulated law as an entry of `effects`."""
    texts = {key: {"type": "string"} for key in ("name", "origin", "node_unit", "value_unit")}
    numbers = {key: {"type": "array", "items": {"type": "number"}} for key in ("nodes", "values", "standard_errors")}
    signals = {"enum": list(LAW_SIGNALS)}
    properties = {"law": {"enum": [LAW_KIND]}, "slot": {"enum": list(SLOTS)}, "variable": signals} | texts | numbers
    properties["factors"] = {"type": "array", "items": signals, "maxItems": MAX_FACTORS}
    return {
        "type": "object",
        "description": "a law as a table, with the keys of its file",
        "required": ["law", "name", "slot", "variable", "node_unit", "nodes", "values"],
        "properties": {key: properties[key] for key in LAW_KEYS},
        "additionalProperties": False,
    }


def _parameters_by_name() -> dict[str, list[Parameter]]:
    """Every parameter by its name; several owners may declare the same name."""
    owners = dict.fromkeys(type(part) for rig in RIGS.values() for part in components_by_name(rig()).values())
    owners |= dict.fromkeys(cls for kinds in COMPONENT_KINDS.values() for cls in kinds.values())
    owners |= dict.fromkeys(LIBRARY)
    by_name: dict[str, list[Parameter]] = {}
    for owner in owners:
        for p in structs.parameters(owner):
            by_name.setdefault(p.name, []).append(p)
    return by_name


def _simulation_schema() -> dict[str, Any]:
    """The schema of the section `simulation`; step and accuracy exclude each other and have no fixed default."""
    settings = {n: _parameter_schema([p]) for n, p in SIMULATION_SETTINGS.items()}
    settings["precision"] = {"enum": [p.value for p in Precision]}
    step = SIMULATION_SETTINGS["step"]
    defaults = {"step": f"{setting_text(step, step.default)} without `accuracy`", "accuracy": "none"}
    for name, default in defaults.items():
        del settings[name]["default"]
        p = SIMULATION_SETTINGS[name]
        low, high = (setting_text(p, bound) for bound in p.span)
        settings[name]["description"] = f"{p.doc}; {low} … {high}; default: {default}"
    return {
        "type": ["object", "null"],
        "properties": settings,
        "additionalProperties": False,
        "not": {"required": ["step", "accuracy"]},
    }


def _parameter_schema(same_name: list[Parameter]) -> dict[str, Any]:
    """The schema of one key, described for every owner that declares a parameter of this name."""
    p = same_name[0]
    several = len(same_name) > 1
    meaning = " / ".join(f"{structs.owner_id(q.owner)}: {q.doc}" if several else q.doc for q in same_name)
    dimensionless = p.unit == "-"
    number = {"type": ["string", "number"], "minimum": p.span[0], "maximum": p.span[1]}
    allowed = f"{format_span(p)}; default {format_quantity(p.default, p.unit)}"
    unit = "no unit" if dimensionless else f"SI unit {p.unit}"
    return (number if dimensionless else {"type": "string"}) | {
        "description": f"{meaning}; {unit}; {allowed}",
        "default": float(p.default) if dimensionless else format_quantity(p.default, p.unit),
    }


def _section_schema(kinds: Mapping[str, type]) -> dict[str, Any]:
    """The schema of a section that selects a component by `kind` and sets its parameters."""
    keys = {p.name: _parameter_schema([p]) for cls in kinds.values() for p in structs.parameters(cls)}
    keys |= {short: keys[name] for short, name in SHORT_KEYS.items() if name in keys}
    if "recorded" in kinds:
        keys |= {name: {"type": "string"} for name in RECORDING_KEYS if name != "kind"}
        keys["between"] = {"enum": [b.value for b in Between], "description": "what is between two samples"}
    return {
        "type": "object",
        "properties": {"kind": {"enum": list(kinds)}} | keys,
        "additionalProperties": False,
    }


def _controller_schema() -> dict[str, Any]:
    """The schema of the section `controller`; a class of the user may have any further parameters."""
    section = _section_schema(COMPONENT_KINDS["controller"])
    user_class = {"type": "string", "pattern": USER_CLASS_PATTERN}
    built_in = {"properties": {"kind": {"enum": list(COMPONENT_KINDS["controller"])}}}
    section["properties"]["kind"] = {"anyOf": [section["properties"]["kind"], user_class]}
    section["additionalProperties"] = QUANTITY_REFERENCE
    return section | {"if": built_in, "then": {"propertyNames": {"enum": list(section["properties"])}}}
