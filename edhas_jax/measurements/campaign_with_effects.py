"""The description of a campaign with more effects in its machine: the user's text, changed only where it has to be."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import yaml

from edhas_jax.core.literal_text import yaml_text


def description_with_effects(
    file: Path, folder: Path, effects: Sequence[str], parameters: Mapping[str, str], uncertain: Mapping[str, str]
) -> str:
    """The text of a `campaign.yaml` with more effects, for another folder.

    Comments, and all that is stated, stay. Files that are named relative to the campaign are so to the new folder.

    Args:
        file: the description of the campaign, which can be read without a problem.
        folder: where the text will be written.
        effects: entries of `effects` to add; a usual effect that is listed in `without` is taken out there instead.
        parameters: entries of `parameters` to add: by name, a quantity.
        uncertain: entries of `uncertain` to add: by name, the text of its spread; those that are there stay.

    Raises:
        OSError: the file cannot be read.
    """
    text = _Description(file.read_text(encoding="utf-8-sig"))
    text.move_files(file.parent, folder)
    without = text.items("without")
    if left_out := [spec for spec in effects if spec in without]:
        text.replace_list("without", [name for name in without if name not in left_out])
    text.add_entries("effects", [yaml_text(spec) for spec in effects if spec not in left_out])
    text.add_entries("parameters", [f"{name}: {value}" for name, value in parameters.items()])
    known = text.names("uncertain")
    text.add_entries("uncertain", [f"{name}: {spread}" for name, spread in uncertain.items() if name not in known])
    return text.edited()


class _Description:
    """A description with the changes to its text."""

    def __init__(self, text: str):
        self._text = text
        self._root = yaml.compose(text, Loader=yaml.SafeLoader)
        self._sections = {key.value: (key, value) for key, value in self._root.value}
        self._changes: list[tuple[int, int, str]] = []  # from, to, new text
        self._new: dict[str, list[str]] = {}  # sections that are not there yet

    def edited(self) -> str:
        """The changed text."""
        place = self._sections["signals"][0].start_mark
        indent = "\n" + " " * place.column
        for name, entries in self._new.items():
            inner = ", ".join(entries)
            if name == "effects":
                section = f"{name}: [{inner}]"
            elif self._root.flow_style:
                section = f"{name}: {{{inner}}}"
            else:
                section = f"{indent}  ".join([f"{name}:", *entries])
            self._changes.append((place.index, place.index, section + (", " if self._root.flow_style else indent)))
        text = self._text
        # from the end, so that places before a change stay; those at one place in the order in which they were made
        for start, end, new in reversed(sorted(self._changes, key=lambda change: change[:2])):
            text = text[:start] + new + text[end:]
        return text

    def items(self, section: str) -> list[str]:
        """The entries of a list that are texts."""
        return [node.value for node in self._children(section) if isinstance(node, yaml.ScalarNode)]

    def names(self, section: str) -> list[str]:
        """The names in a section."""
        return [key.value for key, _ in self._children(section)]

    def _children(self, section: str) -> list:
        value = self._sections[section][1].value if section in self._sections else []
        return value if isinstance(value, list) else []

    def replace_list(self, section: str, texts: Sequence[str]) -> None:
        """Put other texts into a list that is not empty."""
        key, node = self._sections[section]
        end = (node if node.flow_style else node.value[-1]).end_mark.index
        self._changes.append((key.end_mark.index, end, f": [{', '.join(map(yaml_text, texts))}]"))

    def add_entries(self, section: str, entries: Sequence[str]) -> None:
        """Add entries to a list or a mapping, which is made if it is missing."""
        if not entries:
            return
        if section not in self._sections:
            self._new.setdefault(section, []).extend(entries)
            return
        _, node = self._sections[section]
        start, end = node.start_mark.index, node.end_mark.index
        inner, is_list = ", ".join(entries), section == "effects"
        if isinstance(node, yaml.ScalarNode):  # nothing yet
            self._changes.append((start, end, f" [{inner}]" if is_list else f" {{{inner}}}"))
        elif node.flow_style:
            self._changes.append((start + 1, start + 1, f"{inner}, " if node.value else inner))
        else:
            dash, indent = "- " if is_list else "", "\n" + " " * node.start_mark.column
            self._changes.append((start, start, "".join(dash + entry + indent for entry in entries)))

    def move_files(self, old: Path, new: Path) -> None:
        """Name files relative to another folder."""
        for node in self._file_nodes():
            source, colon, name = node.value.rpartition(":") if ".py:" in node.value else (node.value, "", "")
            if Path(source).is_absolute() or not (old / source).is_file():
                continue
            moved = Path(os.path.relpath((old / source).resolve(), new.resolve())).as_posix()
            self._changes.append((node.start_mark.index, node.end_mark.index, yaml_text(moved + colon + name)))

    def _file_nodes(self) -> list[yaml.ScalarNode]:
        """The texts that may name a file: rig, effects, controller, and the files of the runs."""
        found = [self._sections[name][1] for name in ("rig",) if name in self._sections]
        found += self._children("effects")
        found += [value for key, value in self._children("controller") if key.value == "kind"]
        for run in self._children("runs"):
            for key, value in run.value:
                if key.value == "file":
                    found.append(value)
                elif key.value == "files":
                    for entry in value.value:
                        inner = entry.value if isinstance(entry, yaml.MappingNode) else []
                        found += [entry, *(file for name, file in inner if name.value == "file")]
        return [node for node in found if isinstance(node, yaml.ScalarNode)]
