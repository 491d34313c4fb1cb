"""The keys of a machine's configuration: sections and parameters follow from the declarations of its components."""

import functools
from collections.abc import Mapping
from typing import Any

from edhas_jax.config.declared_keys import (
    QUANTITY,
    Key,
    Keys,
    Schema,
    by_name,
    list_of,
    own_value,
    quantity,
    text_value,
)
from edhas_jax.config.law_file import LAW
from edhas_jax.config.recorded_signal import RECORDING
from edhas_jax.config.run_settings import simulation_keys
from edhas_jax.core import structs
from edhas_jax.core.structs import Parameter
from edhas_jax.core.units import format_quantity
from edhas_jax.machine.components.coil_and_amplifier import CurrentAmplifier
from edhas_jax.machine.components.controllers import CascadeController, PositionController
from edhas_jax.machine.components.set_points import Step
from edhas_jax.machine.effects import LIBRARY
from edhas_jax.machine.parameters import COMPONENT_KINDS, SET_POINTS
from edhas_jax.machine.rig_base import Rig
from edhas_jax.machine.rigs import RIGS, USUAL_EFFECTS, components_by_name

SHORT_NAMES: Mapping[type, Mapping[str, str]] = {  # further names of parameters in the section of a component
    Step: {"from": "step_from"},
    CurrentAmplifier: {"gain": "amplifier_gain"},
    CascadeController: {"kp": "cascade_position_gain", "kv": "cascade_velocity_gain"},
    PositionController: {
        "kp": "position_gain", "ki": "integral_gain", "kd": "velocity_gain", "kaw": "antiwindup_gain",
        "kff": "emf_feedforward",
    },
}  # fmt: skip
USER_CLASS = {"type": "string", "pattern": r"^.+:\s*[A-Za-z_]\w*\s*$"}  # file.py:ClassName
LAW_FILE = {"type": "string", "pattern": r"^.+\.ya?ml$"}


@functools.lru_cache(maxsize=8)
def machine_keys(rig: type[Rig] = Rig) -> Keys:
    """The keys of a configuration of a rig; those of the package are the keys of every rig."""
    kinds = dict.fromkeys(rig.drives, SET_POINTS) | COMPONENT_KINDS
    effects = [{"enum": [cls.id for cls in LIBRARY]}, USER_CLASS, LAW_FILE, LAW.schema()]
    usual = [cls.id for cls in USUAL_EFFECTS]
    return Keys({
        "name": Key(text_value(), "name of the configuration", ""),
        "rig": Key(own_value({"anyOf": [{"enum": list(RIGS)}, USER_CLASS]}, ", ".join(f"`{name}`" for name in RIGS)),
                   "machine to simulate; your own as file.py:ClassName", needed=True),
        "effects": Key(list_of(own_value({"anyOf": effects}), "[lugre_friction]"),
                       "effects of the library, your own as file.py:ClassName, or tabulated laws (curve.yaml)"),
        "without": Key(list_of(own_value({"enum": usual}), "[lugre_friction]"),
                       f"if given, the machine has the refined effects ({', '.join(usual)}) that suit its rig, except "
                       "those listed here, beside `effects`"),
        "parameters": Key(by_name(own_value(QUANTITY), "{frequency: 20 Hz}", "parameter"),
                          "any parameter of the machine or of its effects, by name or owner.name"),
        **{name: Key(own_value(_section_schema(name, of), ", ".join(f"`{kind}`" for kind in of)),
                     f"which {name} the machine has; with parameters: a mapping with `kind`")
           for name, of in kinds.items()},
        "simulation": Key(simulation_keys(rig).kind, "duration, time step and output of a run"),
    })  # fmt: skip


def machine_schema() -> Schema:
    """The JSON schema of the configuration of a machine, with a description of every parameter."""
    keys = machine_keys()
    schema = keys.schema("edhas_jax configuration")
    by_name: dict[str, list[Parameter]] = {}  # several owners may declare the same name
    owners = dict.fromkeys(type(part) for rig in RIGS.values() for part in components_by_name(rig()).values())
    owners |= dict.fromkeys((*(cls for kinds in COMPONENT_KINDS.values() for cls in kinds.values()), *LIBRARY))
    for owner in owners:
        for p in structs.parameters(owner):
            by_name.setdefault(p.name, []).append(p)
    schema["properties"]["parameters"]["properties"] = {name: _schema_of(ps) for name, ps in sorted(by_name.items())}
    # a rig of one's own has a section for each of its drives
    schema["additionalProperties"] = True
    schema["properties"]["simulation"]["not"] = {"required": ["step", "accuracy"]}
    built_in = {"properties": {"rig": {"enum": list(RIGS)}}}
    return schema | {"if": built_in, "then": {"propertyNames": {"enum": list(keys.keys)}}}


def _schema_of(same_name: list[Parameter]) -> Schema:
    """The schema of one parameter, described for every owner that declares one of this name."""
    p = same_name[0]
    meaning = p.doc
    if len(same_name) > 1:
        meaning = " / ".join(f"{structs.owner_id(q.owner)}: {q.doc}" for q in same_name)
    unit = "no unit" if p.unit == "-" else f"SI unit {p.unit}"
    default = format_quantity(p.default, p.unit)
    about = f"{meaning}; {unit}; {quantity(p).allowed}; default {default}"
    return quantity(p).schema | {"description": about, "default": float(p.default) if p.unit == "-" else default}


def _section_schema(section: str, kinds: Mapping[str, type]) -> Schema:
    """The schema of a section that selects a component by `kind` and sets its parameters."""
    keys: dict[str, Any] = {"kind": {"enum": list(kinds)}}
    for cls in kinds.values():
        of_cls = {p.name: _schema_of([p]) for p in structs.parameters(cls)}
        keys |= of_cls | {short: of_cls[name] for short, name in SHORT_NAMES.get(cls, {}).items()}
    if "recorded" in kinds:
        keys |= {n: form for n, form in RECORDING.schema()["properties"].items() if n != "kind"}
    schema = {"type": "object", "properties": keys, "additionalProperties": False}
    if section == "target":
        return {"anyOf": [QUANTITY, schema]}
    if section != "controller":
        return schema
    built_in = {"properties": {"kind": keys["kind"]}}  # a class of the user may have any further parameters
    keys = keys | {"kind": {"anyOf": [keys["kind"], USER_CLASS]}}
    schema |= {"properties": keys, "additionalProperties": QUANTITY}
    return schema | {"if": built_in, "then": {"propertyNames": {"enum": list(keys)}}}
