"""What is given twice under two names, cut off, or a fraction where a whole number belongs is refused in a sentence."""

import shutil

import pytest

from edhas_jax.commands.cli import main
from tests.support import CONFIGS, ROOT

PAPER = CONFIGS / "paper.yaml"
GRID = "sweep: {kind: grid, parameters: {frequency: [10 Hz, 20 Hz]}}\n"


@pytest.fixture()
def refused(tmp_path, monkeypatch, capsys):
    """Run a command on a file with this text; what it prints when it refuses it."""
    monkeypatch.chdir(tmp_path)

    def refuse(command: str, text: str) -> str:
        (tmp_path / "given.yaml").write_text(f"base: {PAPER}\n{text}")
        assert main([command, "given.yaml"]) == 2
        assert not (tmp_path / "runs").exists()
        return capsys.readouterr().err

    return refuse


@pytest.mark.parametrize("end", ["", "0", "0.5"])
def test_a_table_of_designs_that_is_cut_in_its_last_line(refused, tmp_path, end):
    (tmp_path / "designs.csv").write_text("frequency [Hz],amplitude [mm]\n10,3.25\n20,3" + end)
    message = refused("sweep", "sweep: {kind: table, file: designs.csv}\n")
    assert "designs.csv:3: the last line has no line end; add one if the file is complete" in message


@pytest.mark.parametrize("number", ["3.7", "4.0", "5 Hz", "2"])
def test_a_number_of_cycles_that_is_no_whole_number(refused, number):
    message = refused("sweep", f"{GRID}batch: {{max_cycles: {number}}}\n")
    assert f"batch.max_cycles: a whole number from 3 to 100,000 belongs here; got {number}" in message


@pytest.mark.parametrize(
    ("command", "text", "message"),
    [
        ("sweep", GRID + "parameters: {mover_mass: 0.1 kg, mover.mover_mass: 0.2 kg}\n", "also as mover_mass"),
        ("sweep", GRID.replace("{frequency", "{reference.frequency: [5 Hz], frequency"), "also as reference.frequency"),
        ("size", "free: {piston_diameter: {from: 10 mm, to: 14 mm}}\n"
                 "objective: {maximise: [mean_flow], minimise: [mean_flow]}\n", "minimise.mean_flow: given twice"),
        ("size", "free: {piston_diameter: {from: 10 mm, to: 14 mm}}\nobjective: {maximise: [mean_flow]}\n"
                 "robust: {judge: expected, tolerances: {mover_mass: {plus_minus: 5 %}, mover.mover_mass: "
                 "{plus_minus: 1 %}}}\n", "also as mover_mass"),
        ("sensitivity", "metrics: [mean_flow, mean_flow]\nlocal: [mover_mass]\n", "mean_flow is listed twice"),
    ],
)  # fmt: skip
def test_a_task_that_names_one_thing_twice(refused, command, text, message):
    assert message in refused(command, text)


@pytest.mark.parametrize(
    "pair",
    [
        ("mover_mass=0.1kg", "mover_mass=0.2kg"),
        ("mover_mass=0.1kg", "mover.mover_mass=0.2kg"),
        ("duration=1s", "simulation.duration=2s"),
    ],
)
def test_an_override_given_twice(refused, capsys, pair):
    assert main(["simulate", str(PAPER), "--set", pair[0], "--set", pair[1]]) == 2
    assert "given twice" in capsys.readouterr().err


def test_an_uncertain_parameter_and_a_condition_given_twice(tmp_path, capsys):
    folder = tmp_path / "campaign"
    shutil.copytree(ROOT / "tests" / "data" / "campaign_bench", folder)
    path = folder / "campaign.yaml"
    whole = path.read_text()
    twice = whole.replace("  coil_resistance: 0.02\n", "  coil_resistance: 0.02\n  coil.coil_resistance: 0.1\n")
    twice = twice.replace("frequency: 20 Hz,", "frequency: 20 Hz, reference.frequency: 30 Hz,")
    assert twice.count("\n") == whole.count("\n") + 1
    path.write_text(twice)
    assert main(["campaign", "check", str(folder)]) != 0
    printed = "".join(capsys.readouterr())
    assert "uncertain.coil.coil_resistance: given twice, also as coil_resistance" in printed
    assert "reference.frequency: given twice, also as frequency" in printed
