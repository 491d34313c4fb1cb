"""The commands `edhas add` and `edhas plan` on a small campaign, run in this process."""

import json

import pytest

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.core import structs
from edhas_jax.machine.effects import ConstantBiasForce, EffectError
from edhas_jax.measurements.campaign import Use
from edhas_jax.measurements.campaign_writer import write_campaign
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


def test_add_fits_the_effect_and_writes_its_configuration(campaign_folder, tmp_path, capsys):
    path = tmp_path / "with_bias.yaml"
    arguments = ["add", str(campaign_folder), "constant_bias_force", "--out", str(path)]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "constant_bias_force.bias_force" in printed and "held-out runs" in printed
    machine = edhas.load(path).machine
    assert edhas.get(machine, "bias_force") == pytest.approx(BIAS, rel=0.05)
    assert main(arguments) == 2
    assert "exists already" in capsys.readouterr().err


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
