"""The check of a campaign: every spoilt copy is found, at its line, and nothing is said of the sound one."""

import re

import numpy as np
import pandas as pd
import pytest

from edhas_jax.commands.cli import main
from edhas_jax.measurements.campaign import Severity
from edhas_jax.measurements.campaign_checks import check_campaign
from edhas_jax.measurements.campaign_reader import read_campaign
from tests.support import ROOT
from tests.support.spoilt_campaign import SOUND, copy, describe, moved, record

DOCS = ROOT / "docs" / "campaigns.md"
TIME, CURRENT, POSITION = "time [ms]", "current [A]", "piston_position [mm]"
PRESSURE, FLOW = "outlet_pressure [MPa]", "outlet_flow [L/min]"


def change(run, column, function):
    """A spoiler that changes the numbers of a column."""
    return lambda folder: record(folder, run, lambda f: f.assign(**{column: function(f[column].to_numpy().copy())}))


def table(run, function):
    """A spoiler that changes the table of a run."""
    return lambda folder: record(folder, run, function)


def text(old, new):
    """A spoiler that changes campaign.yaml."""
    return lambda folder: describe(folder, old, new)


def with_value(value, first, last):
    def function(values):
        values[first:last] = value(values) if callable(value) else value
        return values

    return function


def jittered(frame):
    shaken = frame[TIME] + np.random.default_rng(0).normal(0.0, 0.02, len(frame))
    return frame.assign(**{TIME: shaken})


def cut_off(folder):
    path = folder / "run4.csv"
    whole = path.read_text().splitlines(keepends=True)
    path.write_text("".join(whole[:900]) + whole[900][:17])


SPOILT = {
    "gap": (table("run3.csv", lambda f: f.drop(index=range(400, 460))), "run3.csv", 401, "60 samples are missing"),
    "duplicate stamp": (table("run3.csv", lambda f: pd.concat([f[:500], f[499:]])), "run3.csv", 502, "not come after"),
    "jitter": (table("run3.csv", jittered), "run3.csv", None, "time stamps jitter"),
    "clipped": (change("run3.csv", PRESSURE, lambda v: v.clip(max=0.9 * v.max())), "run3.csv", None, "clipped"),
    "stuck": (change("run3.csv", FLOW, with_value(lambda v: v[700], 700, 780)), "run3.csv", 702, "stuck at"),
    "bar as MPa": (change("run8.csv", PRESSURE, lambda v: 10 * v), "run8.csv", 1, "numbers in bar, read as MPa"),
    "gauge": (change("run8.csv", PRESSURE, lambda v: v - 0.101325), "run8.csv", 1, "gauge pressure"),
    "late": (change("run4.csv", CURRENT, lambda v: moved(v, 15)), "run4.csv", 0, "current comes"),
    "early": (change("run3.csv", POSITION, lambda v: moved(v, -20)), "run3.csv", 0, "early against the other signals"),
    "slow": (table("run4.csv", lambda f: f[::10]), "run4.csv", 2, "sampled too slowly"),
    "holes": (change("run3.csv", CURRENT, with_value(np.nan, 500, 560)), "run3.csv", 502, "up to line 561"),
    "cut off": (cut_off, "run4.csv", 901, "cut off"),
    "missing column": (table("run4.csv", lambda f: f.drop(columns=FLOW)), "run4.csv", 1, "no column `outlet_flow`"),
    "unknown unit": (
        table("run4.csv", lambda f: f.rename(columns={FLOW: "outlet_flow [lpm]"})), "run4.csv", 1, 'unit "lpm"',
    ),
    "not in the rig": (text("  outlet_flow:", "  head_pressure:"), "campaign.yaml", 15, "no such signal"),
    "no noise": (text("unit: A, noise: 0.02", "unit: A, noise: 0"), "campaign.yaml", 12, "must be above 0"),
    "too little noise": (text("unit: A, noise: 0.02", "unit: A, noise: 0.002"), "run3.csv", 2, "times the 0.002 A"),
    "time unit": (table("run4.csv", lambda f: f.rename(columns={TIME: "time [us]"})), "run4.csv", 2, "unit of time"),
    "outlier": (change("run3.csv", CURRENT, with_value(30.0, 600, 601)), "run3.csv", 602, "lone sample of 30 A"),
    "conditions": (text("frequency: 30 Hz", "frequency: 20 Hz"), "run4.csv", 0, "are these the conditions"),
}  # fmt: skip


