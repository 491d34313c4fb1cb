"""A campaign to spoil: copies of the one in `data/campaign_bench`, changed one thing at a time."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from tests.support import DATA

SOUND = DATA / "campaign_bench"
INTERVAL = 0.2e-3  # s


def copy(folder: Path) -> Path:
    """A copy of the sound campaign."""
    return Path(shutil.copytree(SOUND, folder))


def describe(folder: Path, old: str, new: str) -> None:
    """Change a text in campaign.yaml."""
    path = folder / "campaign.yaml"
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))


def record(folder: Path, run: str, change: Callable[[pd.DataFrame], pd.DataFrame | None]) -> None:
    """Change the table of a run."""
    path = folder / run
    frame = pd.read_csv(path)
    changed = change(frame)
    (frame if changed is None else changed).to_csv(path, index=False, float_format="%.6g")


def moved(values: np.ndarray, samples: int) -> np.ndarray:
    """A signal that comes some samples late; it goes on mirrored where nothing was measured."""
    padded = np.pad(values, 2 * abs(samples), mode="reflect", reflect_type="odd")
    at = 2 * abs(samples) - samples
    return padded[at : at + len(values)]
