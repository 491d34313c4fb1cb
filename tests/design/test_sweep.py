"""Sweeps from end to end: complete, resumed, refused, interrupted, killed, drawn."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.design.batch.batch import plan_chunks
from edhas_jax.design.sweep import folder, identity
from edhas_jax.design.sweep import run as running
from edhas_jax.machine.metrics import METRICS
from edhas_jax.simulation.validity import REASONS
from tests.support import CONFIGS

# four frequencies are four chunks
TEXT = f"""
name: tiny
base: {CONFIGS / "paper.yaml"}
sweep:
  kind: grid
  parameters:
    piston_clearance: {{from: 10 um, to: 40 um, count: 2}}
    frequency: [10 Hz, 20 Hz, 40 Hz, 80 Hz]
batch: {{step: 100 us, tolerance: 1 %, max_cycles: 6}}
"""
COMMAND = ["sweep", "tiny.yaml"]


@pytest.fixture()
def workdir(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.yaml").write_text(TEXT)
    return tmp_path


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The folder of the sweep, run without interruption."""
    folder = tmp_path_factory.mktemp("finished")
    (folder / "tiny.yaml").write_text(TEXT)
    edhas.run_sweep(edhas.load_sweep(folder / "tiny.yaml"), folder / "runs" / "tiny")
    return folder / "runs" / "tiny"


def same(one: Path, other: Path) -> bool:
    """Whether two tables agree to the bit, schema included."""
    return (one / "table.parquet").read_bytes() == (other / "table.parquet").read_bytes()


def test_a_sweep_gives_a_table_with_units(workdir, finished, capsys, monkeypatch):
    assert main(COMMAND) == 0
    printed = capsys.readouterr().out
    assert "8 designs, 8 computed" in printed and "edhas plot sweep runs/tiny" in printed
    folder = workdir / "runs" / "tiny"
    assert sorted(p.name for p in folder.iterdir() if p.name != ".lock") == [
        "chunks", "designs.parquet", "manifest.json", "table.parquet"
    ]  # fmt: skip
    table, schema = pd.read_parquet(folder / "table.parquet"), pq.read_schema(folder / "table.parquet")
    assert len(table) == 8 and table["frequency"].tolist() == [10.0, 20.0, 40.0, 80.0] * 2
    assert schema.field("mean_flow").metadata[b"unit"] == b"m^3/s"
    assert schema.field("mean_flow").metadata[b"shown"] == b"L/min"
    assert schema.field("piston_clearance").metadata[b"unit"] == b"m"
    assert schema.field("piston_clearance").metadata[b"shown"] == "µm".encode()
    for name in ("mean_flow", "mean_electrical_power", "overall_efficiency"):
        assert name in METRICS and (table[name].notna() == (table["status"] == "ok")).all()
    assert set(table["status"]) <= {"ok", "not_periodic", "stalled", "hit_stops", "out_of_range", "implausible"}
    assert (table["cycles"] >= 1).all() and "reason" in table
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["state"] == "finished" and manifest["designs"] == 8 and manifest["chunks"] == 4
    assert manifest["edhas_jax"] == edhas.__version__ and "xla_flags" in manifest
    assert manifest["computed_on"][0]["platform"] and "rig: pump_bench" in manifest["machine"]
    assert same(folder, finished)

    # again: nothing is computed
    monkeypatch.setattr(running, "run_chunk", None)
    before = {p: p.stat().st_mtime_ns for p in folder.rglob("*.*") if p.name != ".lock"}
    assert main(COMMAND) == 0
    assert "all of them computed before" in capsys.readouterr().out
    assert before == {p: p.stat().st_mtime_ns for p in before}
    # what was written is a table of designs itself
    table_sweep = "sweep: {kind: table, file: runs/tiny/designs.parquet}"
    (workdir / "again.yaml").write_text(TEXT.split("sweep:")[0] + table_sweep)
    again = edhas.load_sweep("again.yaml")
    np.testing.assert_array_equal(again.designs["piston_clearance"], table["piston_clearance"])


def raise_after(monkeypatch, count: int, error: BaseException):
    """Raise `error` in place of every chunk after the first `count`."""
    run_chunk, calls = running.run_chunk, []

    def interrupted(*arguments):
        calls.append(1)
        if len(calls) > count:
            raise error
        return run_chunk(*arguments)

    monkeypatch.setattr(running, "run_chunk", interrupted)
    return calls


