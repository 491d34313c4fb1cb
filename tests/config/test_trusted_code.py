"""Python code that a configuration, a campaign or a result names runs only if the user has allowed it."""

import json
import os
import subprocess
import sys
import textwrap
from concurrent.futures import Future

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.config.machine_config import ConfigError, read_config
from edhas_jax.config.result_files import ResultFileError
from edhas_jax.core.trusted_code import TrustedCode, TrustError
from edhas_jax.machine.effects import EffectError
from edhas_jax.machine.effects.loading import load_effect

CODE = """
    from pathlib import Path
    from edhas_jax import Controller, Effect, par

    Path({mark!r}).write_text("ran")

    class Drag(Effect):
        drag: float = par(1.0, "N*s/m", (0.0, 10.0), "damping")

        def mover_friction(self, s, z):
            return self.drag * s.piston_velocity

    class Gain(Controller):
        gain: float = par(2e3, "V/m", (0.0, 1e6), "gain")

        def command(self, y, s):
            return self.gain * (s.reference - s.piston_position)
"""
EFFECT = "rig: actuator_bench\neffects: [notes.py:Drag]\nparameters: {drag: 2 N*s/m}\nsimulation: {duration: 0.3 s}\n"
CONTROLLER = "rig: actuator_bench\ncontroller: {kind: notes.py:Gain, gain: 3 kV/m}\n"
CAMPAIGN = """
    name: given
    rig: actuator_bench
    controller: {kind: notes.py:Gain}
    signals: {current: {unit: A, noise: 0.02}}
    runs: [{file: run.csv, use: fit}]
"""
SWEEP = "base: machine.yaml\nsweep: {kind: grid, parameters: {frequency: [5 Hz, 10 Hz]}}\n"


@pytest.fixture
def given(tmp_path, monkeypatch):
    """A folder with files of somebody else, in which the commands are called; `given/ran` is there if code has run."""
    folder = tmp_path / "given"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setenv("EDHAS_CONFIG", str(tmp_path / "settings"))
    write_code(folder)
    return folder


def write_code(folder, addition=""):
    text = textwrap.dedent(CODE).format(mark=str(folder / "ran")) + addition
    (folder / "notes.py").write_text(text)


def machine_file(folder, text=EFFECT):
    (folder / "machine.yaml").write_text(text)
    (folder / "sweep.yaml").write_text(SWEEP)
    (folder / "campaign.yaml").write_text(textwrap.dedent(CAMPAIGN))
    return folder / "machine.yaml"


def did_run(folder):
    return (folder / "ran").exists()


def has_run(folder):
    """Whether the code has run since it was asked for the last time."""
    ran = did_run(folder)
    (folder / "ran").unlink(missing_ok=True)
    return ran


@pytest.mark.parametrize(
    "command",
    [
        "simulate machine.yaml", "parameters machine.yaml", "effects --config machine.yaml", "export machine.yaml",
        "sweep sweep.yaml", "size sweep.yaml", "sensitivity sweep.yaml", "compare bench --model machine.yaml",
    ],
)  # fmt: skip
@pytest.mark.parametrize("text", [EFFECT, CONTROLLER], ids=["effect", "controller"])
def test_a_configuration_runs_no_code(given, capsys, command, text):
    machine_file(given, text)
    if "compare" in command:
        bench = edhas.__file__.replace("edhas_jax/__init__.py", "tests/data/campaign_bench")
        command = command.replace("bench", bench)
    assert main(command.split()) == 2
    error = capsys.readouterr().err
    assert "notes.py: is Python code that was not allowed to run" in error and "edhas trust notes.py" in error
    assert ("--effect notes.py:Drag" if text is EFFECT else "--controller notes.py:Gain") in error
    assert not did_run(given)


@pytest.mark.parametrize("command", ["campaign check", "compare", "fit", "diagnose", "plan", "add"])
def test_a_campaign_runs_no_code(given, capsys, command):
    machine_file(given)
    extra = ["cogging_force"] if command.startswith("add") else []
    assert main([*command.split(), str(given), *extra]) == 2
    assert "edhas trust notes.py" in capsys.readouterr().err and not did_run(given)


