"""The choices for a fit that the page edits: the file that `edhas fit --choices` reads."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from edhas_jax.config.yaml_with_lines import YamlError, parse_yaml
from edhas_jax.core.regular_file import read_regular_file
from edhas_jax.workbench.workspace import CALIBRATED, CHOICES_FILE, MAX_YAML_BYTES, RESULTS, Workspace, WorkspaceError


class Choices:
    """The choices of a workspace; every change is written at once, and what is as in the campaign is left out.

    Args:
        workspace: the folder.
    """

    def __init__(self, workspace: Workspace):
        self._workspace = workspace

    @property
    def name(self) -> Path:
        """The path of the file below the folder."""
        return Path(RESULTS, CHOICES_FILE)

    @property
    def exist(self) -> bool:
        """Whether anything is chosen."""
        return bool(self.text())

    def text(self) -> str:
        """The content of the file; empty where there is none, or it is a link to elsewhere."""
        try:
            return read_regular_file(self._workspace.inside(self.name), MAX_YAML_BYTES).decode("utf-8")
        except (OSError, UnicodeDecodeError, WorkspaceError):
            return ""

    def read(self) -> dict[str, Any]:
        """The content of the file as plain data; empty where it is missing or cannot be read."""
        try:
            data = parse_yaml(self.text(), "runs: [run1]")[0]
        except YamlError:
            return {}
        kinds = {"parameters": Mapping, "runs": list, "signals": Mapping, "windows": Mapping}
        return {key: data[key] for key, kind in kinds.items() if isinstance(data.get(key), kind)}

    def parameter(self, name: str) -> dict[str, Any]:
        """What is chosen for a parameter."""
        row = self.read().get("parameters", {}).get(name)
        return dict(row) if isinstance(row, Mapping) else {}

    def set_parameter(self, name: str, row: Mapping[str, Any]) -> None:
        """Choose for a parameter; an empty row leaves it as in the campaign."""
        data = self.read()
        self.write(data | {"parameters": _with_row(data.get("parameters", {}), name, dict(row))})

    def set_window(self, run: str, window: tuple[str, str] | None) -> None:
        """Choose the first and the last time that are used of a run; None for all of it."""
        data = self.read()
        self.write(data | {"windows": _with_row(data.get("windows", {}), run, None if window is None else [*window])})

    def write(self, data: Mapping[str, Any]) -> None:
        """Write choices; without any there is no file."""
        usual = {"parameters": {}, "windows": {}}  # an empty list of runs or signals is a choice, though a wrong one
        data = {key: value for key, value in data.items() if value is not None and value != usual.get(key)}
        if not data:
            self._workspace.inside(self.name).unlink(missing_ok=True)
            return
        text = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, default_flow_style=None)
        self._workspace.write(self.name, text)

    def changed_after_fit(self) -> bool:
        """Whether something else was chosen after the last calibration."""
        made = self._workspace.result_time(CALIBRATED)
        if made is None:
            return False
        if self.exist:
            return self._workspace.inside(self.name).stat().st_mtime > made
        return bool((self._workspace.result(CALIBRATED) or {}).get("choices"))


def _with_row(rows: Mapping[str, Any], name: str, row: Any) -> dict[str, Any]:
    found = {**rows, name: row}
    return {key: value for key, value in found.items() if value}
