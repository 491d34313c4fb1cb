"""Writes a machine and the settings of its run as YAML text with every parameter."""

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from edhas_jax.config.code_not_run import require_code
from edhas_jax.config.law_file import law_text
from edhas_jax.config.recorded_signal import encode_samples
from edhas_jax.config.run_settings import SIMULATION_SETTINGS
from edhas_jax.core.literal_text import one_line, yaml_text
from edhas_jax.core.units import exact_quantity, to_si
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.effects.loading import class_spec, effect_spec
from edhas_jax.machine.effects.tabulated_law import table_of
from edhas_jax.machine.parameters import component_kinds, list_parameters, short_names
from edhas_jax.machine.rigs import RIGS, Rig, components_by_name
from edhas_jax.simulation.run import Simulation


def dump_config(
    config: Any, simulation: Simulation | None = None, law_files: Mapping[str, str] = MappingProxyType({})
) -> str:
    """Write a configuration as YAML text from which `read_config` makes the same machine and settings.

    Files of effects and recordings are named by their absolute paths. A recorded input whose file is not known (a
    machine without `Config` does not know it) is written as its samples.

    Args:
        config: a `Config` or a machine.
        simulation: settings of the run; by default those of the `Config`, or default settings for a machine.
        law_files: files of tabulated laws by effect id, relative to where the configuration will be; a law without one
            is written as its numbers.

    Returns:
        YAML text; every value carries its unit.

    Raises:
        EffectError: the machine comes from a result that was opened without running the user's code.
    """
    if isinstance(config, Rig):
        m, settings, title, recordings = config, simulation or Simulation(), "", {}
    else:
        m, settings = config.machine, simulation or config.simulation
        title, recordings = config.name, config.recordings
    require_code(m)
    settings = dataclasses.replace(settings, sample_rate=settings.rate(m))
    lines = [f"name: {yaml_text(title)}"] if title else []
    lines += [f"rig: {rig_text(m)}", f"effects: [{', '.join(_effect_text(e, law_files.get(e.id)) for e in m.effects)}]"]
    in_tables = {e.id for e in m.effects if table_of(e) is not None}
    rows = list_parameters(m)
    names = short_names(m)
    sections = component_kinds(m)
    for section in sections:
        component = getattr(m, section)
        lines += [f"{section}:", f"  kind: {yaml_text(config_kind(m, section))}"]
        if isinstance(component, Recorded):
            keys = recordings.get(section, {})
            keys = encode_samples(component) if "file" not in keys else {k: v for k, v in keys.items() if k != "kind"}
            lines += [f"  {k}: {yaml_text(v)}" for k, v in keys.items()]
        own = [(p, v) for p, v, path in rows if path == section]
        lines += [f"  {p.name}: {exact_quantity(v, p.unit)}  # {one_line(p.doc)}" for p, v in own]
    lines.append("parameters:")
    for path in (path for path in components_by_name(m) if path not in in_tables):
        own = [(p, v) for p, v, owner_path in rows if owner_path == path and path not in sections]
        lines += [f"  # {path}"] if own else []
        for p, v in own:
            lines.append(f"  {names[path, p.name]}: {exact_quantity(v, p.unit)}  # {one_line(p.doc)}")
    lines.append("simulation:")
    for name, p in SIMULATION_SETTINGS.items():
        value = getattr(settings, name)
        if value is not None:
            text = exact_quantity(value, p.unit) if name != "accuracy" else _percent(value)
            lines.append(f"  {name}: {text}")
    return "\n".join([*lines, f"  precision: {settings.precision.value}", ""])


def config_kind(machine: Rig, section: str) -> str:
    """The value of the key `kind` that selects the component of a section; a user's controller is file.py:ClassName."""
    component, kinds = getattr(machine, section), component_kinds(machine)[section]
    built_in = next((kind for kind, cls in kinds.items() if isinstance(component, cls)), None)
    return built_in or class_spec(type(component))


def rig_text(machine: Rig) -> str:
    """The value of the key `rig`: a rig of the package by its name, one's own as file.py:ClassName."""
    return machine.name if type(machine) in RIGS.values() else yaml_text(class_spec(type(machine)))


def _effect_text(effect: Effect, law_file: str | None) -> str:
    """The entry of `effects` from which the effect is made again; a tabulated law without a file stands there whole."""
    table = table_of(effect)
    if table is not None and law_file is not None:
        return yaml_text(law_file)
    return yaml_text(effect_spec(type(effect))) if table is None else law_text(table)


def _percent(value: float) -> str:
    """A share in percent if that text reads back as the same number, else the number itself."""
    text = f"{100.0 * value:.12g} %"
    return text if to_si(text, "-") == value else repr(value)
