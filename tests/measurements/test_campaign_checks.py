"""The data checks report every fault added to a valid campaign at its line, and nothing else."""

import re

import numpy as np
import pandas as pd
import pytest

from edhas_jax.commands.cli import main
from edhas_jax.core.remark import Severity
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from tests.support import ROOT
from tests.support.faulty_campaign import VALID_CAMPAIGN, copy_campaign, delayed, modify_table, replace_in_yaml

DOCS = ROOT / "docs" / "campaigns.md"
TIME, CURRENT, POSITION = "time [ms]", "current [A]", "piston_position [mm]"
PRESSURE, FLOW = "outlet_pressure [MPa]", "outlet_flow [L/min]"


def in_column(run, column, function):
    """A fault: the values of a column are changed by a function."""

    def changed(frame):
        return frame.assign(**{column: function(frame[column].to_numpy().copy())})

    return lambda folder: modify_table(folder, run, changed)


def in_table(run, function):
    """A fault: the table of a run is changed by a function."""
    return lambda folder: modify_table(folder, run, function)


def in_yaml(old, new):
    """A fault: a text in campaign.yaml is replaced."""
    return lambda folder: replace_in_yaml(folder, old, new)


def with_value(value, first, last):
    def function(values):
        values[first:last] = value(values) if callable(value) else value
        return values

    return function


def with_jitter(frame):
    time = frame[TIME] + np.random.default_rng(0).normal(0.0, 0.02, len(frame))
    return frame.assign(**{TIME: time})


def with_spikes(values):
    values[[301, 420, 633, 800, 951]] = 50.0
    return values


def only_noise(values):
    return values.mean() + values.std() * np.random.default_rng(0).standard_normal(len(values))


def exchanged(frame):
    return frame.assign(**{"voltage [V]": frame[CURRENT], CURRENT: frame["voltage [V]"]})


def saturated_pressure(folder):
    for run in ("run3.csv", "run4.csv", "run8.csv"):
        modify_table(folder, run, lambda f: f.assign(**{PRESSURE: 1.0 * np.tanh(f[PRESSURE])}))


def truncate(folder):
    path = folder / "run4.csv"
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[:900]) + lines[900][:17])


FAULTS = {
    "gap": (in_table("run3.csv", lambda f: f.drop(index=range(400, 460))), "run3.csv", 401, "60 samples are missing"),
    "repeated time": (in_table("run3.csv", lambda f: pd.concat([f[:500], f[499:]])), "run3.csv", 502, "not come after"),
    "jitter": (in_table("run3.csv", with_jitter), "run3.csv", None, "time stamps jitter"),
    "clipped": (in_column("run3.csv", PRESSURE, lambda v: v.clip(max=0.9 * v.max())), "run3.csv", None, "clipped"),
    "stuck": (in_column("run3.csv", FLOW, with_value(lambda v: v[700], 700, 780)), "run3.csv", 702, "stuck at"),
    "bar as MPa": (in_column("run8.csv", PRESSURE, lambda v: 10 * v), "run8.csv", 1, "numbers in bar, read as MPa"),
    "gauge": (in_column("run8.csv", PRESSURE, lambda v: v - 0.101325), "run8.csv", 1, "gauge pressure"),
    "late": (in_column("run4.csv", CURRENT, lambda v: delayed(v, 15)), "run4.csv", 0, "current is"),
    "early": (in_column("run3.csv", POSITION, lambda v: delayed(v, -20)), "run3.csv", 0, "early against the other"),
    "slow": (in_table("run4.csv", lambda f: f[::10]), "run4.csv", 2, "sampled too slowly"),
    "missing values": (in_column("run3.csv", CURRENT, with_value(np.nan, 500, 560)), "run3.csv", 502, "up to line 561"),
    "truncated": (truncate, "run4.csv", 901, "truncated"),
    "missing column": (in_table("run4.csv", lambda f: f.drop(columns=FLOW)), "run4.csv", 1, "no column `outlet_flow`"),
    "unknown unit": (
        in_table("run4.csv", lambda f: f.rename(columns={FLOW: "outlet_flow [lpm]"})), "run4.csv", 1, 'unit "lpm"',
    ),
    "not in the rig": (in_yaml("  outlet_flow:", "  head_pressure:"), "campaign.yaml", 15, "no such signal"),
    "no noise": (in_yaml("unit: A, noise: 0.02", "unit: A, noise: 0"), "campaign.yaml", 12, "must be above 0"),
    "too little noise": (
        in_yaml("unit: A, noise: 0.02", "unit: A, noise: 0.002"), "campaign.yaml", 0, "current 0.002 A stated, 0.01",
    ),
    "too much noise": (
        in_yaml("unit: A, noise: 0.02", "unit: A, noise: 20"), "campaign.yaml", 0, "current 20 A stated, 0.01",
    ),
    "drop-out": (
        in_column("run3.csv", PRESSURE, with_value(0.0, 700, 702)), "run3.csv", 702, "outlier of 0 Pa at 0.14 s (2",
    ),
    "spikes": (in_column("run3.csv", PRESSURE, with_spikes), "run3.csv", 303, "5 isolated outliers"),
    "exchanged": (in_table("run4.csv", exchanged), "run4.csv", 0, "voltage and current seem to be exchanged"),
    "only noise": (in_column("run4.csv", POSITION, only_noise), "run4.csv", 0, "piston_position is only noise"),
    "reversed": (in_column("run3.csv", CURRENT, lambda v: -v), "run3.csv", 0, "current has the opposite sign"),
    "not connected": (in_column("run3.csv", FLOW, lambda v: 0.0 * v), "run3.csv", 2, "outlet_flow: stuck at 0"),
    "saturated": (saturated_pressure, "run3.csv", 0, "does the sensor saturate"),
    "time unit": (in_table("run4.csv", lambda f: f.rename(columns={TIME: "time [us]"})), "run4.csv", 2, "unit of time"),
    "outlier": (in_column("run3.csv", CURRENT, with_value(30.0, 600, 601)), "run3.csv", 602, "outlier of 30 A"),
    "conditions": (in_yaml("frequency: 30 Hz", "frequency: 20 Hz"), "run4.csv", 0, "made under these conditions"),
}  # fmt: skip