def test_a_module_beside_a_configuration_is_not_imported(given, monkeypatch, capsys):
    monkeypatch.syspath_prepend(given)
    machine_file(given, "rig: actuator_bench\neffects: [notes:Drag]\n")
    assert main(["parameters", "machine.yaml"]) == 2
    assert "notes: is a Python module that was not allowed to run" in capsys.readouterr().err
    assert not did_run(given) and "notes" not in sys.modules
    assert main(["parameters", "machine.yaml", "--effect", "notes:Drag"]) == 0 and did_run(given)
    del sys.modules["notes"]


def test_code_that_the_command_names_runs(given, capsys):
    machine_file(given)
    (given / "other.py").write_text("")
    assert main(["parameters", "machine.yaml", "--effect", "other.py:Drag"]) == 2 and not did_run(given)
    assert main(["parameters", "machine.yaml", "--effect", "notes.py:Drag"]) == 0 and did_run(given)
    assert "drag" in capsys.readouterr().out


@pytest.mark.parametrize("option", ["--effect notes.py:Drag", "--controller notes.py:Gain", "--effect lugre_friction"])
def test_code_that_no_file_names_is_refused(given, capsys, option):
    machine_file(given, "rig: actuator_bench\n")
    assert main(["parameters", "machine.yaml", *option.split()]) == 2 and not did_run(given)
    assert f"{option}: no file that was read names it" in capsys.readouterr().err


def test_code_that_the_call_names_runs(given):
    path = machine_file(given)
    with pytest.raises(ConfigError, match=r"trust=\[\"notes.py\"\]"):
        edhas.load(path)
    assert not did_run(given)
    assert edhas.get(edhas.load(path, trust=["notes.py"]).machine, "drag") == 2.0 and did_run(given)


def test_code_that_was_allowed_once_runs_until_it_changes(given, capsys):
    machine_file(given)
    assert main(["trust", "notes.py"]) == 0 and not did_run(given)
    assert main(["trust"]) == 0 and "notes.py" in capsys.readouterr().out
    assert main(["parameters", "machine.yaml"]) == 0 and has_run(given)
    write_code(given, "\nx = 1\n")
    assert main(["parameters", "machine.yaml"]) == 2 and not did_run(given)
    assert "notes.py: has changed since it was allowed to run" in capsys.readouterr().err
    edhas.trust("notes.py")
    assert main(["parameters", "machine.yaml"]) == 0 and has_run(given)
    assert main(["trust", "--remove", "notes.py"]) == 0
    write_code(given)  # the content that was allowed first, and is no more
    (given / "elsewhere").mkdir()
    (given / "notes.py").rename(given / "elsewhere/notes.py")
    assert main(["parameters", "machine.yaml", "--effect", "notes.py:Drag"]) == 2 and not did_run(given)
    machine_file(given, EFFECT.replace("notes.py", "elsewhere/notes.py"))
    assert main(["parameters", "machine.yaml"]) == 2 and not did_run(given)


def test_what_runs_is_what_was_allowed(given, monkeypatch):
    allows = TrustedCode.allows_file

    def allows_and_swaps(self, path, content):
        other = given / "other"
        other.write_text(f"open({str(given / 'swapped')!r}, 'w')\n")
        other.replace(path)
        return allows(self, path, content)

    monkeypatch.setattr(TrustedCode, "allows_file", allows_and_swaps)
    assert load_effect("notes.py:Drag", given, trust=["notes.py"]).__name__ == "Drag"
    assert did_run(given) and not (given / "swapped").exists()


def test_a_list_that_others_can_write_is_not_used(given, tmp_path, capsys):
    machine_file(given)
    edhas.trust("notes.py")
    (tmp_path / "settings/trusted_code").chmod(0o666)
    assert main(["parameters", "machine.yaml"]) == 2
    assert "chmod go-w" in capsys.readouterr().err and not did_run(given)
    with pytest.raises(TrustError, match="open to other users"):
        edhas.trust("notes.py")
    (tmp_path / "settings/trusted_code").chmod(0o600)
    (tmp_path / "settings").chmod(0o777)
    assert main(["parameters", "machine.yaml"]) == 2 and not did_run(given)


