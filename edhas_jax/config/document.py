"""A YAML file, or a mapping with the same keys, as entries that know their key; all its problems are raised at once."""

import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from edhas_jax.config.yaml_with_lines import (
    KeyPath,
    YamlError,
    key_text,
    line_of,
    parse_yaml,
    read_text_file,
    yaml_type,
)

MAX_LISTED = 50  # problems of one file
Problem = tuple[KeyPath, str]


def problem_lines(messages: Iterable[str]) -> str:
    """All problems of a file as one text, a line each, every one once; at most `MAX_LISTED` of them."""
    lines = list(dict.fromkeys(messages))
    more = len(lines) - MAX_LISTED
    return "\n".join([*lines[:MAX_LISTED], *([f"and {more:,} more problems like these"] if more > 0 else [])])


def problem_text(key: KeyPath, message: str) -> str:
    """A problem with its key, which the file as a whole has not."""
    return f"{key_text(key)}: {message}" if key else message


class Entry:
    """A value of a file with its key, and the problems that are found in the file.

    Args:
        value: plain data; None where the file does not have it.
        key: the keys from the top of the file.
        problems: key and message of each problem; shared by all entries of a file.
    """

    def __init__(self, value: Any, key: KeyPath = (), problems: list[Problem] | None = None):
        self.value, self.key = value, key
        self.problems: list[Problem] = [] if problems is None else problems

    def add(self, message: str) -> None:
        """Add a problem of this entry."""
        self.problems.append((self.key, message))

    def __getitem__(self, name: str | int) -> "Entry":
        """The entry inside a mapping or list; its value is None where there is none."""
        inside = None
        if isinstance(self.value, Mapping if isinstance(name, str) else list | tuple):
            inside = self.value.get(name) if isinstance(name, str) else self.value[name]
        return Entry(inside, (*self.key, name), self.problems)

    def __contains__(self, name: str) -> bool:
        return isinstance(self.value, Mapping) and name in self.value

    def mapping(self, example: str) -> dict[str, "Entry"]:
        """The entries of a mapping; empty, and a problem unless the value is missing, for anything else."""
        if isinstance(self.value, Mapping):
            return {name: self[name] for name in self.value}
        if self.value is not None:
            shown = f"{self.key[-1]}: {example}" if self.key and isinstance(self.key[-1], str) else example
            self.add(f"a mapping belongs here, for example `{shown}`, not {yaml_type(self.value)}")
        return {}

    def list(self, example: str = "") -> "list[Entry]":
        """The entries of a list; empty, and a problem unless the value is missing, for anything else."""
        if isinstance(self.value, list | tuple):
            return [self[k] for k in range(len(self.value))]
        if self.value is not None:
            shown = f", for example `{self.key[-1]}: {example}`" if example else ""
            self.add(f"a list belongs here{shown}, not {yaml_type(self.value)}")
        return []


class Document:
    """A file, or a mapping with the same keys, whose problems are raised together.

    Attributes:
        path: the file; "." for a mapping.
        text: its content; empty for a mapping.
        top: the entry of the whole mapping.
    """

    def __init__(
        self, source: Path | str | Mapping[str, Any], error: type[Exception], example: str, shown: str | None = None
    ):
        """Read the file.

        Args:
            source: the file, or the mapping.
            error: the exception to raise.
            example: keys with their values that such a file has, for messages.
            shown: the file as messages name it; None: as it is given.

        Raises:
            error: the file cannot be read, or is not a mapping in YAML.
        """
        self._error, self._lines, self._problems, self.text = error, None, [], ""
        if isinstance(source, Mapping):
            self.path, self._shown, self.top = Path("."), "", Entry(source)
            return
        self.path = Path(source)
        self._shown = str(self.path) if shown is None else shown
        self.text = read_text_file(self.path, error)
        try:
            data, self._lines, self._problems = parse_yaml(self.text, example)
        except YamlError as problem:
            raise error(self._located(problem.line, str(problem))) from None
        self.top = Entry(data)

    def line(self, key: KeyPath) -> int:
        """The line of a key in the file."""
        return line_of(self._lines, key)

    def _located(self, line: int, message: str) -> str:
        """A message with file and line; the file alone where no line causes it (an override, or the whole text)."""
        return f"{self._shown}:{line}: {message}" if 0 < line < sys.maxsize else f"{self._shown}: {message}"

    def messages(self) -> list[str]:
        """The problems in the order of the file, with file, line and key."""
        if self._lines is None:
            return [problem_text(*problem) for problem in self.top.problems]
        found = [(self.line(key), problem_text(key, message)) for key, message in self.top.problems]
        found = sorted(self._problems + found, key=lambda problem: problem[0])
        return [self._located(*problem) for problem in found]

    def finish(self, others: Iterable[str] = ()) -> None:
        """Raise all problems at once, and those of `others`, which name their own file.

        Raises:
            error: there are problems; one line each.
        """
        if messages := [*self.messages(), *others]:
            raise self._error(problem_lines(messages))