def test_an_interrupted_sweep_is_resumed(workdir, finished, capsys, monkeypatch):
    with monkeypatch.context() as patch:
        raise_after(patch, 2, KeyboardInterrupt())
        assert main(COMMAND) == 130
    printed = capsys.readouterr()
    assert "4 of 8 designs are finished" in printed.err and "the same command resumes" in printed.err
    part = edhas.open_sweep("runs/tiny")
    assert part.done == 4 and part.manifest["state"] == "unfinished"
    assert (part.frame["status"] == "not_run").sum() == 4
    assert main(["plot", "sweep", "runs/tiny", "--kind", "heat"]) == 0
    (workdir / "runs/tiny/heat.png").unlink()
    # a damaged chunk is computed again, and a partial file of a killed process is removed
    [chunk] = (workdir / "runs/tiny/chunks").glob("000000-*.parquet")
    chunk.write_bytes(chunk.read_bytes()[:-100])
    (workdir / "runs/tiny/chunks/.000003.parquet.1.partial").write_bytes(b"half")
    calls = raise_after(monkeypatch, 99, RuntimeError())
    assert main(COMMAND) == 0
    assert len(calls) == 3 and "6 computed" in capsys.readouterr().out
    assert not list((workdir / "runs/tiny/chunks").glob(".*"))
    assert same(workdir / "runs" / "tiny", finished)


def test_a_killed_sweep_is_resumed(workdir, finished):
    code = (
        "import sys, time; from edhas_jax.design.sweep import run as running; run = running.run_chunk\n"
        "def slow(*a):\n    out = run(*a); time.sleep(0.7); return out\n"
        "running.run_chunk = slow\n"
        "from edhas_jax.commands.cli import main; sys.exit(main(['sweep', 'tiny.yaml']))"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.DEVNULL)
    chunks, until = workdir / "runs" / "tiny" / "chunks", time.time() + 120
    while len(list(chunks.glob("0*.parquet"))) < 2 and process.poll() is None and time.time() < until:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    assert 0 < edhas.open_sweep("runs/tiny").done < 8
    assert main(COMMAND) == 0
    assert same(workdir / "runs" / "tiny", finished)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("10 um", "12 um", "table of designs: other values"),
        ("count: 2", "count: 3", "number of designs: 8 in the folder, 12 now"),
        ("100 us", "50 us", "setting step: 0.0001 in the folder, 5e-05 now"),
        ("piston_clearance", "piston_fit_length", "varied parameters"),
        ("paper.yaml", "actuator.yaml", "rig: pump_bench in the folder, actuator_bench now"),
    ],
)
def test_the_folder_of_another_sweep_is_refused(workdir, finished, capsys, old, new, message):
    text = TEXT.replace(old, new).replace("10 um", "10 mm" if new.startswith("piston_fit") else "10 um")
    text = text.replace("40 um", "40 mm" if new.startswith("piston_fit") else "40 um")
    if new == "actuator.yaml":
        text = text.replace("piston_clearance: {from: 10 um, to: 40 um", "mover_mass: {from: 0.1 kg, to: 0.2 kg")
    (workdir / "tiny.yaml").write_text(text)
    before = (finished / "manifest.json").read_bytes()
    assert main([*COMMAND, "--out", str(finished)]) == 2
    printed = capsys.readouterr().err
    assert "holds another sweep; nothing was changed" in printed and message in printed
    assert (finished / "manifest.json").read_bytes() == before


def test_another_machine_or_version_is_refused(workdir, finished, capsys, monkeypatch):
    base = (CONFIGS / "paper.yaml").read_text().replace("piston_diameter: 12 mm", "piston_diameter: 13 mm")
    (workdir / "other.yaml").write_text(base)
    (workdir / "tiny.yaml").write_text(TEXT.replace(str(CONFIGS / "paper.yaml"), "other.yaml"))
    assert main([*COMMAND, "--out", str(finished)]) == 2
    assert "parameter pump.piston_diameter: 12 mm in the folder, 13 mm now" in capsys.readouterr().err
    (workdir / "tiny.yaml").write_text(TEXT)

    newer = identity.versions() | {"jax": "99.0"}
    monkeypatch.setattr(identity, "versions", lambda *_: newer)
    assert main([*COMMAND, "--out", str(finished)]) == 2
    assert "99.0 now" in capsys.readouterr().err


def test_another_folder_is_not_changed(workdir, capsys):
    (workdir / "precious").mkdir()
    (workdir / "precious" / "thesis.txt").write_text("years")
    assert main([*COMMAND, "--out", "precious"]) == 2
    assert "is not the folder of a sweep" in capsys.readouterr().err
    assert [p.name for p in (workdir / "precious").iterdir()] == ["thesis.txt"]
    assert main(["plot", "sweep", "precious"]) == 2
    assert "manifest.json is missing" in capsys.readouterr().err
    assert main(["sweep", "nowhere.yaml"]) == 2
    assert "no such file" in capsys.readouterr().err


