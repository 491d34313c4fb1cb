"""The examples that come with the package: configurations, tasks, and a campaign of measurements."""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from edhas_jax.config.file_kind import command_of
from edhas_jax.config.result_files import ResultFileError, report_write_errors

FOLDER = Path(__file__).parents[1] / "examples"
CAMPAIGN = "campaign"


class Example(NamedTuple):
    """An example.

    Attributes:
        name: of its file or folder.
        command: what it is for.
        about: what it shows, in one line.
    """

    name: str
    command: str
    about: str


def list_examples() -> list[Example]:
    """Every example with the command that runs it."""
    found = []
    for path in sorted(FOLDER.glob("*.yaml")):
        text = path.read_text(encoding="utf-8")
        about = next((line[2:] for line in text.splitlines() if line.startswith("# ") and "$schema" not in line), "")
        found.append(Example(path.name, f"{command_of(text)} {path.name}", about.rstrip(".:")))
    about = "Measurements of a pump whose drive has an effect that its model lacks"
    return [*found, Example(CAMPAIGN, f"diagnose {CAMPAIGN}", about)]


def copy_examples(names: Sequence[str] = (), folder: Path | str = "examples") -> list[Path]:
    """Copy examples into a folder, with the machines that they are based on; files that are there stay as they are.

    Args:
        names: of the examples, see `list_examples`; all of them by default.
        folder: where to; made if it does not exist.

    Returns:
        The files and folders that were copied.

    Raises:
        ResultFileError: there is no such example, or the folder cannot be written.
    """
    known, folder = [example.name for example in list_examples()], Path(folder)
    for name in names:
        if name not in known:
            raise ResultFileError(f"{name}: no such example; `edhas examples` lists them: {', '.join(known)}")
    wanted = dict.fromkeys(names or [*known, "edhas.schema.json"])
    for name in list(wanted):
        if name.endswith(".yaml"):
            wanted |= dict.fromkeys(_bases(FOLDER / name))
    copied = []
    with report_write_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for name in wanted:
            source, target = FOLDER / name, folder / name
            if target.exists():
                continue
            shutil.copytree(source, target) if source.is_dir() else shutil.copyfile(source, target)
            copied.append(target)
    return copied


def _bases(path: Path) -> list[str]:
    """The configuration that a task is based on."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return [line.partition(":")[2].partition("#")[0].strip() for line in lines if line.startswith("base:")]
