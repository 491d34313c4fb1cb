"""The command `edhas diagnose`: what it keeps when it is interrupted, and when an optional part of its result fails."""

import errno
import json
import os
import shutil
import signal

import numpy as np
import pytest

from edhas_jax.commands.cli import main
from edhas_jax.commands.progress import WorkProgress
from edhas_jax.config.result_files import locked_folder
from edhas_jax.core import structs
from edhas_jax.diagnosis.candidates import candidate
from edhas_jax.diagnosis.planning import next_experiment
from edhas_jax.diagnosis.report import report, result_file
from edhas_jax.diagnosis.search import checkpoint
from edhas_jax.diagnosis.search import diagnose as diagnosing
from edhas_jax.diagnosis.search.set_search import FIT_STEPS, SetSearch
from edhas_jax.machine.effects import ConstantBiasForce, InverterDeadTime
from studies.campaign_writer import write_campaign
from tests.support.synthetic_campaign import bench, empty_campaign, measured

FILES = {
    "config.yaml", "config_calibrated.json", "config_calibrated.yaml", "diagnosis.json", "diagnosis.png", "files.json",
    "report.html", "summary.json",
}  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def small_library():
    """Two effects to consider instead of forty, and no search for the next experiment."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(next_experiment, "next_experiment", lambda diagnosis: None)
        patch.setattr(candidate, "LIBRARY", (InverterDeadTime, ConstantBiasForce))
        yield


@pytest.fixture(scope="module")
def campaign_folder(tmp_path_factory):
    """A campaign measured on a bench with a dead time that the model lacks."""
    truth = structs.replace(bench(), effects=(*bench().effects, InverterDeadTime(dead_time_voltage=0.8)))
    folder = tmp_path_factory.mktemp("campaigns") / "bench"
    write_campaign(measured(empty_campaign(lengths=(101, 101, 101)), truth), folder)
    return folder


def terminated(campaign, out, at: str) -> int:
    """The exit status of a diagnosis that gets SIGTERM when it reports a sentence that begins with `at`."""

    def update(self, sentence, share=None):
        if sentence.startswith(at):
            os.kill(os.getpid(), signal.SIGTERM)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(WorkProgress, "__call__", update)
        return main(["diagnose", str(campaign), "--out", str(out)])


def result(folder) -> dict:
    """The content of `diagnosis.json`."""
    return json.loads((folder / "diagnosis.json").read_text())


@pytest.fixture(scope="module")
def after_one_round(campaign_folder, tmp_path_factory):
    """The folder of a diagnosis that was terminated after the first round of its search."""
    folder = tmp_path_factory.mktemp("terminated") / "one_round"
    assert terminated(campaign_folder, folder, "best so far: inverter_dead_time") == 130
    return folder


@pytest.fixture(scope="module")
def before_the_pictures(campaign_folder, after_one_round, tmp_path_factory):
    """The folder of the same diagnosis, terminated again while it looked for the next experiment."""
    folder = tmp_path_factory.mktemp("terminated") / "no_pictures"
    shutil.copytree(after_one_round, folder)
    assert terminated(campaign_folder, folder, "looking for the most informative") == 130
    return folder


def copy_of(folder, tmp_path):
    return shutil.copytree(folder, tmp_path / "out")


def never(*_):
    raise AssertionError("computed again")


def forbid_fits(monkeypatch):
    """Nothing may be fitted any more but the model without any effect."""
    fitted = SetSearch._fitted

    def checked(self, members, start, steps=FIT_STEPS):
        assert steps == 0 or not members, "fitted again"
        return fitted(self, members, start, steps)

    monkeypatch.setattr(SetSearch, "_fitted", checked)


def test_an_interrupted_diagnosis_goes_on_with_the_same_result(
    campaign_folder, after_one_round, tmp_path, monkeypatch, capsys
):
    assert not (after_one_round / "diagnosis.json").exists()
    assert main(["diagnose", str(campaign_folder), "--out", str(tmp_path / "whole")]) == 0
    out = copy_of(after_one_round, tmp_path)
    monkeypatch.setattr(diagnosing, "calibrate", never)
    capsys.readouterr()
    assert main(["diagnose", str(campaign_folder), "--out", str(out)]) == 0
    assert "Going on from the finished fits" in capsys.readouterr().out
    found, whole = result(out), result(tmp_path / "whole")
    assert found["effects"] == whole["effects"] == ["inverter_dead_time"] and found["verdict"] == whole["verdict"]
    for mine, other in zip(found["sets"], whole["sets"], strict=True):
        assert mine["members"] == other["members"] and mine["log_weight"] == pytest.approx(other["log_weight"], abs=0.1)
    assert found["error"]["after"]["holdout"] == pytest.approx(whole["error"]["after"]["holdout"], rel=1e-3)
    assert {p.name for p in out.iterdir()} == FILES
    assert main(["diagnose", str(campaign_folder), "--out", str(out)]) == 2, "a finished folder is not continued"


def test_the_folder_of_an_interrupted_diagnosis_is_found_again(
    campaign_folder, before_the_pictures, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(before_the_pictures, tmp_path / "diagnoses" / "synthetic-2")
    (tmp_path / "diagnoses" / "synthetic").mkdir()
    forbid_fits(monkeypatch)
    assert main(["diagnose", str(campaign_folder)]) == 0
    assert {p.name for p in (tmp_path / "diagnoses" / "synthetic-2").iterdir()} == FILES


def test_fits_of_other_inputs_are_not_used(campaign_folder, after_one_round, tmp_path, monkeypatch, capsys):
    def stop(*_):
        raise KeyboardInterrupt

    changed = shutil.copytree(campaign_folder, tmp_path / "bench")
    path = next(changed.glob("run1.*"))
    lines = path.read_text().splitlines()
    lines[50] = lines[50].replace("1", "2")
    path.write_text("\n".join(lines) + "\n")
    out = copy_of(after_one_round, tmp_path)
    monkeypatch.setattr(diagnosing, "calibrate", stop)
    assert main(["diagnose", str(changed), "--out", str(out)]) == 130
    (sentence,) = (s for s in capsys.readouterr().out.splitlines() if "not used" in s)
    assert sentence.endswith("computed from other inputs: the measured samples changed.")
    assert main(["diagnose", str(campaign_folder), "--out", str(out)]) == 0, "the stages are still there"


def test_a_damaged_stage_is_computed_again(campaign_folder, before_the_pictures, tmp_path):
    out = copy_of(before_the_pictures, tmp_path)
    calibration, *fits = sorted((out / "unfinished").glob("*.npz"))
    assert calibration.stem == "calibration" and fits and all(p.stem.startswith("set_") for p in fits)
    fits[0].write_bytes(fits[0].read_bytes()[:100])
    assert main(["diagnose", str(campaign_folder), "--out", str(out)]) == 0
    assert result(out)["verdict"] == "missing_effect"


def test_the_result_is_written_before_anything_optional(before_the_pictures):
    assert {p.name for p in before_the_pictures.iterdir()} == {
        "config.yaml", "config_calibrated.json", "config_calibrated.yaml", "diagnosis.json", "files.json",
        "report.html", "summary.json", "unfinished",
    }  # fmt: skip
    assert result(before_the_pictures)["effects"] == ["inverter_dead_time"]
    assert "inverter_dead_time" in (before_the_pictures / "report.html").read_text()
    assert any("Interrupted" in sentence for sentence in result(before_the_pictures)["failed_parts"])


def test_an_optional_part_that_fails_costs_a_sentence(
    campaign_folder, before_the_pictures, tmp_path, monkeypatch, capsys
):
    def fail(*_):
        raise np.linalg.LinAlgError("Singular matrix")

    out = copy_of(before_the_pictures, tmp_path)
    monkeypatch.setattr(next_experiment, "next_experiment", fail)
    monkeypatch.setattr(report, "draw_waterfall", fail)
    assert main(["diagnose", str(campaign_folder), "--out", str(out)]) == 0
    failed = result(out)["failed_parts"]
    assert len(failed) == 2 and failed[0].startswith("The next experiment could not be made: Singular matrix (LinAlg")
    assert failed[1].startswith("The residual after each stage of the report could not be made: Singular matrix")
    printed, text = capsys.readouterr().out, (out / "report.html").read_text()
    assert all(sentence in printed for sentence in failed) and text.count("could not be made") == 2
    assert result(out)["verdict"] == "missing_effect" and {p.name for p in out.iterdir()} == FILES


def full_disk(*_, **__):
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_disk_that_fills_ends_the_keeping_of_stages_but_not_the_diagnosis(
    campaign_folder, tmp_path, monkeypatch, capsys
):
    out = tmp_path / "out"
    monkeypatch.setattr(checkpoint.np, "savez", full_disk)
    assert main(["diagnose", str(campaign_folder), "--out", str(out)]) == 0
    sentence = "Stage calibration and later ones of the search could not be kept: No space left on device."
    assert sentence in capsys.readouterr().out
    assert {p.name for p in out.iterdir()} == FILES


def test_a_full_disk_at_the_end_keeps_the_finished_stages(
    campaign_folder, before_the_pictures, tmp_path, monkeypatch, capsys
):
    out = copy_of(before_the_pictures, tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(result_file, "write_json", full_disk)
        assert main(["diagnose", str(campaign_folder), "--out", str(out)]) == 2
    (said,) = (s for s in capsys.readouterr().err.splitlines() if "No space left" in s)
    kept = len(list((out / "unfinished").glob("*.npz")))
    assert "cannot be written" in said and f"finished stages of the search ({kept}) are kept in" in said
    forbid_fits(monkeypatch)
    assert main(["diagnose", str(campaign_folder), "--out", str(out)]) == 0
    assert {p.name for p in out.iterdir()} == FILES


def test_two_diagnoses_do_not_write_one_folder(campaign_folder, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(diagnosing, "calibrate", never)
    out = tmp_path / "out"
    with locked_folder(out):
        for more in ([], ["--overwrite"]):
            assert main(["diagnose", str(campaign_folder), "--out", str(out), *more]) == 2
            assert f"{out}: is being computed by another process" in capsys.readouterr().err
    assert not out.exists(), "nothing was written into it"
    (tmp_path / "notes").mkdir()
    with locked_folder(tmp_path / "notes"):
        pass
    assert (tmp_path / "notes").is_dir(), "a folder that was there stays"