@pytest.mark.parametrize("kind", ["missing", "pipe", "folder", "text"])
def test_what_cannot_be_allowed(given, capsys, kind):
    path = given / ("a.txt" if kind == "text" else "a.py")
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "text":
        path.write_text("")
    assert main(["trust", str(path)]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize("text", [EFFECT, CONTROLLER], ids=["effect", "controller"])
@pytest.mark.parametrize("gone", [False, True], ids=["code there", "code gone"])
def test_a_run_folder_is_opened_without_its_code(given, text, gone):
    config = edhas.load(machine_file(given, text), trust=["notes.py"])
    run = edhas.simulate(config.machine, edhas.Simulation(duration=0.3))
    edhas.save_run(run, given / "run", figure=False)
    forget_code(given)
    edhas.trust("notes.py")  # even then
    if gone:
        (given / "notes.py").unlink()
    opened = edhas.open_run(given / "run")
    assert not did_run(given)
    assert opened.metrics == run.metrics and opened.energy_residual() == run.energy_residual()
    assert opened.ledger().equals(run.ledger())
    np.testing.assert_array_equal(opened.signals["current"], run.signals["current"])
    opened.plot()
    for use in (lambda: edhas.simulate(opened.machine), lambda: edhas.save_run(opened, given / "copy")):
        with pytest.raises((EffectError, ValueError), match="open the result with trust="):
            use()
    if not gone:
        again = edhas.open_run(given / "run", trust=["notes.py"])
        assert did_run(given) and again.machine == run.machine or again.row_groups() == run.row_groups()


def forget_code(given):
    """As a new process: nothing of the user's has run yet."""
    for name in [n for n in sys.modules if n.startswith("_edhas_effects_of_notes")]:
        del sys.modules[name]
    (given / "ran").unlink(missing_ok=True)


@pytest.mark.parametrize("state", ["finished", "unfinished"])
def test_a_sweep_folder_is_opened_without_its_code(given, capsys, state):
    machine_file(given)
    assert main(["sweep", "sweep.yaml", "--out", "swept", "--effect", "notes.py:Drag"]) == 0
    assert did_run(given)
    forget_code(given)
    if state == "unfinished":
        (given / "swept/table.parquet").unlink()
    manifest = json.loads((given / "swept/manifest.json").read_text())
    assert "notes.py:Drag" in manifest["machine"]
    assert main(["plot", "sweep", "swept"]) == 0
    assert not did_run(given) and "written" in capsys.readouterr().out
    assert edhas.open_sweep(given / "swept").fields["frequency"][0] == "Hz"


def test_a_worker_runs_the_code_that_the_sweep_was_read_with(given):
    machine_file(given)
    sweep = edhas.load_sweep(given / "sweep.yaml", trust=["notes.py"])
    assert has_run(given)

    class Swapping:
        """An executor whose worker has another file under the same name."""

        def submit(self, call, job):
            forget_code(given)
            write_code(given, "\ny = 2\n")
            future = Future()
            try:
                future.set_result(call(job))
            except Exception as error:
                future.set_exception(error)
            return future

    with pytest.raises(ResultFileError, match="was not allowed to run"):
        edhas.run_sweep(sweep, given / "swept", Swapping())
    assert not did_run(given)


def test_a_matplotlibrc_in_the_working_folder_is_not_used(given, capsys):
    (given / "matplotlibrc").write_text("text.usetex: True\nbackend: module://notes\n")
    machine_file(given, "rig: actuator_bench\nsimulation: {duration: 0.1 s}\n")
    line = "import sys; from edhas_jax.commands.cli import main; sys.exit(main(['simulate', 'machine.yaml']))"
    root = edhas.__file__.removesuffix("/edhas_jax/__init__.py")
    environment = os.environ | {"PYTHONPATH": root}
    done = subprocess.run([sys.executable, "-c", line], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    assert not did_run(given)


def test_reading_twice_runs_once(given):
    path = machine_file(given)
    read_config(path, trust=["notes.py"])
    assert has_run(given)
    read_config(path)  # the same content has run in this process
    assert not did_run(given)