def test_a_full_disk_keeps_the_finished_chunks(workdir, finished, capsys, monkeypatch):
    write, written = Path.write_bytes, []

    def full(path, content):
        if "chunks" in str(path):
            written.append(path)
            if len(written) > 2:
                write(path, b"half of it")
                raise OSError(errno.ENOSPC, "No space left on device")
        return write(path, content)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        assert main(COMMAND) == 2
    assert "the disk is full" in capsys.readouterr().err
    assert edhas.open_sweep("runs/tiny").done == 4
    assert len(list((workdir / "runs/tiny/chunks").iterdir())) == 2
    with monkeypatch.context() as patch:
        patch.setattr(folder.shutil, "disk_usage", lambda path: type("", (), {"free": 1000})())
        assert main(COMMAND) == 2
    assert "the disk has 0 MB left; nothing was computed" in capsys.readouterr().err
    assert main(COMMAND) == 0
    assert same(workdir / "runs" / "tiny", finished)


def test_two_processes_do_not_share_a_folder(workdir, capsys, monkeypatch):
    sweep = edhas.load_sweep("tiny.yaml")
    with folder.SweepFolder(sweep, "runs/tiny", plan_chunks(sweep.machine, sweep.designs, sweep.settings)):
        assert main(COMMAND) == 2
    assert "is being computed by another process" in capsys.readouterr().err


def test_pictures(workdir, finished, capsys):
    assert main(["plot", "sweep", str(finished), "--out", "made/for/it/picture.png"]) == 0
    for kind in ("heat", "parallel", "pareto"):
        assert (workdir / f"made/for/it/picture_{kind}.png").stat().st_size > 10_000
    heat = ["plot", "sweep", str(finished), "--out", "one.svg", "--kind", "heat"]
    assert main([*heat, "--metric", "mean_leakage", "--x", "frequency", "--y", "piston_clearance"]) == 0
    assert "<svg" in (workdir / "one.svg").read_text()
    for arguments, message in (
        (["--metric", "mean_flew"], "nearest: mean_flow"),
        (["--x", "frequncy"], "nearest: frequency"),
        (["--slice", "frequency=20mm"], "not a frequency"),
        (["--slice", "frequency=500Hz"], "outside what was swept, 10 Hz … 80 Hz"),
        (["--slice", "frequency=20Hz"], "two parameters that vary"),
        (["--slice", "nonsense"], "write NAME=VALUE"),
    ):
        assert main([*heat, *arguments]) == 2
        assert message in capsys.readouterr().err
    pareto = ["plot", "sweep", str(finished), "--kind", "pareto"]
    assert main([*pareto, "--pareto", "mean_flow:up", "peak_current:min"]) == 2
    assert "mean_flow:max or mean_flow:min" in capsys.readouterr().err


def test_the_pareto_front_is_the_set_of_non_dominated_points():
    from edhas_jax.design.sweep.pareto_front import non_dominated

    rng = np.random.default_rng(0)
    a, b = rng.random(300), rng.random(300).round(1)
    expected = {
        i for i in range(300)
        if not any((a[j] >= a[i]) & (b[j] >= b[i]) & ((a[j] > a[i]) | (b[j] > b[i])) for j in range(300))
    }  # fmt: skip
    assert set(non_dominated(a, b)) == expected


def test_any_executor_gives_the_same_table(workdir, finished):
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(2) as executor:
        edhas.run_sweep(edhas.load_sweep("tiny.yaml"), "threads", executor)
    assert same(workdir / "threads", finished)


def test_the_examples_of_the_documentation_are_read(workdir, finished):
    import re
    import shutil

    page = (CONFIGS.parent / "docs" / "sweeps.md").read_text(encoding="utf-8")
    shutil.copytree(CONFIGS, workdir / "configs")
    (workdir / "configs" / "page.yaml").write_text(re.search(r"```yaml\n(.*?)```", page, re.DOTALL)[1])
    assert len(edhas.load_sweep("configs/page.yaml")) == 100
    assert len(edhas.load_sweep("configs/sweep_clearance.yaml")) == 100
    pumps = edhas.load_sweep("configs/sweep_pumps.yaml")
    assert len(pumps) == 10_000 and pumps.settings.precision.value == "float32"
    runs = (CONFIGS.parent / "docs" / "configuration.md").read_text(encoding="utf-8")
    for status, reason in REASONS.items():
        assert f"| `{status.name.lower()}` | {reason} |" in runs
    shown = edhas.open_sweep(finished)
    assert shown.shown("mean_flow") == pytest.approx(shown.frame["mean_flow"].to_numpy() * 60e3, nan_ok=True)


def test_changes_to_the_base_and_an_inline_machine(workdir):
    (workdir / "tiny.yaml").write_text(TEXT + "parameters: {load_orifice_area: 1 mm^2}\n")
    assert edhas.get(edhas.load_sweep("tiny.yaml").machine, "load_orifice_area") == 1e-6
    (workdir / "tiny.yaml").write_text(
        "machine: {rig: actuator_bench}\nsweep: {kind: sobol, count: 5, seed: 2, parameters: "
        "{mover_mass: {from: 100 g, to: 200 g, spacing: log}}}\n"
    )
    sweep = edhas.load_sweep("tiny.yaml")
    assert len(sweep) == 5 and sweep.seed == 2 and sweep.settings.step == 20e-6
