"""Configurations: YAML text with units ↔ a machine and the settings of a run.

A configuration is checked as a whole: one `ConfigError` tells every independent problem, each in one line with file,
line, dotted key, what is wrong and what is allowed.
"""

import dataclasses
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from edhas_jax.config.machine_reader import TOP_LEVEL_KEYS, MachineReader
from edhas_jax.config.writer import dump_config
from edhas_jax.config.yaml_with_lines import YamlError, key_text, line_of, parse_yaml, yaml_type
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.run import Simulation


class ConfigError(ValueError):
    """A configuration is wrong; the text has one line per problem."""


@dataclasses.dataclass(frozen=True)
class Config:
    """A machine, the settings of its run, and where they come from.

    `recordings` holds the keys (file, absolute, column, unit) of the inputs that were read from files, by section.
    """

    machine: Rig
    simulation: Simulation = Simulation()
    name: str = ""
    path: Path | None = None
    text: str = ""
    recordings: Mapping[str, Mapping[str, str]] = dataclasses.field(default_factory=dict)


def read_config(path: Path | str, overrides: Sequence[str] = ()) -> Config:
    """The configuration in a YAML file, with `overrides` such as "piston_clearance=15 um" or "duration=2 s" on top.

    Raises:
        ConfigError: every problem of the file and of the overrides.
    """
    path = Path(path)
    text = _text(path)
    try:
        data, lines, problems = parse_yaml(text)
    except YamlError as error:
        raise ConfigError(f"{_place(path, error.line)}: {error}") from None
    reader = MachineReader(data, path.parent, overrides)
    problems += [(line_of(lines, key), f"{key_text(key)}: {what}") for key, what in reader.problems]
    if problems:
        problems.sort(key=lambda problem: problem[0])
        raise ConfigError("\n".join(dict.fromkeys(f"{_place(path, line)}: {what}" for line, what in problems)))
    return Config(reader.machine, reader.simulation, reader.name, path, text, reader.recordings)


def build_config(mapping: Mapping[str, Any], overrides: Sequence[str] = (), base_dir: Path | str = ".") -> Config:
    """The configuration in a Python mapping of the same form; files are looked up from `base_dir`.

    Raises:
        ConfigError: every problem.
    """
    if not isinstance(mapping, Mapping):
        raise ConfigError(f"a mapping with the keys {', '.join(TOP_LEVEL_KEYS)} is needed, not {yaml_type(mapping)}")
    reader = MachineReader(mapping, Path(base_dir), overrides)
    if reader.problems:
        raise ConfigError("\n".join(dict.fromkeys(f"{key_text(key)}: {what}" for key, what in reader.problems)))
    config = Config(reader.machine, reader.simulation, reader.name, recordings=reader.recordings)
    return dataclasses.replace(config, text=dump_config(config))


def _text(path: Path) -> str:
    try:
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        byte = error.object[error.start]
        raise ConfigError(f"{path}: is not a text file in UTF-8 (byte {byte:#x}); a YAML file is needed") from None
    except OSError as error:
        reason = {FileNotFoundError: "no such file", IsADirectoryError: "is a folder, not a file"}
        raise ConfigError(f"{path}: {reason.get(type(error), error.strerror)}") from None


def _place(path: Path, line: int) -> str:
    return f"{path}:{line}" if 0 < line < sys.maxsize else str(path)