def findings(folder):
    return [r for r in check_campaign(read_campaign(folder)) if r.severity is not Severity.NOTE]


def test_nothing_is_said_of_a_sound_campaign():
    assert not check_campaign(read_campaign(SOUND))


@pytest.mark.parametrize("kind", SPOILT)
def test_what_is_spoilt_is_found(kind, tmp_path):
    spoil, file, line, said = SPOILT[kind]
    folder = copy(tmp_path / "bench")
    spoil(folder)
    found = findings(folder)
    match = [r for r in found if said in r.sentence and r.file.name == file and line in (None, r.line)]
    assert match, found
    # nothing is said of files that are as they were
    alike = {"no noise", "too little noise", "not in the rig"}
    assert kind in alike or {r.file.name for r in found} == {file}


def test_a_delay_in_every_run_is_told_and_a_lag_is_not(tmp_path):
    from edhas_jax.measurements.sensor_models import SensorLag

    late, slow = copy(tmp_path / "late"), copy(tmp_path / "slow")
    for run in ("run3.csv", "run4.csv", "run8.csv"):
        record(late, run, lambda f: f.assign(**{FLOW: moved(f[FLOW].to_numpy(), 20)}))

        def lagged(f):
            got = np.asarray(SensorLag(lag_time=2e-3).record(1e-3 * f[TIME].to_numpy(), f[PRESSURE].to_numpy()))
            return f.assign(**{PRESSURE: got + np.random.default_rng(0).normal(0.0, 1.5e-3, len(f))})

        record(slow, run, lagged)
    assert any("outlet_flow comes" in r.sentence and "in every run" in r.sentence for r in findings(late))
    assert not findings(slow)


def test_the_template_passes_the_check(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["campaign", "new", "mine"]) == 0
    assert main(["campaign", "check", "mine"]) == 0
    assert "no errors, no warnings" in capsys.readouterr().out
    assert main(["campaign", "new", "mine"]) == 2
    assert "exists already" in capsys.readouterr().err


def test_the_command_says_where_and_what(tmp_path, capsys):
    folder = copy(tmp_path / "bench")
    record(folder, "run3.csv", lambda f: f.drop(index=range(400, 460)))
    assert main(["campaign", "check", str(folder)]) == 1
    printed = capsys.readouterr().out
    assert "run3.csv" in printed and "401" in printed and "60 samples are missing" in printed
    (folder / "campaign.yaml").write_text("rig: pump_bench\n")
    assert main(["campaign", "check", str(folder)]) == 2
    assert "signals: missing" in capsys.readouterr().err


def test_the_way_in_the_docs_from_a_csv_of_ones_own_to_the_first_comparison(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    page = DOCS.read_text(encoding="utf-8")
    header = re.search(r"```\n(.*)\n", page)[1]
    (config,), (shell,), (python,) = (
        re.findall(rf"```{k}\n(.*?)```", page, re.DOTALL) for k in ("yaml", "sh", "python")
    )
    assert main(["campaign", "new", "mine"]) == 0
    own = pd.read_csv(SOUND / "run3.csv")
    own = own.assign(**{POSITION: 1e3 * own[POSITION], PRESSURE: 1e3 * own[PRESSURE]})
    own.columns = header.split(",")
    own.to_csv("mine/bench2.csv", index=False)
    (tmp_path / "mine" / "campaign.yaml").write_text(config)
    for line in shell.strip().splitlines():
        assert main(line.split()[1:]) == 0, capsys.readouterr()
    assert (tmp_path / "first" / "report.html").stat().st_size > 10_000
    names = {}
    exec(compile(python, "campaigns.md", "exec"), names)
    assert np.ptp(names["seen"]) > 1e5
