"""Malformed files and the exact messages they give, kept in one text file beside them.

EDHAS_UPDATE_GOLDEN=1 writes that file anew, to be read before it is kept.
"""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from edhas_jax.config.machine_config import ConfigError
from tests.support import ROOT

UPDATE = os.environ.get("EDHAS_UPDATE_GOLDEN") == "1"


class Messages:
    """The YAML files of a folder of `tests`, one that is missing included, and what `read` says of each."""

    def __init__(self, folder: str, read: Callable):
        self._folder, self._read = Path("tests") / "config" / folder, read
        self._expected = ROOT / self._folder / "expected.txt"
        self.files = sorted(p.name for p in (ROOT / self._folder).glob("*.yaml")) + ["no_such_file.yaml"]

    def message(self, name: str) -> str:
        with pytest.raises(ConfigError) as caught:
            self._read(self._folder / name)
        return str(caught.value)

    def expected(self) -> dict[str, str]:
        blocks = self._expected.read_text(encoding="utf-8").strip().split("\n\n")
        return {block.split("\n", 1)[0]: block.split("\n", 1)[1] for block in blocks}

    def update(self) -> None:
        if not UPDATE:
            assert set(self.expected()) == set(self.files), "a file without a message, or a message without a file"
            return
        text = "".join(f"{name}\n{self.message(name)}\n\n" for name in self.files)
        self._expected.write_text(text.rstrip() + "\n", encoding="utf-8")
