"""YAML text as plain data, with the line of every key, so that a problem can be told where it is."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from edhas_jax.machine.rigs import RIGS

KeyPath = tuple[str | int, ...]


class YamlError(ValueError):
    """A text is no YAML mapping; `line` is 0 when no single line is to blame."""

    def __init__(self, line: int, what: str):
        super().__init__(what)
        self.line = line


def parse_yaml(text: str) -> tuple[dict[str, Any], dict[KeyPath, int], list[tuple[int, str]]]:
    """The data of a YAML text (scalars as text, bool or None), the line of every key, and keys that are given twice.

    Raises:
        YamlError: not YAML, or no mapping.
    """
    try:
        for event in yaml.parse(text, Loader=yaml.SafeLoader):
            if isinstance(event, yaml.AliasEvent):
                what = f"an alias (*{event.anchor}) is not supported; write the value again"
                raise YamlError(event.start_mark.line + 1, what)
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        what = "a tab; indent with spaces" if "'\\t'" in (error.problem or "") else f"not YAML: {error.problem}"
        raise YamlError(mark.line + 1 if mark else 0, what) from None
    except yaml.reader.ReaderError as error:
        line = text[: error.position].count("\n") + 1
        what = f"not YAML: a control character (code {error.character:#04x}) stands in this line"
        raise YamlError(line, what) from None
    except RecursionError:
        raise YamlError(0, "not YAML: nested too deeply") from None
    if node is None:
        raise YamlError(0, f"is empty; at least `rig:` is needed, one of {', '.join(RIGS)}")
    if not isinstance(node, yaml.MappingNode):
        kind = "a list" if isinstance(node, yaml.SequenceNode) else "a text"
        what = f"a mapping with keys such as `rig: pump_bench` is needed, not {kind}"
        raise YamlError(node.start_mark.line + 1, what)
    lines: dict[KeyPath, int] = {(): 1}
    twice: list[tuple[int, str]] = []
    return _take(node, (), lines, twice), lines, twice


def _take(node: yaml.Node, key: KeyPath, lines: dict[KeyPath, int], twice: list[tuple[int, str]]) -> Any:
    """The data of one node; the lines of its keys, and what is given twice, are added to `lines` and `twice`."""
    if isinstance(node, yaml.ScalarNode):
        if node.tag == "tag:yaml.org,2002:bool":
            return node.value.lower() in ("true", "yes", "on")
        return None if node.tag == "tag:yaml.org,2002:null" else node.value
    if isinstance(node, yaml.SequenceNode):
        lines |= {(*key, i): item.start_mark.line + 1 for i, item in enumerate(node.value)}
        return [_take(item, (*key, i), lines, twice) for i, item in enumerate(node.value)]
    result: dict[str, Any] = {}
    for name_node, value in node.value:
        line = name_node.start_mark.line + 1
        name = name_node.value if isinstance(name_node, yaml.ScalarNode) else "?"
        inner = (*key, name)
        if name in result:
            twice.append((line, f"{key_text(inner)}: given twice, first in line {lines[inner]}"))
            continue
        lines[inner] = line
        result[name] = _take(value, inner, lines, twice)
    return result


def read_text_file(path: Path, error: type[Exception]) -> str:
    """The text of a YAML file.

    Raises:
        error: there is no such file, it cannot be read, or it is no text.
    """
    try:
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        raise error(f"{path}: is not a text file in UTF-8; a YAML file is needed") from None
    except OSError as problem:
        reason = {FileNotFoundError: "no such file", IsADirectoryError: "is a folder, not a file"}
        raise error(f"{path}: {reason.get(type(problem), problem.strerror)}") from None


def line_of(lines: Mapping[KeyPath, int], key: KeyPath) -> int:
    """The line of a key, of what it is missing in if it is missing; one after all others for an override."""
    if str(key[0]).startswith("--set"):
        return sys.maxsize
    return next(lines[key[:n]] for n in range(len(key), -1, -1) if key[:n] in lines)


def key_text(key: KeyPath) -> str:
    """A key as it is told: `effects[0]`, `parameters.mover_mass`."""
    return "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in key).removeprefix(".")


def yaml_type(value: Any) -> str:
    """What a value is, in the words of YAML."""
    if value is None:
        return "nothing"
    names = {
        bool: "a yes/no value",
        str: "a text",
        dict: "a mapping",
        list: "a list",
        int: "a number",
        float: "a number",
    }
    return names.get(type(value), type(value).__name__)
