"""Files of a sweep: damaged or foreign ones are found and made anew, and an interrupted start is no dead end."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.design.sweep import run as running
from edhas_jax.design.sweep.folder import SweepError
from tests.support import CONFIGS

TEXT = f"""
base: {CONFIGS / "actuator.yaml"}
sweep:
  kind: grid
  parameters:
    mover_mass: {{from: 100 g, to: 200 g, count: 2}}
    frequency: [5 Hz, 10 Hz, 20 Hz]
batch: {{step: 100 us, tolerance: 5 %, max_cycles: 4}}
"""
COMMAND = ["sweep", "small.yaml", "--out", "swept"]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The folder of the finished sweep."""
    folder = tmp_path_factory.mktemp("finished")
    (folder / "small.yaml").write_text(TEXT)
    edhas.run_sweep(edhas.load_sweep(folder / "small.yaml"), folder / "swept")
    return folder / "swept"


@pytest.fixture()
def swept(tmp_path, monkeypatch, finished):
    """A copy of it in the working folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.yaml").write_text(TEXT)
    return Path(shutil.copytree(finished, tmp_path / "swept"))


def flip(path: Path, place: float, bit: int = 0) -> None:
    """Change one bit at a share 0 … 1 of a file."""
    content = bytearray(path.read_bytes())
    content[int(place * (len(content) - 1))] ^= 1 << bit
    path.write_bytes(content)


def same_table(swept: Path, finished: Path) -> bool:
    return (swept / "table.parquet").read_bytes() == (finished / "table.parquet").read_bytes()


@pytest.mark.parametrize("place", [0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0])
def test_a_chunk_with_one_wrong_bit_is_computed_again(swept, finished, capsys, monkeypatch, place):
    (swept / "table.parquet").unlink()
    chunk = sorted((swept / "chunks").glob("*.parquet"))[1]
    flip(chunk, place, bit=3)
    run, calls = running.run_chunk, []
    monkeypatch.setattr(running, "run_chunk", lambda *a: calls.append(1) or run(*a))
    assert main(COMMAND) == 0
    assert "chunk 1 is damaged or was changed; its 2 designs are computed again" in capsys.readouterr().out
    assert len(calls) == 1 and same_table(swept, finished) and len(list((swept / "chunks").iterdir())) == 3


@pytest.mark.parametrize("place", [0.0, 0.05, 0.4, 0.8, 0.95, 1.0])
@pytest.mark.parametrize("name", ["table.parquet", "designs.parquet", "manifest.json"])
def test_one_wrong_bit_in_another_file_is_found_and_repaired(swept, finished, capsys, name, place):
    flip(swept / name, place)
    if name != "designs.parquet":  # a finished table needs no designs
        with pytest.raises(SweepError, match=name):
            edhas.open_sweep(swept)
    assert main(COMMAND) == 0
    printed = capsys.readouterr().out
    assert name in printed and "written anew" in printed and "6 designs" in printed
    assert same_table(swept, finished) and edhas.open_sweep(swept).done == 6
    assert main(COMMAND) == 0 and "anew" not in capsys.readouterr().out


def test_the_table_of_another_sweep_is_not_taken_over(swept, finished, capsys):
    other = edhas.load_sweep("small.yaml")
    other = edhas.Sweep(other.machine, {n: v * 1.1 for n, v in other.designs.items()}, other.settings)
    edhas.run_sweep(other, "other")
    shutil.copy("other/table.parquet", swept / "table.parquet")
    with pytest.raises(SweepError, match=r"table\.parquet is damaged or was changed"):
        edhas.open_sweep(swept)
    assert main(COMMAND) == 0 and "not the table of this sweep" in capsys.readouterr().out
    assert same_table(swept, finished)


@pytest.mark.parametrize("left", [[], ["chunks"], ["chunks", ".lock", "designs.parquet"],
                                  ["chunks", ".manifest.json.0a1b2c.partial"]])  # fmt: skip
def test_an_interrupted_start_is_begun_anew(swept, finished, capsys, left):
    shutil.rmtree(swept)
    swept.mkdir()
    for name in left:
        (swept / name).mkdir() if name == "chunks" else (swept / name).write_bytes(b"")
    assert main(COMMAND) == 0
    assert ("an earlier start was interrupted" in capsys.readouterr().out) is bool(left)
    assert same_table(swept, finished) and not list(swept.glob(".*.partial"))


def test_a_start_on_a_full_disk_is_begun_anew(swept, finished, capsys, monkeypatch):
    shutil.rmtree(swept)
    with monkeypatch.context() as patch:

        def full(*arguments):
            raise OSError(28, "No space left on device")

        patch.setattr("edhas_jax.design.sweep.folder.pq.write_table", full)
        assert main(COMMAND) == 2
    assert "the disk is full" in capsys.readouterr().err and swept.exists()
    assert main(COMMAND) == 0 and same_table(swept, finished)


def test_a_start_that_was_killed_at_once_is_begun_anew(swept, finished):
    shutil.rmtree(swept)
    code = (
        "import sys, time; from edhas_jax.design.sweep import folder\n"
        "folder.machine_text = lambda sweep: time.sleep(60)\n"
        "from edhas_jax.commands.cli import main; main(sys.argv[1:])"
    )
    process = subprocess.Popen([sys.executable, "-c", code, *COMMAND], stdout=subprocess.DEVNULL)
    until = time.time() + 60
    while not (swept / "designs.parquet").exists() and process.poll() is None and time.time() < until:
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert not (swept / "manifest.json").exists()
    assert main(COMMAND) == 0 and same_table(swept, finished)


def test_a_damaged_manifest_hides_no_other_sweep(swept, capsys):
    flip(swept / "manifest.json", 0.3)
    Path("small.yaml").write_text(TEXT.replace("100 g", "110 g"))
    before = {p: p.read_bytes() for p in swept.rglob("*") if p.is_file() and p.name != ".lock"}
    assert main(COMMAND) == 2
    assert "chunks of another sweep" in capsys.readouterr().err
    assert before == {p: p.read_bytes() for p in before}


def test_a_manifest_without_its_checksum_is_damaged(swept):
    manifest = json.loads((swept / "manifest.json").read_text())
    del manifest["checksum"]
    (swept / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(SweepError, match="checksum"):
        edhas.open_sweep(swept)
    assert np.isfinite(manifest["designs"])
