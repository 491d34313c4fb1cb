"""The JSON schema of configurations, for completion and checks in editors."""

from collections.abc import Mapping
from typing import Any

from edhas_jax.config.recorded_signal import RECORDING_KEYS
from edhas_jax.config.run_settings import SIMULATION_SETTINGS, setting_text
from edhas_jax.core import structs
from edhas_jax.core.structs import Parameter
from edhas_jax.core.units import format_quantity
from edhas_jax.machine.effects import LIBRARY
from edhas_jax.machine.parameters import KINDS, span_text
from edhas_jax.machine.rigs import RIGS, parts
from edhas_jax.simulation.run import Precision

CLASS_IN_FILE = r"^.+:\s*[A-Za-z_]\w*\s*$"  # a class of the user


def json_schema() -> dict[str, Any]:
    """The JSON schema (draft 2020-12) of a configuration, made from what rigs, effects and parameters declare."""
    owners = dict.fromkeys(type(part) for rig in RIGS.values() for part in parts(rig()).values())
    owners |= dict.fromkeys(cls for kinds in KINDS.values() for cls in kinds.values())
    owners |= dict.fromkeys(LIBRARY)
    by_name: dict[str, list[Parameter]] = {}
    for owner in owners:
        for p in structs.parameters(owner):
            by_name.setdefault(p.name, []).append(p)
    effects = [cls.id for cls in LIBRARY]
    text_file = {"type": "string", "pattern": CLASS_IN_FILE}
    settings = {n: _schema_of([p]) for n, p in SIMULATION_SETTINGS.items()}
    settings["precision"] = {"enum": [p.value for p in Precision]}
    for name in ("step", "accuracy"):
        del settings[name]["default"]
        p = SIMULATION_SETTINGS[name]
        low, high = (setting_text(p, bound) for bound in p.span)
        settings[name]["description"] = f"{p.doc}; {low} … {high}; default: chosen"
    sections = {s: _schema_of_section(kinds) for s, kinds in KINDS.items()}
    sections["controller"] = _schema_of_controller()
    sections["target"] = {"anyOf": [{"$ref": "#/$defs/quantity"}, sections["target"]]}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "edhas_jax configuration",
        "type": "object",
        "required": ["rig"],
        "additionalProperties": False,
        "$defs": {"quantity": {"type": ["string", "number"], "description": 'a number with its unit, such as "12 mm"'}},
        "properties": {
            "name": {"type": ["string", "number"], "description": "a text that names the configuration"},
            "rig": {"enum": list(RIGS), "description": "what is simulated"},
            "effects": {
                "type": ["array", "null"],
                "description": "effects of the library, or your own as file.py:ClassName",
                "items": {"anyOf": [{"enum": effects}, text_file]},
            },
            "parameters": {
                "type": ["object", "null"],
                "description": "any parameter of the machine or of its effects, by name or owner.name",
                "properties": {name: _schema_of(ps) for name, ps in sorted(by_name.items())},
                "additionalProperties": {"$ref": "#/$defs/quantity"},
            },
            **sections,
            "simulation": {
                "type": ["object", "null"],
                "properties": settings,
                "additionalProperties": False,
                "not": {"required": ["step", "accuracy"]},
            },
        },
    }


def _schema_of(ps: list[Parameter]) -> dict[str, Any]:
    p = ps[0]
    docs = " / ".join(f"{structs.owner_id(q.owner)}: {q.doc}" if len(ps) > 1 else q.doc for q in ps)
    kind = (
        {"type": "string"}
        if p.unit != "-"
        else {"type": ["string", "number"], "minimum": p.span[0], "maximum": p.span[1]}
    )
    allowed = f"{span_text(p)}; default {format_quantity(p.default, p.unit)}"
    unit = "no unit" if p.unit == "-" else f"SI unit {p.unit}"
    return kind | {
        "description": f"{docs}; {unit}; {allowed}",
        "default": float(p.default) if p.unit == "-" else format_quantity(p.default, p.unit),
    }


def _schema_of_section(kinds: Mapping[str, type]) -> dict[str, Any]:
    own = {p.name: _schema_of([p]) for cls in kinds.values() for p in structs.parameters(cls)}
    if "recorded" in kinds:
        own |= {name: {"type": "string"} for name in RECORDING_KEYS if name != "kind"}
    return {
        "type": "object",
        "properties": {"kind": {"enum": list(kinds)}} | own,
        "additionalProperties": False,
    }


def _schema_of_controller() -> dict[str, Any]:
    """As of any section, but a kind may also be a class of the user, whose parameters are not known here."""
    section = _schema_of_section(KINDS["controller"])
    of_user = {"type": "string", "pattern": CLASS_IN_FILE}
    known = {"properties": {"kind": {"enum": list(KINDS["controller"])}}}
    section["properties"]["kind"] = {"anyOf": [section["properties"]["kind"], of_user]}
    section["additionalProperties"] = {"$ref": "#/$defs/quantity"}
    return section | {"if": known, "then": {"propertyNames": {"enum": list(section["properties"])}}}
