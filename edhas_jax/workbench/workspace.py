"""The folder that the workbench is opened on: its campaign, its models, its results, and what was decided.

Everything that the page shows comes from here, so that a second window and a restarted workbench show the same.
"""

import dataclasses
import functools
import hashlib
import io
import json
import os
import shlex
import shutil
import time
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from edhas_jax.config.yaml_with_lines import YamlError, parse_yaml
from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.core.literal_text import file_name
from edhas_jax.core.regular_file import read_regular_file
from edhas_jax.core.trusted_code import trusted_list

CAMPAIGN_FILE = "campaign.yaml"
RESULTS = "workbench"  # folder of everything that the workbench writes, besides the campaign itself
CALIBRATED, DIAGNOSED, TRIED, JOBS, DESIGNS = "calibrated", "diagnosed", "tried", "jobs", "designs"
KEPT = "fits"  # fits that were kept under a name
AS_GIVEN = "as given"  # the campaign's own model
CALIBRATED_FIRST = "calibrated by the diagnosis"  # which lets the bench deviate as well
MODEL_FILES = {
    CALIBRATED: f"{CALIBRATED}/config.yaml",
    CALIBRATED_FIRST: f"{DIAGNOSED}/config_calibrated.yaml",
    DIAGNOSED: f"{DIAGNOSED}/config.yaml",
}
RESULT_FILES = {CALIBRATED: "fit.json", DIAGNOSED: "diagnosis.json"}
DECISIONS_FILE, STEPS_FILE, PLACE_FILE = "decisions.json", "steps.jsonl", "place.txt"
CHOICES_FILE = "choices.yaml"
TRIED_KEYS = {"effects", "named", "before", "parameters", "error", "error_by_run"}
MAX_JSON_BYTES, MAX_STEPS = 100_000_000, 200
MAX_YAML_BYTES = 10_000_000
MAX_PACKED_BYTES = 200_000_000  # of the files that are packed in memory, and sent through the browser


class WorkspaceError(ValueError):
    """Something lies outside the folder, or a file in it cannot be used."""


@dataclasses.dataclass(frozen=True)
class Decisions:
    """What the engineer has decided on the suspects.

    Attributes:
        added: ids of the effects that were added, in their order.
        rejected: reason by id of the effect, or by "fault on signal".
    """

    added: tuple[str, ...] = ()
    rejected: Mapping[str, str] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class Step:
    """One thing that was done: when [s since 1970], what, and the command and the Python line that do the same."""

    at: float
    what: str
    command: str
    python: str


