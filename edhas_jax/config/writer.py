"""A configuration as YAML text in which every parameter is written out."""

import json
from typing import Any

from edhas_jax.config.recorded_signal import encode_samples
from edhas_jax.config.run_settings import SIMULATION_SETTINGS
from edhas_jax.core.units import exact_quantity, to_si
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.machine.effects.loading import effect_spec, user_spec
from edhas_jax.machine.parameters import KINDS, list_parameters, short_names
from edhas_jax.machine.rigs import Rig, parts
from edhas_jax.simulation.run import Simulation


def dump_config(config: Any, simulation: Simulation | None = None) -> str:
    """A `Config`, or a bare machine with the settings of its run, as YAML text that `read_config` reads back.

    Files of effects and recordings are named by their absolute path. A recorded input whose file is not known (a bare
    machine does not know it) is written as its samples.
    """
    if isinstance(config, Rig):
        m, settings, title, recordings = config, simulation or Simulation(), "", {}
    else:
        m, settings = config.machine, simulation or config.simulation
        title, recordings = config.name, config.recordings
    lines = [f"name: {json.dumps(title, ensure_ascii=False)}"] if title else []
    lines += [f"rig: {m.name}", f"effects: [{', '.join(_scalar(effect_spec(type(e))) for e in m.effects)}]"]
    rows = list_parameters(m)
    names = short_names(m)
    for section in (s for s in KINDS if hasattr(m, s)):
        part = getattr(m, section)
        lines += [f"{section}:", f"  kind: {_scalar(config_kind(section, part))}"]
        if isinstance(part, Recorded):
            keys = recordings.get(section, {})
            keys = encode_samples(part) if "file" not in keys else {k: v for k, v in keys.items() if k != "kind"}
            lines += [f"  {k}: {json.dumps(v, ensure_ascii=False)}" for k, v in keys.items()]
        lines += [f"  {p.name}: {exact_quantity(v, p.unit)}  # {p.doc}" for p, v, path in rows if path == section]
    lines.append("parameters:")
    for path in parts(m):
        own = [(p, v) for p, v, at in rows if at == path and path not in KINDS]
        lines += [f"  # {path}"] if own else []
        for p, v in own:
            lines.append(f"  {names[path, p.name]}: {exact_quantity(v, p.unit)}  # {p.doc}")
    lines.append("simulation:")
    for name, p in SIMULATION_SETTINGS.items():
        value = getattr(settings, name)
        if value is not None:
            text = exact_quantity(value, p.unit) if name != "accuracy" else _percent(value)
            lines.append(f"  {name}: {text}")
    return "\n".join([*lines, f"  precision: {settings.precision.value}", ""])


def config_kind(section: str, part: Any) -> str:
    """The name by which a configuration calls what is mounted in a section; a controller of the user by its file."""
    return next((kind for kind, cls in KINDS[section].items() if isinstance(part, cls)), None) or user_spec(type(part))


def _scalar(text: str) -> str:
    return text if text.replace("_", "").isalnum() else json.dumps(text, ensure_ascii=False)


def _percent(value: float) -> str:
    text = f"{100.0 * value:.12g} %"
    return text if to_si(text, "-") == value else repr(value)
