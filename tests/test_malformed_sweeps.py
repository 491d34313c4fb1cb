"""Every malformed sweep, and the exact message it gives.

The messages are in malformed_sweeps/expected.txt; EDHAS_UPDATE_GOLDEN=1 writes that file anew, to be read before it
is kept.
"""

import os
from pathlib import Path

import pytest

from edhas_jax.config import ConfigError
from edhas_jax.sweep_config import load_sweep

ROOT = Path(__file__).parent.parent
FOLDER = Path("tests/malformed_sweeps")
EXPECTED = ROOT / FOLDER / "expected.txt"
FILES = sorted(p.name for p in (ROOT / FOLDER).glob("*.yaml")) + ["no_such_file.yaml"]
UPDATE = os.environ.get("EDHAS_UPDATE_GOLDEN") == "1"


def message(name: str) -> str:
    with pytest.raises(ConfigError) as caught:
        load_sweep(FOLDER / name)
    return str(caught.value)


def expected() -> dict[str, str]:
    blocks = EXPECTED.read_text(encoding="utf-8").strip().split("\n\n")
    return {block.split("\n", 1)[0]: block.split("\n", 1)[1] for block in blocks}


def test_update(monkeypatch):
    monkeypatch.chdir(ROOT)
    if not UPDATE:
        assert set(expected()) == set(FILES), "a file without a message, or a message without a file"
        return
    EXPECTED.write_text("".join(f"{name}\n{message(name)}\n\n" for name in FILES).rstrip() + "\n", encoding="utf-8")


@pytest.mark.parametrize("name", FILES)
def test_message(name, monkeypatch):
    monkeypatch.chdir(ROOT)
    assert message(name) == expected()[name]
