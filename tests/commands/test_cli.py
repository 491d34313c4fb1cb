"""The command line from end to end, run in this process."""

import json
import pkgutil
import re
import signal
import subprocess
import sys

import pandas as pd
import pyarrow.parquet as pq
import pytest

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.commands.command_line import COMMANDS
from tests.support import CONFIGS, ROOT

SHORT_RUN = ["--set", "duration=0.25s", "--set", "sample_rate=2kHz", "--no-figure"]


@pytest.fixture()
def working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_simulate_writes_a_folder_that_reopens(working_folder, capsys):
    assert main(["simulate", str(CONFIGS / "paper.yaml"), "--set", "piston_clearance=15um", *SHORT_RUN[:4]]) == 0
    folder = working_folder / "runs" / "paper"
    names = {p.name for p in folder.iterdir()}
    assert names == {
        "timeseries.parquet", "ledger.parquet", "metrics.json", "config.yaml", "figure.png", "run.json", "files.json"
    }  # fmt: skip
    printed = capsys.readouterr().out
    assert "mean_flow" in printed and "L/min" in printed and "lugre_friction" in printed and "step 20 µs" in printed

    table = pd.read_parquet(folder / "timeseries.parquet")
    assert len(table) == 501 and table["time"].iloc[-1] == pytest.approx(0.25)
    assert pq.read_schema(folder / "timeseries.parquet").field("outlet_pressure").metadata[b"unit"] == b"Pa"
    metrics = json.loads((folder / "metrics.json").read_text())
    run = edhas.open_run(folder)
    assert metrics["mean_flow"]["value"] == pytest.approx(run.metrics["mean_flow"].value, rel=1e-12)
    assert edhas.get(run.machine, "piston_clearance") == 15e-6

    # what was written runs again, to the same result
    assert main(["simulate", str(folder / "config.yaml"), "--out", "again", "--no-figure"]) == 0
    again = edhas.open_run(working_folder / "again")
    assert again.metrics["mean_flow"].value == pytest.approx(run.metrics["mean_flow"].value, rel=1e-10)


def test_existing_folders_are_not_overwritten_without_the_option(working_folder, capsys):
    arguments = ["simulate", str(CONFIGS / "actuator.yaml"), *SHORT_RUN]
    assert main(arguments) == 0 and main(arguments) == 0
    assert (working_folder / "runs" / "actuator").is_dir() and (working_folder / "runs" / "actuator-2").is_dir()
    manifest = (working_folder / "runs" / "actuator" / "run.json").read_bytes()
    assert main([*arguments, "--out", "runs/actuator"]) == 2
    assert "exists already" in capsys.readouterr().err
    assert (working_folder / "runs" / "actuator" / "run.json").read_bytes() == manifest
    assert main([*arguments, "--out", "runs/actuator", "--overwrite"]) == 0
    (working_folder / "precious").mkdir()
    assert main([*arguments, "--out", "precious", "--overwrite"]) == 2
    assert "is not a run folder" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--set", "piston_clearence=15um"], "nearest: piston_clearance"),
        (["--set", "piston_clearance=15"], "a unit is missing"),
        (["--set", "piston_clearance=15 MPa"], "length"),
        (["--set", "mover_mass=-1 kg"], "must lie in"),
        (["--set", "step=1 ms"], "100 µs"),
        (["--set", "nonsense"], "write name=value"),
    ],
)
def test_bad_overrides_exit_with_one_message(working_folder, capsys, arguments, message):
    assert main(["simulate", str(CONFIGS / "paper.yaml"), *arguments]) == 2
    caught = capsys.readouterr()
    assert message in caught.err and len(caught.err.strip().splitlines()) == 1 and not caught.out
    assert not (working_folder / "runs").exists()


def test_an_unstable_run_is_reported_with_time_and_signal(working_folder, capsys):
    unstable = ["--set", "amplitude=20 mm", "--set", "stop_stiffness=1 kN/m"]
    assert main(["simulate", str(CONFIGS / "paper.yaml"), *unstable, *SHORT_RUN]) == 2
    message_text = capsys.readouterr().err
    assert re.match(r"edhas: at 0\.\d+ s piston_position left its physical range \(step 20 µs\)", message_text)
    assert not (working_folder / "runs").exists()