def errors_and_warnings(folder):
    return [r for r in checked_campaign(read_campaign(folder)).remarks if r.severity is not Severity.NOTE]


def test_a_valid_campaign_has_no_remarks():
    assert not checked_campaign(read_campaign(VALID_CAMPAIGN)).remarks


@pytest.mark.parametrize("kind", FAULTS)
def test_every_fault_is_reported_at_its_line(kind, tmp_path):
    add_fault, file, line, sentence = FAULTS[kind]
    folder = copy_campaign(tmp_path / "bench")
    add_fault(folder)
    found = errors_and_warnings(folder)
    match = [r for r in found if sentence in r.sentence and r.file.name == file and line in (None, r.line)]
    assert match, found
    # files without a fault have no remarks, except where the fault in campaign.yaml concerns all runs
    concerns_all_runs = {"no noise", "not in the rig"}
    assert kind in concerns_all_runs or {r.file.name for r in found} == {file}


def test_a_delay_in_every_run_is_reported_and_a_lag_is_not(tmp_path):
    from edhas_jax.measurements.sensor_models import SensorLag

    late, slow = copy_campaign(tmp_path / "late"), copy_campaign(tmp_path / "slow")
    for run in ("run3.csv", "run4.csv", "run8.csv"):
        modify_table(late, run, lambda f: f.assign(**{FLOW: delayed(f[FLOW].to_numpy(), 20)}))

        def lagged(f):
            got = np.asarray(SensorLag(lag_time=2e-3).record(1e-3 * f[TIME].to_numpy(), f[PRESSURE].to_numpy()))
            return f.assign(**{PRESSURE: got + np.random.default_rng(0).normal(0.0, 1.5e-3, len(f))})

        modify_table(slow, run, lagged)
    assert any("outlet_flow is" in r.sentence and "in every run" in r.sentence for r in errors_and_warnings(late))
    assert not errors_and_warnings(slow)


def test_the_template_passes_the_check(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["campaign", "new", "mine"]) == 0
    assert main(["campaign", "check", "mine"]) == 0
    assert "no errors, no warnings" in capsys.readouterr().out
    assert main(["campaign", "new", "mine"]) == 2
    assert "exists already" in capsys.readouterr().err


def test_the_command_prints_file_line_and_sentence(tmp_path, capsys):
    folder = copy_campaign(tmp_path / "bench")
    modify_table(folder, "run3.csv", lambda f: f.drop(index=range(400, 460)))
    assert main(["campaign", "check", str(folder)]) == 1
    printed = capsys.readouterr().out
    assert "run3.csv" in printed and "401" in printed and "60 samples are missing" in printed
    (folder / "campaign.yaml").write_text("rig: pump_bench\n")
    assert main(["campaign", "check", str(folder)]) == 2
    assert "signals: missing" in capsys.readouterr().err


def test_the_documented_steps_from_a_csv_file_to_the_first_comparison(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    page = DOCS.read_text(encoding="utf-8")
    header = re.search(r"```\n(.*)\n", page)[1]
    (config, *_), (shell,), (python,) = (
        re.findall(rf"```{k}\n(.*?)```", page, re.DOTALL) for k in ("yaml", "sh", "python")
    )
    assert main(["campaign", "new", "mine"]) == 0
    logged = pd.read_csv(VALID_CAMPAIGN / "run3.csv")
    logged = logged.assign(**{POSITION: 1e3 * logged[POSITION], PRESSURE: 1e3 * logged[PRESSURE]})
    logged.columns = header.split(",")
    logged.to_csv("mine/bench2.csv", index=False)
    (tmp_path / "mine" / "campaign.yaml").write_text(config)
    for line in shell.strip().splitlines():
        assert main(line.split()[1:]) == 0, capsys.readouterr()
    assert (tmp_path / "first" / "report.html").stat().st_size > 10_000
    names = {}
    exec(compile(python, "campaigns.md", "exec"), names)
    assert np.ptp(names["recorded"]) > 1e5
