"""Configurations of one machine: YAML text with units, read and checked as a whole.

A `ConfigError` lists every independent problem, one line each: file, line, dotted key, what is wrong and what is
allowed.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from edhas_jax.config.document import Document
from edhas_jax.config.machine_keys import machine_keys
from edhas_jax.config.machine_reader import MachineReader
from edhas_jax.config.writer import dump_config
from edhas_jax.config.yaml_with_lines import yaml_type
from edhas_jax.core.trusted_code import Trust
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.run import Simulation


class ConfigError(ValueError):
    """A configuration is wrong; the message has one line per problem."""


@dataclasses.dataclass(frozen=True)
class Config:
    """A machine with the settings of its run, as read from a configuration.

    Attributes:
        machine: the machine with its effects and parameters.
        simulation: settings of the run.
        name: the name given in the configuration; empty without one.
        path: the file that was read; None for a configuration from a mapping.
        text: the YAML text.
        recordings: for each section with a recorded input (`reference`, `target`) its keys, such as file (absolute
            path), column and unit.
    """

    machine: Rig
    simulation: Simulation = Simulation()
    name: str = ""
    path: Path | None = None
    text: str = ""
    recordings: Mapping[str, Mapping[str, str]] = dataclasses.field(default_factory=dict)


def read_config(
    path: Path | str,
    overrides: Sequence[str] = (),
    trust: Trust = (),
    is_result: bool = False,
) -> Config:
    """Read a configuration from a YAML file.

    Args:
        path: the file; effects and recordings named in it are relative to its folder.
        overrides: changes such as "piston_clearance=15 um" or "duration=2 s" that replace values of the file.
        trust: Python files (or modules) of your own that may run if the configuration names them, besides those that
            were allowed by `edhas trust`.
        is_result: whether the file belongs to a result; code that may not run is then left out of the machine.

    Returns:
        The machine and the settings of its run.

    Raises:
        ConfigError: the file cannot be read, or the file or an override has problems; all are listed.
    """
    path = Path(path)
    document = Document(path, ConfigError, "rig: pump_bench")
    reader = MachineReader(document.top, path.parent, overrides, trust, is_result)
    document.finish()
    return Config(reader.machine, reader.simulation, reader.name, path, document.text, reader.recordings)


def build_config(
    mapping: Mapping[str, Any],
    overrides: Sequence[str] = (),
    base_dir: Path | str = ".",
    trust: Trust = (),
) -> Config:
    """Make a configuration from a Python mapping with the same keys as a file.

    Args:
        mapping: keys and values as in a YAML file; quantities as text with unit.
        overrides: changes such as "piston_clearance=15 um" that replace values of the mapping.
        base_dir: folder to which files of effects and recordings are relative.
        trust: as for `read_config`; a class in place of its name needs none.

    Returns:
        The machine and the settings of its run.

    Raises:
        ConfigError: the mapping or an override has problems; all are listed.
    """
    if not isinstance(mapping, Mapping):
        keys = ", ".join(machine_keys().keys)
        raise ConfigError(f"a mapping with the keys {keys} is needed, not {yaml_type(mapping)}")
    document = Document(mapping, ConfigError, "rig: pump_bench")
    reader = MachineReader(document.top, Path(base_dir), overrides, trust)
    document.finish()
    config = Config(reader.machine, reader.simulation, reader.name, recordings=reader.recordings)
    return dataclasses.replace(config, text=dump_config(config))


def as_config(source: "Rig | Config | Mapping[str, Any] | Path | str", trust: Trust = ()) -> Config:
    """A configuration, whatever describes it: a machine, a configuration, a mapping as in a file, or a file.

    Raises:
        ConfigError: the file or the mapping has problems (all are listed), or it is nothing of these.
    """
    if isinstance(source, Config):
        return source
    if isinstance(source, str | Path):
        return read_config(source, trust=trust)
    if isinstance(source, Mapping):
        return build_config(source, trust=trust)
    if not isinstance(source, Rig):
        raise ConfigError(f"a machine, a configuration or its file belongs here, not {type(source).__name__}")
    return Config(source)