def test_a_run_without_a_whole_cycle_has_no_metrics(working_folder, capsys):
    assert main(["simulate", str(CONFIGS / "paper.yaml"), "--out", "short", "--set", "duration=50ms"]) == 0
    assert "no metrics: no whole cycle after the ramp" in capsys.readouterr().out
    assert set(json.loads((working_folder / "short" / "metrics.json").read_text())) == {"status", "valid", "reason"}
    assert len(edhas.open_run(working_folder / "short").frame()) == 251


def test_an_interrupted_run_keeps_the_finished_samples(working_folder, monkeypatch, capsys):
    from edhas_jax.simulation import run

    original = run.integrate

    def interrupted(machine, begin, h, per_sample, samples):
        if int(begin.step_number) >= 4 * run.SAMPLES_PER_CALL * int(per_sample):
            signal.raise_signal(signal.SIGINT)
        return original(machine, begin, h, per_sample, samples)

    monkeypatch.setattr(run, "integrate", interrupted)
    assert main(["simulate", str(CONFIGS / "paper.yaml"), "--out", "cut", "--no-figure"]) == 130
    printed = capsys.readouterr()
    assert "the run was interrupted" in printed.out
    assert printed.err == "edhas: interrupted; what was finished until then is kept\n"
    assert len(edhas.open_run(working_folder / "cut").frame()) == 4 * run.SAMPLES_PER_CALL


def test_incomplete_run_folders_are_refused(working_folder):
    assert main(["simulate", str(CONFIGS / "actuator.yaml"), "--out", "r", *SHORT_RUN]) == 0
    content = (working_folder / "r" / "timeseries.parquet").read_bytes()
    (working_folder / "r" / "timeseries.parquet").write_bytes(content[: len(content) // 2])
    with pytest.raises(ValueError, match="is damaged, or was changed"):
        edhas.open_run(working_folder / "r")
    (working_folder / "r" / "timeseries.parquet").unlink()
    with pytest.raises(ValueError, match="timeseries.parquet is missing"):
        edhas.open_run(working_folder / "r")


def test_lists_of_parameters_effects_and_schema(working_folder, capsys):
    assert main(["parameters"]) == 0
    listed = capsys.readouterr().out
    for name in ("piston_clearance", "valve_spring_rate", "polytropic_exponent", "karnopp_velocity", "cylinder_bore"):
        assert name in listed
    assert main(["parameters", str(CONFIGS / "actuator.yaml")]) == 0
    assert "cylinder_bore" not in capsys.readouterr().out
    assert main(["effects"]) == 0
    assert "karnopp_friction" in capsys.readouterr().out
    assert main(["effects", "entrained_air"]) == 0
    assert "air_fraction" in capsys.readouterr().out
    assert main(["effects", "entraned_air"]) == 2
    assert "entrained_air" in capsys.readouterr().err
    assert main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads((CONFIGS / "edhas.schema.json").read_text())


def test_help_imports_no_numerical_package():
    """What a command needs is imported when it runs, so that help and completion answer at once."""
    program = (
        "import sys, edhas_jax\n"
        "before = set(sys.modules)\n"
        "from edhas_jax.commands.cli import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "added = {name.partition('.')[0] for name in set(sys.modules) - before}\n"
        "print(sorted(added & {'jax', 'numpy', 'scipy', 'pandas', 'pyarrow', 'matplotlib', 'rich', 'llvmlite'}))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip().splitlines()[-1] == "[]"


def test_every_command_has_help(capsys):
    for command in COMMANDS:
        with pytest.raises(SystemExit) as ended:
            main([*command.name.split(), "--help"])
        assert ended.value.code == 0 and f"usage: edhas {command.name}" in capsys.readouterr().out


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_every_command_has_a_function(command):
    assert callable(pkgutil.resolve_name(f"edhas_jax.commands.{command.run}"))


@pytest.mark.parametrize("arguments", ["effects", "--help", "schema"])
def test_output_that_nobody_reads_is_no_error(arguments):
    command = f"{sys.executable} -m edhas_jax.commands.cli {arguments} | head -1; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0 and not done.stderr and done.stdout
