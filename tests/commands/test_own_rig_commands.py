"""A rig of one's own on the command line: from an empty folder to what is missing."""

import json
import shutil

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.core.structs import replace
from edhas_jax.simulation.run_settings import Simulation
from studies.tanks.rig import Overflow, TwoTanks
from tests.support import ROOT

CAMPAIGN = """name: tanks
rig: rig.py:TwoTanks
uncertain: {outlet: 0.1, outlet_ratio: 0.03, pump_gain: 0.1, sensor_zero: 0.1, upper_start: 0.2, lower_start: 0.05}
drives: {pump_voltage: {column: u, unit: V}}
signals:
  level: {unit: V, noise: 0.02, limits: [0 V, 10 V]}
accuracy: {trigger: 1 ms, recorder_filter: 0, signals: {level: {gain: 1e-6, offset: 0.001 mV, shift: 1 ms}}}
runs:
  - {file: run.csv, use: fit}
"""


def record(path, machine, count=512):
    """A record of half an hour at 4 s, as a slow bench writes it; returns the level without noise."""
    t = 4.0 * np.arange(count)
    waves = ((1.0, 0.0009, 0.0), (0.6, 0.0023, 1.0), (0.5, 0.0041, 2.0))
    u = 3.2 + sum(a * np.sin(2 * np.pi * f * t + p) for a, f, p in waves)
    driven = replace(machine, pump_voltage=edhas.Recorded(values=u, interval=4.0))
    run = edhas.simulate(driven, Simulation(duration=float(t[-1]), sample_rate=0.25))
    level = run.signals["level"]
    measured = np.minimum(level + 0.02 * np.random.default_rng(0).standard_normal(count), 10.0)
    table = np.stack([t, u, measured], axis=1)
    np.savetxt(path, table, delimiter=",", header="time [s],u [V],level [V]", comments="")
    return level


@pytest.fixture
def bench(tmp_path, monkeypatch):
    """A campaign folder whose plant overflows at 8 V in the upper tank, and whose model does not."""
    folder = tmp_path / "bench"
    folder.mkdir()
    shutil.copyfile(ROOT / "studies" / "tanks" / "rig.py", folder / "rig.py")
    (folder / "campaign.yaml").write_text(CAMPAIGN, encoding="utf-8")
    truth = edhas.change(TwoTanks(effects=(Overflow(),)), upper_rim=8.0, lower_rim=40.0)
    record(folder / "run.csv", truth)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("EDHAS_CONFIG", str(tmp_path / "settings"))
    return folder


