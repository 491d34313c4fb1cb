"""What commands print: JSON, nothing, the next command, tables that nothing cuts; beginnings, examples, completion."""

import dataclasses
import json
import re
import subprocess
import sys
import types

import pytest

import edhas_jax as edhas
from edhas_jax.commands import progress
from edhas_jax.commands.cli import main
from edhas_jax.commands.command_line import NOT_CONVERGED
from edhas_jax.config.examples import FOLDER, list_examples
from edhas_jax.design.sensitivity.config import load_sensitivity
from edhas_jax.design.sizing.config import load_sizing
from edhas_jax.design.sweep.config import load_sweep
from edhas_jax.tasks import fit as task
from tests.support import CONFIGS

SHORT = ["--set", "duration=0.25s", "--set", "sample_rate=2kHz", "--no-figure"]


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("arguments", "table"),
    [
        (["simulate", str(CONFIGS / "actuator.yaml"), *SHORT], "metrics"),
        (["parameters", str(CONFIGS / "paper.yaml")], "parameters"),
        (["effects"], "effects"),
        (["effects", "entrained_air"], "parameters"),
        (["examples"], "examples"),
        (["device"], "engines"),
        (["trust"], "files"),
        (["campaign", "check", str(FOLDER / "campaign")], None),
    ],
)
def test_json_is_the_whole_output(arguments, table, capsys):
    status = main([*arguments, "--json"])
    printed = json.loads(capsys.readouterr().out)
    assert status == 0 and (table is None or isinstance(printed[table], list))


def test_json_has_numbers_in_si(capsys):
    assert main(["parameters", str(CONFIGS / "paper.yaml"), "--json"]) == 0
    rows = {row["parameter"]: row for row in json.loads(capsys.readouterr().out)["parameters"]}
    assert rows["piston_clearance"]["value"] == 20e-6 and rows["piston_clearance"]["unit"] == "m"


def test_quiet_prints_nothing(capsys):
    assert main(["simulate", str(CONFIGS / "actuator.yaml"), *SHORT, "--quiet"]) == 0
    caught = capsys.readouterr()
    assert not caught.out and not caught.err and edhas.open_result("runs/actuator").valid


def test_overwriting_replaces_the_folder_of_the_same_name(here, capsys):
    """Without --out: numbered beside it without --overwrite, in its place with it."""
    config = str(CONFIGS / "actuator.yaml")
    for more in ([], [], ["--overwrite"], ["--overwrite"], ["--set", "frequency=20Hz", "--overwrite"]):
        assert main(["simulate", config, *SHORT, *more]) == 0
    assert {p.name for p in (here / "runs").iterdir()} == {"actuator", "actuator-2"}
    assert "written to runs/actuator:" in capsys.readouterr().out.splitlines()[-2]
    saved = [edhas.open_result(f"runs/{name}") for name in ("actuator", "actuator-2")]
    assert [edhas.get(run.machine, "frequency") for run in saved] == [20.0, 10.0]


