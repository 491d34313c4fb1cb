"""What runs could reveal before they are made, and the run that tells most next."""

import dataclasses
import json

import numpy as np
import pytest

from edhas_jax.commands import cli
from edhas_jax.core import structs
from edhas_jax.diagnosis.planning.candidate_runs import as_modelled, feasible_runs, menu, read_planned
from edhas_jax.diagnosis.planning.detectability_plan import as_json, plan
from edhas_jax.diagnosis.planning.detection_threshold import SEEN, Look, Products, cosines
from edhas_jax.diagnosis.planning.figures import draw_overlaps, draw_sizes
from edhas_jax.diagnosis.planning.next_experiment import _unfollowed, next_experiment
from edhas_jax.diagnosis.search.candidates import Suspect, unknowns_of
from edhas_jax.diagnosis.search.forward_selection import diagnose
from edhas_jax.diagnosis.search.trial import try_suspect
from edhas_jax.machine.effects import ConstantBiasForce, InverterDeadTime, MagneticSaturation
from edhas_jax.measurements.campaign import CampaignError, Use
from edhas_jax.measurements.predicted_signals import Case, Model
from edhas_jax.measurements.step_selection import Resolution
from tests.support.synthetic_campaign import bench, empty_campaign, measured

EFFECTS = InverterDeadTime, ConstantBiasForce, MagneticSaturation
YAML = """
rig: actuator_bench
uncertain: {coil_resistance: 0.02, force_constant: 0.02, mover_damping: 0.25}
signals:
  current: {unit: A, noise: 0.02}
  piston_position: {unit: mm, noise: 0.005}
runs:
  - {file: one.csv, use: fit, frequency: 10 Hz, amplitude: 3 mm}
  - {file: two.csv, use: fit, frequency: 20 Hz, amplitude: 2 mm}
"""
RECORDED = """
rig: actuator_bench
reference: set_point
signals: {current: {unit: A, noise: 0.02}}
runs: [{file: one.csv, use: fit}]
"""


def silent(what, share):
    pass


@pytest.fixture(scope="module")
def campaign():
    return as_modelled(empty_campaign(), 8)


@pytest.fixture(scope="module")
def found(campaign):
    return plan(campaign, library=EFFECTS)


@pytest.fixture(scope="module")
def products(campaign):
    looks = [Look(Suspect(kind), np.array([[1.0]])) for kind in EFFECTS]
    return Products(campaign, campaign.runs, looks, 8, silent)


def test_an_effect_of_the_size_told_is_just_seen(campaign, found):
    for v in found.visible:
        if v.suspect.id not in ("inverter_dead_time", "constant_bias_force"):
            continue
        (unknown,) = unknowns_of(v.suspect, campaign)
        look = Look(v.suspect, np.array([[unknown.coordinate(v.size)]]))
        length = np.sqrt(Products(campaign, campaign.runs_for(Use.FIT), [look], 8, silent).left()[0, 0])
        assert length == pytest.approx(SEEN, rel=0.3)
        assert v.seen and v.share < 0.1


def test_an_effect_that_fades_with_its_parameter_is_seen_below_a_value(found):
    (v,) = (v for v in found.visible if v.suspect.id == "magnetic_saturation")
    assert np.isinf(v.absent) and v.threshold().startswith("≤")


def test_what_is_left_is_what_no_parameter_imitates(products):
    rng = np.random.default_rng(1)
    known = len(products._prior)
    table = rng.standard_normal((60, known + 4))
    tall = np.concatenate([table[:, :known], np.diag(products._prior)])
    signature = np.concatenate([table[:, known:], np.zeros((known, 4))])
    left = signature - tall @ np.linalg.lstsq(tall, signature, rcond=None)[0]
    np.testing.assert_allclose(products.left_of(table.T @ table), left.T @ left, rtol=1e-9, atol=1e-9)


def test_a_run_more_hides_nothing(products):
    few, all_ = np.diag(products.left([0])), np.diag(products.left())
    assert (all_ >= few * (1.0 - 1e-9)).all() and (few > 0.0).all()
    overlap = cosines(products.left())
    assert np.allclose(np.diag(overlap), 1.0) and (overlap <= 1.0 + 1e-12).all()


def test_the_plan_is_told_and_drawn(found):
    assert len(found.visible) == len(EFFECTS) + 4 * 3 and found.tried > 0
    for one, other, cosine in found.pairs():
        assert one != other and cosine > 0.95
    plain = json.loads(json.dumps(as_json(found), allow_nan=False))
    assert plain["next_run"]["conditions"].keys() == {"frequency", "amplitude"}
    assert found.sentence().count("suspects") >= 1
    assert draw_sizes(found).axes and draw_overlaps(found).axes


