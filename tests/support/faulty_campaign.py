"""Copies of the valid campaign in `data/campaign_bench`, each with one fault added to its files."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from tests.support import DATA

VALID_CAMPAIGN = DATA / "campaign_bench"


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
