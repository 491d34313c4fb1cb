"""The commands `edhas add` and `edhas plan` on a small campaign, run in this process."""

import json
from pathlib import Path

import pytest

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.core import structs
from edhas_jax.machine.effects import ConstantBiasForce, EffectError
from edhas_jax.measurements.campaign import Use
from studies.campaign_writer import write_campaign
from tests.support.synthetic_campaign import bench, empty_campaign, measured

BIAS = 2.0  # N
FILES_OF_A_PLAN = {"plan.json", "sizes.png", "overlaps.png", "files.json", "summary.json"}


@pytest.fixture(scope="module")
def campaign_folder(tmp_path_factory):
    """A campaign measured on a bench with a constant force that the model lacks."""
    truth = structs.replace(bench(), effects=(*bench().effects, ConstantBiasForce(bias_force=BIAS)))
    folder = tmp_path_factory.mktemp("campaigns") / "bench"
    write_campaign(measured(empty_campaign(lengths=(201, 201, 201)), truth), folder)
    return folder


def test_add_writes_the_model_and_the_campaign_with_the_effect(campaign_folder, tmp_path, monkeypatch, capsys):
    """Folders are made; the campaign that is written begins where the effect was added, with the same measurements."""
    monkeypatch.chdir(tmp_path)
    arguments = ["add", str(campaign_folder), "constant_bias_force", "--out", "made/for/it"]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "constant_bias_force.bias_force" in printed and "held-out runs" in printed
    assert "campaign.yaml is the campaign with constant_bias_force in its machine" in printed
    assert printed.splitlines()[-1] == "next: edhas diagnose made/for/it"
    assert edhas.get(edhas.load("made/for/it/config.yaml").machine, "bias_force") == pytest.approx(BIAS, rel=0.05)
    before, after = edhas.read_campaign(campaign_folder), edhas.read_campaign("made/for/it")
    assert {e.id for e in after.machine.effects} - {e.id for e in before.machine.effects} == {"constant_bias_force"}
    assert edhas.get(after.machine, "bias_force") == pytest.approx(BIAS, rel=0.05)
    assert set(after.uncertain) == {*before.uncertain, "bias_force"} and after.uncertain["bias_force"].size > 0.1
    (line,) = (row for row in Path("made/for/it/campaign.yaml").read_text().splitlines() if "  bias_force: {" in row)
    assert len(line) < 40, "a spread with three or four digits"
    for old, new in zip(before.runs, after.runs, strict=True):
        assert old.conditions == new.conditions and (old.time == new.time).all()
    assert main(arguments) == 2
    assert "exists already" in capsys.readouterr().err


def test_add_takes_what_a_diagnosis_names(campaign_folder, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    diagnosis = Path("found")
    diagnosis.mkdir()
    (diagnosis / "summary.json").write_text(
        json.dumps({"task": "diagnose", "edhas_jax": "0.1.0", "date": "", "summary": {"title": "", "sentences": []}})
    )
    (diagnosis / "diagnosis.json").write_text(json.dumps({"effects": ["constant_bias_force"]}))
    assert main(["add", str(campaign_folder), "found", "--quiet"]) == 0
    (folder,) = Path("added").iterdir()
    assert folder.name.endswith("_constant_bias_force") and edhas.read_campaign(folder).machine.effects
    (diagnosis / "diagnosis.json").write_text(json.dumps({"effects": []}))
    assert main(["add", str(campaign_folder), "found"]) == 2
    assert "names no effect" in capsys.readouterr().err


def test_add_refuses_an_unknown_effect(campaign_folder, capsys):
    assert main(["add", str(campaign_folder), "constant_bias"]) == 2
    assert "constant_bias_force" in capsys.readouterr().err


def test_plan_writes_thresholds_and_pictures(campaign_folder, tmp_path, capsys):
    assert main(["plan", str(campaign_folder), "--out", str(tmp_path / "plan")]) == 0
    printed = capsys.readouterr().out
    assert "smallest detectable size" in printed and "constant_bias_force" in printed
    assert {p.name for p in (tmp_path / "plan").iterdir()} == FILES_OF_A_PLAN
    json.loads((tmp_path / "plan" / "plan.json").read_text())


def test_add_in_plain_python(campaign_folder, tmp_path):
    found = edhas.add(campaign_folder, [ConstantBiasForce])
    before, after = found.errors(Use.FIT)
    assert found.names == ["calibrated", "with constant_bias_force"] and after < 1.2 < before
    assert edhas.get(found.machine, "bias_force") == pytest.approx(BIAS, rel=0.05) and found.plot().axes
    saved = edhas.open_result(found.save(tmp_path / "added"))
    assert saved.task == "add" and edhas.get(saved.machine, "bias_force") == edhas.get(found.machine, "bias_force")
    assert saved.numbers["models"][1]["effects"] == ["constant_bias_force"]
    with pytest.raises(EffectError, match="constant_bias"):
        edhas.add(campaign_folder, ["constant_bias"])