def test_the_menu_keeps_within_stroke_and_supply(campaign):
    machine = structs.replace(campaign.machine, supply=structs.replace(campaign.machine.supply, supply_voltage=14.0))
    every, feasible = menu(campaign), feasible_runs(campaign, machine, 8)
    assert 0 < len(feasible) < len(every)
    model = Model(campaign, machine, (), feasible, watch=("piston_position", "voltage"))
    for outcome in model.outcomes([Case(np.zeros(0), tuple(range(len(feasible))))], 8, derive=False)[0].values():
        assert np.abs(outcome.values["piston_position"]).max() < 5e-3
        assert np.abs(outcome.values["voltage"]).max() < 14.0


@pytest.mark.parametrize("frequencies, reach", [((10.0, 10.0), (6.7, 35.0)), ((5.0, 30.0), (3.3, 45.0))])
def test_the_menu_looks_beyond_one_frequency(campaign, frequencies, reach):
    runs = tuple(
        dataclasses.replace(run, conditions=run.conditions | {"frequency": f})
        for run, f in zip(campaign.runs, frequencies, strict=False)
    )
    tried = [run.conditions["frequency"] for run in menu(dataclasses.replace(campaign, runs=runs))]
    assert (min(tried), max(tried)) == reach


def test_a_campaign_is_read_before_its_files_exist(tmp_path):
    (tmp_path / "campaign.yaml").write_text(YAML, encoding="utf-8")
    read = read_planned(tmp_path, 2e3)
    assert [run.conditions["frequency"] for run in read.runs] == [10.0, 20.0]
    assert read.runs[0].interval == pytest.approx(5e-4) and read.runs[0].time[-1] > read.runs[1].time[-1]
    filled = as_modelled(read, 8)
    assert set(filled.runs[0].signals) == {"current", "piston_position"}


@pytest.mark.parametrize(
    "text, said",
    [
        (YAML.replace("frequency: 20 Hz", "frequency: 20 mm"), "length"),
        (RECORDED, "recorded"),
        (YAML.replace("rig: actuator_bench", "rig: mill"), "rig"),
    ],
)
def test_what_cannot_be_planned_is_told(tmp_path, text, said):
    (tmp_path / "campaign.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(CampaignError, match=said):
        read_planned(tmp_path, 2e3)


def test_bad_input_at_the_command_line(tmp_path, capsys):
    assert cli.main(["plan", str(tmp_path / "nowhere")]) == 2
    (tmp_path / "campaign.yaml").write_text(YAML, encoding="utf-8")
    assert cli.main(["plan", str(tmp_path), "--rate", "5 mm"]) == 2
    assert cli.main(["plan", str(tmp_path), "--rate", "0 Hz"]) == 2
    said = capsys.readouterr().err
    assert said.count("edhas:") == 3 and "samples" in said


def test_what_a_fit_cannot_follow():
    rng = np.random.default_rng(2)
    slopes, half = rng.standard_normal((50, 4)), rng.standard_normal((4, 4))
    covariance, difference = half @ half.T, rng.standard_normal(50)
    spread = np.eye(50) + slopes @ covariance @ slopes.T
    expected = np.sqrt(difference @ np.linalg.solve(spread, difference))
    assert _unfollowed(difference, slopes, covariance) == pytest.approx(expected, rel=1e-9)


def test_the_next_experiment_parts_two_rivals():
    truth = structs.replace(bench(), effects=(*bench().effects, InverterDeadTime(dead_time_voltage=0.8)))
    diagnosis = diagnose(measured(empty_campaign(), truth), library=(InverterDeadTime,))
    first = diagnosis.rounds[0]
    score = next(s for s in first.scores if s.suspect != first.accepted.suspect and s.fall > 0.0)
    other = try_suspect(first.before, (), score, Resolution(8, 8, 0.0), 6, finish=False)

    def among(*trials):
        return dataclasses.replace(diagnosis, rounds=(dataclasses.replace(first, trials=trials),))

    assert next_experiment(among(first.accepted)) is None
    twin = dataclasses.replace(first.accepted, gain=first.accepted.gain - 1.0)
    assert next_experiment(among(first.accepted, twin)).separation == pytest.approx(0.0, abs=1e-6)
    experiment = next_experiment(among(first.accepted, other))
    assert experiment.separation > 5.0 and set(experiment.conditions) == {"frequency", "amplitude"}
    assert json.dumps(experiment.as_json()) and other.suspect.name in experiment.sentence
