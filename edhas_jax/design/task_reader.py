"""Reader shared by sizing and sensitivity tasks: machine, batch settings, parameter ranges and operating points."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from edhas_jax.config.machine_config import ConfigError
from edhas_jax.config.problem_list import ProblemList, problem_lines
from edhas_jax.config.yaml_with_lines import (
    KeyPath,
    YamlError,
    key_text,
    line_of,
    parse_yaml,
    read_text_file,
    yaml_type,
)
from edhas_jax.core.trusted_code import Trust, TrustedCode
from edhas_jax.design.batch.batch import runs_designs
from edhas_jax.design.batch.experiment_design import Axis
from edhas_jax.design.sweep.axes_reader import AxesReader
from edhas_jax.design.sweep.config import SweepReader

COMMON_SECTIONS = ("name", "base", "machine", "parameters", "batch")
_SWEEP_PARAMETERS = ("sweep", "parameters")


class TaskReader(ProblemList):
    """Reads the common sections of a task's file; its attributes are valid only after `finish`.

    Attributes:
        path: the file; "." for a mapping.
        text: its content.
        data: the same as a mapping.
        machine: the machine; None if it has problems.
        settings: settings of the batch.
        axes: the parameters with a range.
        name: title of the task.
    """

    def __init__(
        self,
        source: Path | str | Mapping[str, Any],
        sections: tuple[str, ...],
        ranges: str,
        optional: bool = False,
        trust: Trust = (),
        machine_file: str = "machine.yaml",
    ):
        """Read a file; problems are collected until `finish`.

        Args:
            source: the YAML file, or a mapping with the same keys and texts, whose machine may be a machine.
            sections: the sections that this kind of task has besides the common ones.
            ranges: the section of the parameters that have a range.
            optional: whether that section may be missing.
            trust: the user's code that may run.
            machine_file: where the folder of the result has the machine of a mapping.

        Raises:
            ConfigError: the file cannot be read, or is not YAML.
        """
        super().__init__([])
        self._lines, self._yaml_problems = None, []
        if isinstance(source, Mapping):
            self.path, self.data, self.text = Path("."), dict(source), _task_text(source, machine_file)
        else:
            self._read_file(Path(source))
        self.add_unknown_keys((), self.data, (*COMMON_SECTIONS, *sections))
        # the task is read as a sweep of one design with the same machine, settings and ranges
        sweep = {"kind": "sobol", "count": "1", "parameters": self.data.get(ranges)}
        common = {n: self.data[n] for n in COMMON_SECTIONS if n in self.data}
        reader = SweepReader(common | {"sweep": sweep}, self.path, TrustedCode.of(trust))
        may_miss = optional and ranges not in self.data
        self.problems += [
            (_with_section(key, ranges), what)
            for key, what in reader.problems
            if not (may_miss and key == _SWEEP_PARAMETERS)
        ]
        self._base_problems = reader.base_problems
        self.machine, self.settings, self.axes, self.name = reader.machine, reader.settings, reader.axes, reader.name
        for axis in self.axes:
            if axis.values:
                self.add((ranges, axis.name), "a range {from: …, to: …} belongs here, not a list")
        m = self.machine
        if m is not None and not runs_designs(m):
            key = ("base" if "base" in self.data else "machine",)
            self.add(key, f"a bench that is driven by a sine is needed; this is {m.name}")

    def _read_file(self, path: Path) -> None:
        self.path, self.text = path, read_text_file(path, ConfigError)
        try:
            self.data, self._lines, self._yaml_problems = parse_yaml(self.text)
        except YamlError as error:
            raise ConfigError(f"{path}:{error.line}: {error}" if error.line else f"{path}: {error}") from None

    def section(self, name: str, example: str) -> Mapping[str, Any]:
        """A section that is a mapping; empty if it is missing."""
        value = self.data.get(name)
        if value is None or isinstance(value, Mapping):
            return value or {}
        self.add((name,), f"a mapping belongs here, for example `{name}: {example}`, not {yaml_type(value)}")
        return {}

    def list_section(self, name: str) -> list[Any]:
        """A section that is a list; empty if it is missing."""
        value = self.data.get(name)
        if value is None or isinstance(value, list):
            return value or []
        self.add((name,), f"a list belongs here, not {yaml_type(value)}")
        return []

    def operating_points(self, name: str) -> tuple[Axis, ...]:
        """The axes of the operating points in a section: parameters with lists of values, or ranges with a count."""
        if not self.data.get(name):
            return ()
        problems: list[tuple[KeyPath, str]] = []
        axes = AxesReader(self.machine, "grid", problems).read(self.data[name])
        self.problems += [(_with_section(key, name), what) for key, what in problems]
        return axes

    def finish(self) -> None:
        """Raise all problems at once.

        Raises:
            ConfigError: every problem of the file, one line each.
        """
        if self._lines is None:
            if messages := [f"{key_text(key)}: {what}" for key, what in self.problems] + list(self._base_problems):
                raise ConfigError(problem_lines(messages))
            return
        problems = [(line_of(self._lines, key), f"{key_text(key)}: {what}") for key, what in self.problems]
        problems = sorted(self._yaml_problems + problems, key=lambda p: p[0])
        messages = [f"{self.path}:{line}: {what}" for line, what in problems]
        if messages or self._base_problems:
            raise ConfigError(problem_lines([*messages, *self._base_problems]))


def _task_text(task: Mapping[str, Any], machine_file: str) -> str:
    """A task that was given as a mapping as the text of a file beside that of its machine."""
    rows = {n: v for n, v in task.items() if n != "machine" and v not in ({}, [], None)}
    return yaml.safe_dump({"base": machine_file} | rows, sort_keys=False, allow_unicode=True)


def _with_section(key: KeyPath, section: str) -> KeyPath:
    """The key of a sweep's parameter as it stands in a task's own section."""
    return (section, *key[2:]) if key[:2] == _SWEEP_PARAMETERS else key
