"""Result folders: damaged files are refused, and what the program has not written is never replaced or removed."""

import shutil
from pathlib import Path

import pandas as pd
import pytest

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.config.result_files import ResultFileError, ResultFiles
from edhas_jax.core.summary import Summary
from edhas_jax.tasks.result import Result
from tests.support import CONFIGS

RUN = ["simulate", str(CONFIGS / "actuator.yaml"), "--set", "duration=0.25s", "--no-figure", "--out", "run"]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A run folder."""
    folder = tmp_path_factory.mktemp("written") / "run"
    assert main([*RUN[:-1], str(folder)]) == 0
    return folder


@pytest.fixture()
def run(tmp_path, monkeypatch, written):
    """A copy of it in the working folder."""
    monkeypatch.chdir(tmp_path)
    return Path(shutil.copytree(written, tmp_path / "run"))


def flip(path: Path, place: float) -> None:
    content = bytearray(path.read_bytes())
    content[int(place * (len(content) - 1))] ^= 4
    path.write_bytes(content)


@pytest.mark.parametrize("place", [0.0, 0.1, 0.5, 0.9, 1.0])
@pytest.mark.parametrize(
    "name", ["timeseries.parquet", "ledger.parquet", "metrics.json", "config.yaml", "run.json", "files.json"]
)
def test_one_wrong_bit_in_a_run_folder_is_refused(run, name, place):
    flip(run / name, place)
    with pytest.raises(ResultFileError, match=name):
        edhas.open_run(run)


def test_overwriting_a_run_leaves_other_files(run, capsys):
    (run / "notes.txt").write_text("precious")
    (run / "sub").mkdir()
    (run / "sub" / "data.csv").write_text("precious")
    (run / "figure.png").write_bytes(b"a picture of mine")
    assert main([*RUN, "--overwrite"]) == 2
    assert "figure.png: was not written by edhas, so it is not overwritten" in capsys.readouterr().err
    (run / "figure.png").unlink()
    assert main([*RUN[:3], "duration=0.3s", *RUN[4:], "--overwrite"]) == 0
    assert edhas.open_run(run).signals["time"][-1] == pytest.approx(0.3)
    assert (run / "notes.txt").read_text() == (run / "sub" / "data.csv").read_text() == "precious"


def test_files_that_the_new_result_lacks_are_removed(tmp_path):
    for names in (["sized_1.yaml", "sized_2.yaml"], ["sized.yaml"]):
        files = ResultFiles(tmp_path / "sized", True, ["sized*.yaml"])
        files.begin()
        for name in names:
            (tmp_path / "sized" / name).write_text("text")
        files.finish()
        (tmp_path / "sized" / "mine.txt").write_text("precious")
    assert {p.name for p in (tmp_path / "sized").iterdir()} == {"sized.yaml", "mine.txt", "files.json"}


@pytest.mark.parametrize(
    ("command", "name"),
    [("compare", "report.html"), ("fit", "fit.json"), ("diagnose", "diagnosis.png"), ("plan", "plan.json"),
     ("size", "sized_7.yaml"), ("sensitivity", "machine.yaml")],
)  # fmt: skip
def test_no_command_overwrites_a_file_that_is_not_its_own(tmp_path, monkeypatch, capsys, command, name):
    """Refused before anything is computed."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / name).write_text("precious")
    source = {"size": CONFIGS / "size_pump.yaml", "sensitivity": CONFIGS / "sensitivity.yaml"}.get(
        command, CONFIGS.parent / "tests" / "data" / "campaign_bench"
    )
    assert main([command, str(source), "--out", "mine", "--overwrite"]) == 2
    assert f"{name}: was not written by edhas" in capsys.readouterr().err
    assert [p.name for p in (tmp_path / "mine").iterdir()] == [name]
    assert (tmp_path / "mine" / name).read_text() == "precious"


class Noted(Result):
    """A result with a machine, its numbers, a table and a picture."""

    files = ("config.yaml", "result.json", "path.parquet", "a_law.yaml", "figure.png")

    def summary(self):
        return Summary("noted")

    def write_files(self, folder):
        (folder / "config.yaml").write_text("rig: actuator_bench\nmachine:\n  motor:\n    coil_resistance: 1.5 ohm\n")
        (folder / "result.json").write_text('{"share": 0.25}')
        pd.DataFrame({"a": [1.0, 2.0]}).to_parquet(folder / "path.parquet")
        (folder / "a_law.yaml").write_text("nodes: [0, 1]")
        (folder / "figure.png").write_bytes(b"picture")
        return ()


@pytest.mark.parametrize("place", [0.1, 0.5, 0.9])
@pytest.mark.parametrize(
    "name", ["config.yaml", "result.json", "path.parquet", "a_law.yaml", "summary.json", "files.json"]
)
def test_one_wrong_bit_in_the_folder_of_any_result_is_refused(tmp_path, name, place):
    folder = Noted().save(tmp_path / "noted")
    assert edhas.open_result(folder).numbers == {"share": 0.25}
    flip(folder / name, place)
    with pytest.raises(ResultFileError, match=name):
        edhas.open_result(folder)


def test_a_machine_that_was_changed_after_a_result_was_opened_is_refused(tmp_path):
    saved = edhas.open_result(Noted().save(tmp_path / "noted"))
    (saved.folder / "config.yaml").write_text((saved.folder / "config.yaml").read_text().replace("1.5", "1.6"))
    with pytest.raises(ResultFileError, match="config.yaml: is missing, is damaged, or was changed"):
        _ = saved.machine


def test_a_picture_may_be_moved_out_of_a_result_but_no_data(tmp_path):
    folder = Noted().save(tmp_path / "noted")
    (folder / "figure.png").unlink()
    assert edhas.open_result(folder).pictures == []
    (folder / "a_law.yaml").unlink()
    with pytest.raises(ResultFileError, match="a_law.yaml: is missing"):
        edhas.open_result(folder)
