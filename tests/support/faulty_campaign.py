"""Copies of the valid campaign in `data/campaign_bench`, each with one fault added to its files."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from edhas_jax.core.remark import Severity
from tests.support import DATA

VALID_CAMPAIGN = DATA / "campaign_bench"
RUNS = ("run3.csv", "run4.csv", "run8.csv")  # its files


def copy_campaign(folder: Path) -> Path:
    """A copy of the valid campaign."""
    return Path(shutil.copytree(VALID_CAMPAIGN, folder))


def replace_in_yaml(folder: Path, old: str, new: str) -> None:
    """Replace a text that occurs once in campaign.yaml."""
    path = folder / "campaign.yaml"
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))


def modify_table(folder: Path, run: str, change: Callable[[pd.DataFrame], pd.DataFrame | None]) -> None:
    """Replace the table of a run by what `change` returns, or by the table itself if that returns None."""
    path = folder / run
    frame = pd.read_csv(path)
    changed = change(frame)
    (frame if changed is None else changed).to_csv(path, index=False, float_format="%.6g")


def delayed(values: np.ndarray, samples: int) -> np.ndarray:
    """A signal (n,) delayed by some samples, extended by odd reflection at its ends."""
    padded = np.pad(values, 2 * abs(samples), mode="reflect", reflect_type="odd")
    first = 2 * abs(samples) - samples
    return padded[first : first + len(values)]


def rewrite(folder: Path, change: Callable, run: str = "run3.csv", name: str | None = None) -> None:
    """Replace the text of a run by what `change` makes of its lines, in a file of another name if one is given."""
    text = change((folder / run).read_text().splitlines())
    (folder / (name or run)).write_bytes(text if isinstance(text, bytes) else ("\n".join(text) + "\n").encode())
    if name:
        replace_in_yaml(folder, run, name)


def with_cell(row: int, column: int, text: str) -> Callable[[list[str]], list[str]]:
    """A change for `rewrite`: another text in one cell."""

    def change(lines):
        cells = lines[row].split(",")
        cells[column] = text
        return [*lines[:row], ",".join(cells), *lines[row + 1 :]]

    return change


def faults(campaign) -> list:
    """The remarks on a campaign that are no notes."""
    return [remark for remark in campaign.remarks if remark.severity is not Severity.NOTE]
