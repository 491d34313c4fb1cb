"""What configurations of tasks on a machine have in common: the machine they start from, settings, ranges, points."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from edhas_jax.config.machine_config import ConfigError
from edhas_jax.config.problem_list import ProblemList
from edhas_jax.config.yaml_with_lines import (
    KeyPath,
    YamlError,
    key_text,
    line_of,
    parse_yaml,
    read_text_file,
    yaml_type,
)
from edhas_jax.design.batch.design_table import Axis
from edhas_jax.design.sweep.axes_reader import AxesReader
from edhas_jax.design.sweep.config import SweepReader
from edhas_jax.machine.rigs import ActuatorSystem, Sine

COMMON = ("name", "base", "machine", "parameters", "batch")
_SWEEP = ("sweep", "parameters")


class TaskReader(ProblemList):
    """Reads a task's file; problems are gathered, and `finish` raises all of them at once.

    `ranges` is the section of the parameters that have a range; with `optional` it may be missing.
    """

    def __init__(self, path: Path | str, sections: tuple[str, ...], ranges: str, optional: bool = False):
        super().__init__([])
        self.path = Path(path)
        self.text = read_text_file(self.path, ConfigError)
        try:
            self.data, self._lines, self._twice = parse_yaml(self.text)
        except YamlError as error:
            raise ConfigError(f"{path}:{error.line}: {error}" if error.line else f"{path}: {error}") from None
        self.add_unknown_keys((), self.data, (*COMMON, *sections))
        # the sweep's reader knows machines, settings and ranges
        sweep = {"kind": "sobol", "count": "1", "parameters": self.data.get(ranges)}
        inner = SweepReader({n: self.data[n] for n in COMMON if n in self.data} | {"sweep": sweep}, self.path)
        without = optional and ranges not in self.data
        self.problems += [
            (_renamed(key, (ranges,)), what) for key, what in inner.problems if not (without and key == _SWEEP)
        ]
        self._elsewhere = inner.elsewhere
        self.machine, self.settings, self.axes, self.name = inner.machine, inner.settings, inner.axes, inner.name
        for axis in self.axes:
            if axis.values:
                self.add((ranges, axis.name), "a range {from: …, to: …} belongs here, not a list")
        m = self.machine
        if m is not None and (isinstance(m, ActuatorSystem) or not isinstance(m.reference, Sine)):
            key = ("base" if "base" in self.data else "machine",)
            self.add(key, f"a bench that is driven by a sine is needed; this is {m.name}")

    def section(self, name: str, example: str) -> Mapping[str, Any]:
        """A section that is a mapping; empty if it is missing."""
        value = self.data.get(name)
        if value is None or isinstance(value, Mapping):
            return value or {}
        self.add((name,), f"a mapping belongs here, for example `{name}: {example}`, not {yaml_type(value)}")
        return {}

    def listed(self, name: str) -> list[Any]:
        """A section that is a list; empty if it is missing."""
        value = self.data.get(name)
        if value is None or isinstance(value, list):
            return value or []
        self.add((name,), f"a list belongs here, not {yaml_type(value)}")
        return []

    def points(self, name: str) -> tuple[Axis, ...]:
        """The operating points in a section: parameters with lists of values, or ranges with a count."""
        if name not in self.data:
            return ()
        problems: list[tuple[KeyPath, str]] = []
        axes = AxesReader(self.machine, "grid", problems).read(self.data[name])
        self.problems += [(_renamed(key, (name,)), what) for key, what in problems]
        return axes

    def finish(self) -> None:
        """Raise what is wrong.

        Raises:
            ConfigError: every problem of the file, one line each.
        """
        problems = [(line_of(self._lines, key), f"{key_text(key)}: {what}") for key, what in self.problems]
        problems = self._twice + problems
        told = [f"{self.path}:{line}: {what}" for line, what in sorted(problems, key=lambda p: p[0])]
        if told or self._elsewhere:
            raise ConfigError("\n".join(dict.fromkeys([*told, *self._elsewhere])))


def _renamed(key: KeyPath, name: KeyPath) -> KeyPath:
    return (*name, *key[2:]) if key[:2] == _SWEEP else key