def test_a_new_rig_runs_as_it_is_written(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("EDHAS_CONFIG", str(tmp_path / "settings"))
    assert main(["new", "rig", "my_pot.py"]) == 0
    assert "edhas check my_pot.py:MyPot" in capsys.readouterr().out
    assert main(["simulate", "my_pot.yaml", "--quiet"]) == 2, "its code was not allowed to run"
    assert "not allowed to run" in capsys.readouterr().err
    assert main(["check", "my_pot.py:MyPot", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert all(row["passed"] for row in found["checks"])
    assert main(["trust", "my_pot.py"]) == 0
    assert main(["simulate", "my_pot.yaml", "--quiet"]) == 0
    assert main(["export", "my_pot.yaml", "--out", "pot.fmu", "--sources-only", "--input", "pump_flow", "--quiet"]) == 0
    opened = edhas.open_run("runs/my_pot", trust=["my_pot.py"])
    assert opened.machine.name == "my_pot" and opened.signals["level"][-1] > 0.0
    assert main(["new", "rig", "my_pot.py"]) == 2


def test_from_a_record_to_the_level_at_which_something_is_missing(bench, capsys):
    own = ["--rig", "bench/rig.py:TwoTanks"]
    assert main(["compare", "bench", *own, "--quiet"]) == 0
    assert main(["fit", "bench", *own, "--json"]) in (0, 4)
    capsys.readouterr()
    assert main(["diagnose", "bench", *own, "--out", "without"]) == 0
    printed = capsys.readouterr().out
    assert "most likely it acts on upper tank" in printed
    assert (bench.parent / "without" / "upper_loss_curve_over_upper_level.yaml").is_file()
    again = ["diagnose", "bench", *own, "--effect", "bench/rig.py:Overflow", "--out", "with", "--json"]
    assert main(again) == 0
    found = json.loads((bench.parent / "with" / "diagnosis.json").read_text())
    assert found["candidates"][0]["effect"] == "overflow"
    html = (bench.parent / "with" / "report.html").read_text()
    assert 'data-part="upper_tank"' in html, "the schematic shows the rig's own parts"


def test_a_sensor_that_saturates_is_not_left_out(bench):
    """Where the level is beyond the end of the sensor the model shows the end, and its samples stay."""
    high = edhas.change(TwoTanks(), pump_gain=0.06)
    level = record(bench / "run.csv", high)
    assert (level > 10.5).sum() > 20
    campaign = edhas.read_campaign(bench, ["bench/rig.py"])
    fitted = edhas.compare(campaign, edhas.change(campaign.machine, pump_gain=0.06))
    residuals = fitted.runs[0].residuals["level"]
    assert np.isfinite(residuals).mean() > 0.99
    assert np.abs(residuals[level > 10.5]).max() == 0.0
    assert fitted.rms_over_noise()["run"]["level"] < 1.5


def test_a_plan_from_files_that_hold_the_drives_alone(bench, capsys):
    """Before anything is measured: what would a record of the pump's voltage reveal?"""
    rows = [line.split(",")[:2] for line in (bench / "run.csv").read_text().splitlines()]
    (bench / "run.csv").write_text("\n".join(map(",".join, rows)) + "\n")
    own = ["--rig", "bench/rig.py:TwoTanks", "--effect", "bench/rig.py:Overflow"]
    assert main(["plan", "bench", *own, "--out", "planned", "--json"]) == 0
    found = json.loads((bench.parent / "planned" / "plan.json").read_text())
    (overflow,) = [row for row in found["visible"] if row["effect"] == "overflow"]
    assert overflow["seen"] and overflow["slot"] == "upper_tank"
    assert "so that no next run is proposed" in found["sentence"]
    (bench / "run.csv").unlink()
    capsys.readouterr()
    assert main(["plan", "bench", *own, "--out", "again", "--quiet"]) == 2
    assert "the columns of the drives alone" in capsys.readouterr().err


def test_a_rig_of_the_package_is_named_as_it_is(capsys):
    assert main(["check", "edhas_jax.machine.rigs:PumpBench"]) == 2
    assert "is a rig of the package; write pump_bench" in capsys.readouterr().err


def test_a_new_campaign_of_a_rig_of_ones_own_is_read_and_fitted(bench, capsys):
    own = ["--rig", "bench/rig.py:TwoTanks"]
    assert main(["new", "campaign", "tests_of_mine", *own]) == 0
    assert "edhas campaign check tests_of_mine --rig bench/rig.py:TwoTanks" in capsys.readouterr().out
    text = (bench.parent / "tests_of_mine" / "campaign.yaml").read_text()
    assert "rig: ../bench/rig.py:TwoTanks" in text and "pump_voltage: pump_voltage" in text
    assert main(["campaign", "check", "tests_of_mine", "--rig", "bench/rig.py:TwoTanks"]) == 0
    assert "no errors, no warnings" in capsys.readouterr().out
    assert main(["compare", "tests_of_mine", *own, "--quiet"]) == 0
    campaign = edhas.read_campaign(bench.parent / "tests_of_mine", ["bench/rig.py"])
    assert set(campaign.channels) == {"upper_level", "lower_level", "level"}
    assert 0.9 < edhas.compare(campaign).rms_over_noise()["run1"]["level"] < 1.1
    assert main(["new", "campaign", "tests_of_mine", *own]) == 2, "nothing is written into a folder that is not empty"