def test_a_command_ends_with_the_next_one_and_cuts_nothing(capsys):
    assert main(["parameters", str(CONFIGS / "paper.yaml")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1].startswith("next: edhas simulate ") and "…" not in lines[-1]
    assert main(["parameters", str(CONFIGS / "paper.yaml"), "--json"]) == 0
    for wanted in json.loads(capsys.readouterr().out)["parameters"]:
        row = next(line for line in lines if line.lstrip().startswith(f"{wanted['parameter']} "))
        assert wanted["meaning"] in row and row.rstrip().endswith(wanted["source"])


def test_bare_edhas_shows_the_commands(capsys):
    assert main([]) == 0
    printed = capsys.readouterr().out
    assert "usage: edhas" in printed and "diagnose" in printed and "Exit status" in printed


RIGS = [("pump", "pump_bench"), ("actuator", "actuator_bench"), ("system", "actuator_system")]


@pytest.mark.parametrize(("kind", "rig"), RIGS)
def test_a_beginning_is_the_nominal_machine(here, kind, rig, capsys):
    """As it is, and with every default taken in: what is written beside a parameter is its value."""
    assert main(["new", kind]) == 0 and f"next: edhas simulate my_{kind}.yaml" in capsys.readouterr().out
    config = edhas.load(f"my_{kind}.yaml")
    assert config.machine.name == rig and config.machine.effects
    text = (here / f"my_{kind}.yaml").read_text(encoding="utf-8")
    all_taken_in = re.sub(r"^  # (\S+: .*#)", r"  \1", text.partition("simulation:")[0], flags=re.MULTILINE)
    assert all_taken_in.count("\n  #") < 20 < text.count("\n  #"), "the names of the components alone are left"
    (here / "all.yaml").write_text(all_taken_in, encoding="utf-8")
    assert edhas.model("all.yaml").parameters == pytest.approx(edhas.model(config).parameters, rel=1e-12)
    assert main(["new", kind]) == 2 and "exists already" in capsys.readouterr().err


TASK_READERS = {"sweep": load_sweep, "size": load_sizing, "sensitivity": load_sensitivity}


@pytest.mark.parametrize("kind", TASK_READERS)
def test_a_beginning_of_a_task_is_one_that_its_command_reads(here, kind, capsys):
    assert main(["new", kind]) == 0 and f"next: edhas {kind} my_{kind}.yaml" in capsys.readouterr().out
    read = TASK_READERS[kind](here / f"my_{kind}.yaml")
    assert read.name == f"my_{kind}" and read.machine.name == "pump_bench"
    assert main(["new", kind]) == 2 and "exists already" in capsys.readouterr().err
    assert main(["new", kind, "--overwrite"]) == 0


def test_the_beginning_of_a_sweep_may_be_based_on_that_of_a_machine(here):
    """As its comment says."""
    assert main(["new", "sweep"]) == 0 and main(["new", "pump"]) == 0
    text = (here / "my_sweep.yaml").read_text(encoding="utf-8")
    assert "`base: my_pump.yaml`" in text
    own = text.partition("machine:")[0] + "base: my_pump.yaml\nparameters:" + text.partition("\nparameters:")[2]
    (here / "mine.yaml").write_text(own, encoding="utf-8")
    based, given = load_sweep(here / "mine.yaml"), load_sweep(here / "my_sweep.yaml")
    assert based.axes == given.axes and [e.id for e in based.machine.effects] == [e.id for e in given.machine.effects]


def test_a_new_campaign_passes_its_check(capsys):
    assert main(["new", "campaign", "bench"]) == 0
    assert "next: edhas campaign check bench" in capsys.readouterr().out
    assert main(["campaign", "check", "bench"]) == 0


def test_examples_are_listed_and_copied(here, capsys):
    assert main(["examples"]) == 0
    printed = capsys.readouterr().out
    assert all(example.name in printed and example.about for example in list_examples())
    assert main(["examples", "size_pump.yaml", "--out", "mine"]) == 0
    assert {p.name for p in (here / "mine").iterdir()} == {"size_pump.yaml", "paper.yaml"}
    assert load_sizing("mine/size_pump.yaml").starts
    assert main(["examples", "--all", "--out", "mine"]) == 0
    assert load_sensitivity("mine/sensitivity.yaml").metrics and edhas.read_campaign("mine/campaign").runs
    assert main(["examples", "no.yaml"]) == 2 and "no such example" in capsys.readouterr().err


def test_every_example_names_its_command():
    for example in list_examples():
        command, _, name = example.command.partition(" ")
        load = {"simulate": edhas.load, "sweep": edhas.load_sweep, "size": load_sizing, "sensitivity": load_sensitivity,
                "diagnose": edhas.read_campaign}[command]  # fmt: skip
        assert load(FOLDER / name)


def test_completion_knows_commands_and_options(capsys):
    assert main(["completion", "bash"]) == 0
    script = capsys.readouterr().out
    assert "sensitivity" in script and "--overwrite" in script
    checked = subprocess.run(["bash", "-n"], input=script, text=True, capture_output=True)
    assert checked.returncode == 0, checked.stderr


def test_the_file_of_progress_has_each_report_once_also_when_quiet(tmp_path, monkeypatch, capsys):
    file = tmp_path / "reports"
    monkeypatch.setenv(progress.VARIABLE, str(file))
    with progress.WorkProgress(types.SimpleNamespace(quiet=True), "beginning") as work:
        for share in (0.25, 0.25, 0.5):
            work("fitting", share)
    rows = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    assert [(row["what"], row.get("share")) for row in rows] == [
        ("beginning", None), ("fitting", 0.25), ("fitting", 0.5),
    ]  # fmt: skip
    assert not capsys.readouterr().err


def test_a_line_of_progress_now_and_then(monkeypatch, capsys):
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    with progress.WorkProgress(None, "beginning") as work:
        work("first")
        now[0] += progress.LINE_INTERVAL + 0.1
        work("second \x1b[31m", 0.25)
        work("third")
        now[0] += progress.LINE_INTERVAL + 0.1
        work.share(0.5)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2 and lines[0].startswith("edhas: second") and lines[0].endswith(", 25 %")
    assert "\x1b" not in lines[0] and lines[1] == "edhas: third, 50 %"
    with progress.WorkProgress(types.SimpleNamespace(began=now[0] - progress.FIRST_LINE - 0.1), "beginning"):
        assert capsys.readouterr().err == "edhas: beginning\n", "so much has passed before the work begins"
    with progress.WorkProgress(types.SimpleNamespace(quiet=True)) as work:
        now[0] += 100.0
        work("nothing")
    assert not capsys.readouterr().err


def test_a_fit_that_has_not_converged_says_so_first(monkeypatch, capsys):
    original = task.fit_with_choices

    def unfinished(*arguments, **options):
        campaign, found = original(*arguments, **options)
        return campaign, dataclasses.replace(found, converged=False)

    monkeypatch.setattr(task, "fit_with_choices", unfinished)
    monkeypatch.setattr(task, "fit_each_run", lambda *_: None)
    monkeypatch.setattr(task, "assumed_parameters", lambda *_: [])
    status = main(["fit", str(FOLDER / "campaign"), "--starts", "1", "--out", "fitted"])
    lines = [line for line in capsys.readouterr().out.splitlines() if line.strip()]
    assert status == NOT_CONVERGED
    title = next(k for k, line in enumerate(lines) if "parameters calibrated" in line)
    assert lines[title + 1].startswith("The fit has not converged")
    assert edhas.open_result("fitted").numbers["converged"] is False


def test_the_command_line_without_a_terminal_prints_to_pipes_alone(here):
    """In a process of its own: output and errors apart, in JSON as in text."""
    command = [sys.executable, "-m", "edhas_jax.commands.cli", "effects", "entrained_air", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0 and not done.stderr and json.loads(done.stdout)["title"] == "entrained_air"
