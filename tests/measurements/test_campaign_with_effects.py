"""More effects in the machine of a campaign: read from its description, and written into one that else is the same."""

import dataclasses
import shutil

import pytest

import edhas_jax as edhas
from edhas_jax.config.examples import FOLDER
from edhas_jax.core import structs
from edhas_jax.machine.effects import ConstantBiasForce
from edhas_jax.measurements.campaign import CampaignError
from edhas_jax.measurements.campaign_with_effects import description_with_effects
from studies.campaign_writer import write_campaign
from tests.support.synthetic_campaign import bench, empty_campaign, measured

SIZES = {"dead_time_voltage": "0.8 V"}
SPREADS = {"dead_time_voltage": "{relative: 0.5}"}
RUN = "{file: run2.csv, use: fit, frequency: 10 Hz, amplitude: 3.5 mm}"
BEGINNINGS = {
    "nothing": "",
    "empty": "effects:\nparameters: # none yet\nuncertain: ~\n",
    "blocks": "effects:\n- cogging_force # of the magnets\n"
    "parameters:\n  mover_mass: 0.13 kg\nuncertain:\n  mover_mass: 0.1\n",
    "braces": "effects: [cogging_force]\nparameters: {mover_mass: 0.13 kg}\nuncertain: {mover_mass: 0.1}\n",
    "empty braces": "effects: []\nparameters: {}\nuncertain: {}\n",
}


@pytest.fixture()
def described(tmp_path):
    """Write a description of a campaign with one run, and return its file."""
    folder = tmp_path / "bench"
    folder.mkdir()
    shutil.copy(FOLDER / "campaign" / "run2.csv", folder)

    def describe(beginning: str, runs: str = f"runs:\n  - {RUN}\n"):
        file = folder / "campaign.yaml"
        file.write_text(f"rig: pump_bench\n{beginning}signals: {{voltage: V, current: A}} # two\n{runs}")
        return file

    return describe


def changed(file, *arguments):
    """The campaign with more effects, written elsewhere."""
    new = file.parents[1] / "some" / "where"
    new.mkdir(parents=True, exist_ok=True)
    (new / "campaign.yaml").write_text(description_with_effects(file, new, *arguments))
    return edhas.read_campaign(new)


@pytest.mark.parametrize("beginning", BEGINNINGS.values(), ids=BEGINNINGS)
def test_an_effect_is_added_and_nothing_else_changes(described, beginning):
    file = described(beginning)
    before, after = edhas.read_campaign(file), changed(file, ["inverter_dead_time"], SIZES, SPREADS)
    assert {e.id for e in after.machine.effects} == {*(e.id for e in before.machine.effects), "inverter_dead_time"}
    assert edhas.get(after.machine, "dead_time_voltage") == 0.8 and after.uncertain["dead_time_voltage"].size == 0.5
    assert {n: s for n, s in after.uncertain.items() if n != "dead_time_voltage"} == before.uncertain
    assert edhas.get(after.machine, "mover_mass") == edhas.get(before.machine, "mover_mass")
    assert (after.runs[0].signals["voltage"] == before.runs[0].signals["voltage"]).all()
    text = (after.folder / "campaign.yaml").read_text()
    assert all(comment in text for comment in ("# two", "of the magnets", "none yet") if comment in f"{beginning}# two")
    assert file.read_text().startswith(f"rig: pump_bench\n{beginning}signals"), "the original stays"


@pytest.mark.parametrize("without", ["without: [piston_leakage, entrained_air]\n",
                                     "without:\n- piston_leakage\n- entrained_air\n"])  # fmt: skip
def test_a_usual_effect_is_no_longer_left_out(described, without):
    after = changed(described(without), ["piston_leakage"], {"piston_clearance": "12 µm"}, {})
    ids = {e.id for e in after.machine.effects}
    assert "piston_leakage" in ids and "entrained_air" not in ids
    assert edhas.get(after.machine, "piston_clearance") == 12e-6


def test_files_that_a_run_has_together_and_all_in_braces(described):
    file = described("", "runs: [{files: [run2.csv, {file: run2.csv, start: 0 s}], use: fit}]\n")
    text = description_with_effects(file, file.parents[1] / "a" / "b", ["inverter_dead_time"], SIZES, {})
    assert text.count('"../../bench/run2.csv"') == 2
    file.write_text(f"{{rig: pump_bench, signals: {{voltage: V}}, runs: [{RUN}]}}")
    assert "inverter_dead_time" in {e.id for e in changed(file, ["inverter_dead_time"], SIZES, SPREADS).machine.effects}


@pytest.mark.parametrize(
    ("beginning", "problem"),
    [
        ("effects: [inverter_deadtime]\n", "campaign.yaml:2: effects.0.: no effect `inverter_deadtime`"),
        ("effects: inverter_dead_time\n", "campaign.yaml:2: effects: a list belongs here"),
        ("without: [piston_leakage]\neffects:\n  - piston_leakage\n", "4: effects.0.: .* under `without` too"),
    ],
)
def test_wrong_effects_of_a_campaign_are_refused(described, beginning, problem):
    with pytest.raises(CampaignError, match=problem):
        edhas.read_campaign(described(beginning))


def test_a_campaign_in_memory_is_written_with_all_its_effects(tmp_path):
    machine = structs.replace(bench(), effects=(*bench().effects, ConstantBiasForce(bias_force=2.0)))
    campaign = dataclasses.replace(measured(empty_campaign(lengths=(201,)), bench()), machine=machine)
    write_campaign(campaign, tmp_path / "bench")
    again = edhas.read_campaign(tmp_path / "bench").machine
    assert {e.id for e in again.effects} == {e.id for e in machine.effects} and edhas.get(again, "bias_force") == 2.0