class Workspace:
    """A folder and what the workbench finds in it.

    Args:
        folder: the folder; nothing outside it is read or written.
        config: a configuration below it, where the workbench was opened on one.

    Attributes:
        allowed: effects of files that a click has allowed to run, as FILE.py:Class; forgotten when the server ends.
    """

    def __init__(self, folder: Path, config: Path | None = None):
        self.folder = Path(os.path.realpath(folder))
        self.shown = folder  # as the user has written it, for commands
        self.allowed: list[str] = []
        self.config = None if config is None else self.inside(config.name)
        self._hashes: dict[Path, tuple[tuple[int, int], str]] = {}

    @property
    def campaign_file(self) -> Path:
        """The file that describes the campaign; it need not exist yet."""
        return self.inside(CAMPAIGN_FILE)

    @property
    def results(self) -> Path:
        """The folder of the results."""
        return self.inside(RESULTS)

    @property
    def has_campaign(self) -> bool:
        """Whether there is a campaign."""
        return self.campaign_file.is_file()

    def inside(self, name: str | Path) -> Path:
        """The path of a file below the folder.

        Raises:
            WorkspaceError: it lies elsewhere, perhaps by a link.
        """
        path = Path(os.path.realpath(self.folder / name))
        if path != self.folder and self.folder not in path.parents:
            raise WorkspaceError(f"{name}: lies outside {self.folder.name}, the folder that the workbench is opened on")
        return path

    def written(self, name: str | Path) -> str:
        """A path below the folder as a word of a command."""
        return shlex.quote(str(self.shown / name))

    def require_files_inside(self) -> None:
        """Refuse a campaign that names files outside the folder.

        Raises:
            WorkspaceError: a file lies outside, or `campaign.yaml` cannot be read.
        """
        try:
            text = read_regular_file(self.campaign_file, MAX_YAML_BYTES).decode("utf-8")
            data, _, _ = parse_yaml(text)
        except (OSError, UnicodeDecodeError) as error:
            raise WorkspaceError(f"{CAMPAIGN_FILE}: cannot be read: {error}") from None
        except YamlError:
            return  # the reader of campaigns reports it
        for name in _named_files(data):
            self.inside(name)

    def inputs(self) -> dict[str, str]:
        """The files of the campaign, `campaign.yaml` first and then what it names, with a hash of each."""
        return {str(path.relative_to(self.folder)): self._hash(path) for path in self._input_files()}

    def _input_files(self) -> list[Path]:
        """The files of the campaign that are there, each once."""
        try:
            names = _texts_of(read_regular_file(self.campaign_file, MAX_YAML_BYTES))
        except OSError:
            names = ()
        found = []
        for name in (CAMPAIGN_FILE, *names):
            try:
                path = self.inside(name.partition(".py:")[0] + ".py" if ".py:" in name else name)
                found += [path] if path.is_file() and os.access(path, os.R_OK) else []
            except (OSError, ValueError):  # a text that is no file of the folder
                continue
        return list(dict.fromkeys(found))

    def changed_inputs(self, before: Mapping[str, str]) -> list[str]:
        """The files of the campaign that differ from those with earlier hashes; none where there are no such hashes."""
        if not before or not isinstance(before, Mapping):
            return []
        now = self.inputs()
        return [name for name in dict.fromkeys([*now, *before]) if now.get(name) != before.get(name)]

    def inputs_after(self, time: float) -> list[str]:
        """The files of the campaign that were written after a time [s since 1970]."""
        return [str(path.relative_to(self.folder)) for path in self._input_files() if path.stat().st_mtime > time]

    def _hash(self, path: Path) -> str:
        """A hash of a file, computed again when it was written again."""
        state = path.stat()
        mark = state.st_mtime_ns, state.st_size
        if self._hashes.get(path, (None, ""))[0] != mark:
            with path.open("rb") as file:
                self._hashes[path] = mark, hashlib.file_digest(file, "sha256").hexdigest()
        return self._hashes[path][1]

    def models(self) -> dict[str, Path | None]:
        """The models that exist: path of the configuration by name; None for the campaign's own, "as given"."""
        found: dict[str, Path | None] = {AS_GIVEN: None}
        for name, file in MODEL_FILES.items():
            if (path := self.inside(Path(RESULTS, file))).is_file():
                found[name] = path
        for path in sorted(self.inside(Path(RESULTS, TRIED)).glob("*.yaml")):
            found[f"with {path.stem}"] = self.inside(Path(RESULTS, TRIED, path.name))
        for path in sorted(self.inside(Path(RESULTS, KEPT)).glob("*/config.yaml")):
            found[f"fit {path.parent.name}"] = self.inside(Path(RESULTS, KEPT, path.parent.name, path.name))
        return found

    def keep_fit(self, name: str) -> Path:
        """Keep the present calibration under a name, beside later ones; its folder below that of the workspace.

        Raises:
            WorkspaceError: there is no calibration, or the name is taken.
        """
        folder = Path(RESULTS, KEPT, file_name(name.strip()))
        if self.result(CALIBRATED) is None:
            raise WorkspaceError("There is no calibration yet that could be kept")
        if not name.strip():
            raise WorkspaceError("Give the fit a name")
        target = self.inside(folder)
        if target.exists():
            raise WorkspaceError(f"A fit “{folder.name}” is there already; choose another name")
        made = Path(RESULTS, CALIBRATED)
        files = [self.inside(made / path.name) for path in self.inside(made).iterdir()]  # none may lie elsewhere
        target.mkdir(parents=True)
        for path in files:
            if path.is_file():
                shutil.copy2(path, target / path.name)
        return folder

    def result(self, name: str) -> dict[str, Any] | None:
        """`fit.json` of the calibration or `diagnosis.json` of the diagnosis; None where there is none."""
        return self._read_json(Path(RESULTS, name, RESULT_FILES[name]))

    def result_time(self, name: str) -> float | None:
        """When that file was written [s since 1970]; None where there is none."""
        path = self.inside(Path(RESULTS, name, RESULT_FILES[name]))
        return path.stat().st_mtime if path.is_file() else None

    def tried(self) -> dict[str, dict[str, Any]]:
        """What was tried: effects, sizes and errors by name, such as "coil_heating+cogging_force"."""
        folder = self.inside(Path(RESULTS, TRIED))
        rows = {p.stem: self._read_json(Path(RESULTS, TRIED, p.name)) for p in sorted(folder.glob("*.json"))}
        return {name: row for name, row in rows.items() if row is not None and row.keys() >= TRIED_KEYS}

    def save_tried(self, name: str, data: Mapping[str, Any]) -> None:
        """Keep the errors of a model that was tried."""
        self._write_json(Path(RESULTS, TRIED, f"{file_name(name)}.json"), data)

    def decisions(self) -> Decisions:
        """What was decided so far."""
        data = self._read_json(Path(RESULTS, DECISIONS_FILE)) or {}
        added, rejected = data.get("added", []), data.get("rejected", {})
        if not (isinstance(added, list) and isinstance(rejected, dict)):
            return Decisions()
        return Decisions(tuple(map(str, added)), {str(k): str(v) for k, v in rejected.items()})

    def decide(self, decisions: Decisions) -> None:
        """Keep decisions."""
        self._write_json(Path(RESULTS, DECISIONS_FILE), dataclasses.asdict(decisions))

    def steps(self) -> list[Step]:
        """What was done so far, the first step first."""
        try:
            lines = self.inside(Path(RESULTS, STEPS_FILE)).read_text(encoding="utf-8").splitlines()
        except OSError:
            return []
        steps = []
        for line in lines[-MAX_STEPS:]:
            try:
                steps.append(Step(**json.loads(line)))
            except (ValueError, TypeError):
                continue
        return steps

    def add_step(self, what: str, command: str, python: str) -> None:
        """Note what was done, and the command and the Python line for it."""
        steps = self.steps()
        if steps and (steps[-1].what, steps[-1].command) == (what, command):
            return
        path = self.inside(Path(RESULTS, STEPS_FILE))
        path.parent.mkdir(exist_ok=True)
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(dataclasses.asdict(Step(time.time(), what, command, python))) + "\n")

    def packed(self, address: str) -> bytes:
        """The campaign, the results and a place of the page as one ZIP file, to be unpacked and opened elsewhere.

        Args:
            address: the place, see `Place.address`; a workbench on the unpacked folder opens there.

        Raises:
            WorkspaceError: all this is too large to be sent.
        """
        paths = [self.inside(name) for name in self.inputs()]
        paths += [path for path in sorted(self.results.rglob("*")) if path.is_file() and self._is_packed(path)]
        if sum(path.stat().st_size for path in paths) > MAX_PACKED_BYTES:
            size = f"{MAX_PACKED_BYTES / 1e6:.0f} MB"
            raise WorkspaceError(f"This campaign is larger than {size}: copy its folder instead")
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as packed:
            for path in paths:
                packed.write(path, Path(self.folder.name, path.relative_to(self.folder)))
            packed.writestr(str(Path(self.folder.name, RESULTS, PLACE_FILE)), address)
        return buffer.getvalue()

    def _is_packed(self, path: Path) -> bool:
        """Whether a result belongs into that file: no job of this computer, no link to elsewhere."""
        jobs = self.results / JOBS
        return not path.is_symlink() and jobs not in path.parents and path.name != PLACE_FILE

    def packed_place(self) -> str:
        """The place at which a folder that was packed opens; empty for others."""
        try:
            return read_regular_file(self.inside(Path(RESULTS, PLACE_FILE)), MAX_YAML_BYTES).decode("utf-8")
        except (OSError, ValueError):
            return ""

    def campaign_mark(self) -> tuple:
        """Changes as soon as a file of the campaign changes, or which code may run."""
        return _states([*self._input_files(), *filter(None, [trusted_list()])])

    def results_mark(self) -> tuple:
        """Changes as soon as a result or a decision changes that the page shows."""
        return _states(self._watched_results())

    def _watched_results(self) -> Iterator[Path]:
        for name in (CALIBRATED, DIAGNOSED, TRIED, JOBS):
            yield from sorted(self.inside(Path(RESULTS, name)).glob("*.json"))
        yield from sorted(self.inside(Path(RESULTS, KEPT)).glob("*/fit.json"))
        yield from (self.inside(Path(RESULTS, name)) for name in (DECISIONS_FILE, STEPS_FILE, CHOICES_FILE))

    def _read_json(self, name: Path) -> dict[str, Any] | None:
        try:
            data = json.loads(read_regular_file(self.inside(name), MAX_JSON_BYTES))
        except (OSError, ValueError, RecursionError):
            return None
        return data if isinstance(data, dict) else None

    def _write_json(self, name: Path, data: Mapping[str, Any]) -> None:
        self.write(name, json.dumps(data, indent=1, ensure_ascii=False))

    def write(self, name: str | Path, text: str) -> None:
        """Write a file below the folder, whole or not at all."""
        path = self.inside(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as temporary:
            temporary.write_text(text, encoding="utf-8")


def open_workspace(path: Path) -> Workspace:
    """Open a folder, or the folder of a configuration.

    Raises:
        WorkspaceError: there is nothing of that name.
    """
    if path.is_dir():
        return Workspace(path)
    if path.is_file() and path.name == CAMPAIGN_FILE:
        return Workspace(path.parent)
    if path.is_file():
        return Workspace(path.parent, path)
    raise WorkspaceError(f"{path}: no such folder or configuration; `edhas campaign new {path}` begins a campaign")


def _named_files(data: Any) -> Iterator[str]:
    """The values of every key `file` in plain data."""
    if isinstance(data, Mapping):
        for key, value in data.items():
            if key == "file" and isinstance(value, str):
                yield value
            else:
                yield from _named_files(value)
    elif isinstance(data, list):
        for value in data:
            yield from _named_files(value)


def _states(paths: Iterable[Path]) -> tuple:
    """Name, time and size of the files that are there."""
    rows = []
    for path in paths:
        try:
            state = path.stat()
        except OSError:
            continue
        rows.append((path.name, state.st_mtime_ns, state.st_size))
    return tuple(rows)


@functools.lru_cache(maxsize=1)  # the page looks every second
def _texts_of(content: bytes) -> tuple[str, ...]:
    """Every text in the content of a YAML file; none where it cannot be read."""
    try:
        return tuple(_texts(parse_yaml(content.decode("utf-8"))[0]))
    except (UnicodeDecodeError, YamlError):
        return ()


def _texts(data: Any) -> Iterator[str]:
    """Every text in plain data."""
    if isinstance(data, str):
        yield data
    elif isinstance(data, Mapping | list):
        for value in data.values() if isinstance(data, Mapping) else data:
            yield from _texts(value)


def effect_id(name: str) -> str:
    """The id of an effect from what names it: `my_effects.py:SealDrag` is seal_drag."""
    source, _, cls = name.rpartition(":")
    if not source:
        return name
    return "".join("_" + c.lower() if c.isupper() and i else c.lower() for i, c in enumerate(cls))
