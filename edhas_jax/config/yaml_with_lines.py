"""YAML text as plain data together with the line of every key, so that messages can name the line."""

import itertools
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from edhas_jax.core.regular_file import read_regular_file
from edhas_jax.machine.rigs import RIGS

MAX_BYTES = 250_000_000  # of a file; the samples of a recording may be among them
MAX_VALUES, MAX_DEPTH = 20_000, 50  # of a file: keys and values, levels of nesting
NOT_TEXT = re.compile("[\x00\ud800-\udfff]")  # from escapes such as "\\0"; no file name may hold them
_WHOLE_NUMBER = re.compile(r"[+-]?\d+")
FAST_FROM = 100_000  # characters; the fast parser has other words for syntax errors
KeyPath = tuple[str | int, ...]  # keys and list indices from the top of the file, such as ("effects", 0)


class YamlError(ValueError):
    """A text is not a YAML mapping; `line` is 0 when no single line is the cause."""

    def __init__(self, line: int, message: str):
        super().__init__(message)
        self.line = line


def parse_yaml(
    text: str, example: str = "rig: pump_bench"
) -> tuple[dict[str, Any], dict[KeyPath, int], list[tuple[int, str]]]:
    """Parse a YAML text.

    Args:
        text: the text.
        example: keys with their values that such a text has, such as "base: a.yaml, sweep: …", for messages.

    Returns:
        The data, with scalars as text, bool or None; the line (from 1) of every key; as line and message, keys that are
        given twice and numbers with a decimal comma, of which braces and brackets make two values.

    Raises:
        YamlError: the text is not valid YAML, has aliases, is too large or too deep, or is not a mapping.
    """
    loader = yaml.SafeLoader if len(text) < FAST_FROM else getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        _check_size(yaml.parse(text, Loader=loader))
        node = yaml.compose(text, Loader=loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        problem, message = error.problem or "", f"not YAML: {error.problem}"
        if "nesting depth" in problem:  # of PyYAML from 6.0.4 on, before all events are read
            message = f"nested too deeply; at most {MAX_DEPTH} levels"
        elif "'\\t'" in problem:
            message = "a tab; indent with spaces"
        raise YamlError(mark.line + 1 if mark else 0, message) from None
    except yaml.reader.ReaderError as error:
        line = text[: error.position].count("\n") + 1
        message = f"not YAML: this line contains a control character (code {error.character:#04x})"
        raise YamlError(line, message) from None
    except RecursionError:
        raise YamlError(0, "not YAML: nested too deeply") from None
    if node is None:
        rigs = f", one of {', '.join(RIGS)}" if example.startswith("rig:") else ""
        keys = [f"`{part.partition(' ')[0]}`" for part in example.split(", ")]
        needed = f"{' and '.join(keys)} {'is' if len(keys) == 1 else 'are'} needed"
        raise YamlError(0, f"is empty; at least {needed}{rigs}")
    if not isinstance(node, yaml.MappingNode):
        kind = "a list" if isinstance(node, yaml.SequenceNode) else "a text"
        message = f"a mapping with keys such as `{example}` is needed, not {kind}"
        raise YamlError(node.start_mark.line + 1, message)
    lines: dict[KeyPath, int] = {(): 1}
    problems: list[tuple[int, str]] = []
    return _convert(node, (), lines, problems), lines, problems


def _check_size(events: Iterator[yaml.Event]) -> None:
    """Refuse aliases, and a text that is larger or deeper than any configuration; nothing is kept of what is read."""
    depth = values = 0
    for event in events:
        line = event.start_mark.line + 1
        if isinstance(event, yaml.AliasEvent):
            raise YamlError(line, f"an alias (*{event.anchor}) is not supported; write the value again")
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        values += isinstance(event, yaml.NodeEvent)
        if isinstance(event, yaml.ScalarEvent) and (character := NOT_TEXT.search(event.value)):
            raise YamlError(line, f"the character of code {ord(character[0]):#04x} is no part of a text or name")
        if depth > MAX_DEPTH:
            raise YamlError(line, f"nested too deeply; at most {MAX_DEPTH} levels")
        if values > MAX_VALUES:
            raise YamlError(line, f"too large; at most {MAX_VALUES:,} keys and values")


def _convert(node: yaml.Node, key: KeyPath, lines: dict[KeyPath, int], problems: list[tuple[int, str]]) -> Any:
    """The data of one node; adds the lines of its keys to `lines`, repeated keys and decimal commas to `problems`."""
    if isinstance(node, yaml.ScalarNode):
        if node.tag == "tag:yaml.org,2002:bool":
            return node.value.lower() in ("true", "yes", "on")
        return None if node.tag == "tag:yaml.org,2002:null" else node.value
    if isinstance(node, yaml.SequenceNode):
        lines |= {(*key, i): item.start_mark.line + 1 for i, item in enumerate(node.value)}
        for i, (first, second) in enumerate(itertools.pairwise(node.value)):
            if (number := _cut_number(first, second)) and not second.value.replace(".", "").isdecimal():
                message = f'{key_text((*key, i))}: "{number}" in brackets is two values; write '
                message += f"{number.replace(',', '.', 1)} if it is one, or a unit with each"
                problems.append((lines[*key, i], message))
        return [_convert(item, (*key, i), lines, problems) for i, item in enumerate(node.value)]
    data: dict[str, Any] = {}
    last_name, last_value = "", None
    for name_node, value in node.value:
        line = name_node.start_mark.line + 1
        if (number := _cut_number(last_value, name_node)) and isinstance(value, yaml.ScalarNode) and not value.value:
            corrected = number.replace(",", ".", 1)
            message = f'{key_text((*key, last_name))}: "{number}" has a decimal comma; write "{corrected}"'
            problems.append((line, message))
            data[last_name] = corrected  # one problem is enough
            continue
        name = name_node.value if isinstance(name_node, yaml.ScalarNode) else "?"
        inner = (*key, name)
        if name in data:
            problems.append((line, f"{key_text(inner)}: given twice, first in line {lines[inner]}"))
            continue
        lines[inner] = line
        data[name] = _convert(value, inner, lines, problems)
        last_name, last_value = name, value
    return data


def _cut_number(first: yaml.Node | None, second: yaml.Node) -> str:
    """The number with a decimal comma, and its unit, of which YAML has made two plain values; empty for any others."""
    if not (isinstance(first, yaml.ScalarNode) and isinstance(second, yaml.ScalarNode)):
        return ""
    adjacent = second.start_mark.index == first.end_mark.index + 1
    numbers = _WHOLE_NUMBER.fullmatch(first.value) and second.value[:1].isdecimal()
    return f"{first.value},{second.value}" if adjacent and numbers and not (first.style or second.style) else ""


def read_text_file(path: Path, error: type[Exception]) -> str:
    """Read a text file in UTF-8, with or without byte order mark.

    Args:
        path: the file.
        error: the exception to raise.

    Raises:
        error: the file does not exist, cannot be read, or is not text in UTF-8.
    """
    try:
        return read_regular_file(path, MAX_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        byte = problem.object[problem.start]
        raise error(f"{path}: is not a text file in UTF-8 (byte {byte:#x}); a YAML file is needed") from None
    except OSError as problem:
        reason = {FileNotFoundError: "no such file", IsADirectoryError: "is a folder, not a file"}
        raise error(f"{path}: {reason.get(type(problem), problem.strerror)}") from None


def line_of(lines: Mapping[KeyPath, int], key: KeyPath) -> int:
    """The line of a key; for a missing key that of the enclosing mapping, for an override one after all lines."""
    if str(key[0]).startswith("--set"):
        return sys.maxsize
    return next(lines[key[:n]] for n in range(len(key), -1, -1) if key[:n] in lines)


def key_text(key: KeyPath) -> str:
    """A key as messages show it: `effects[0]`, `parameters.mover_mass`."""
    return "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in key).removeprefix(".")


def yaml_type(value: Any) -> str:
    """The YAML type of a value with its article: "a text", "a list", "nothing"."""
    if value is None:
        return "nothing"
    names = {bool: "a yes/no value", str: "a text", dict: "a mapping", list: "a list"}
    names |= dict.fromkeys((int, float), "a number")
    return names.get(type(value), type(value).__name__)
