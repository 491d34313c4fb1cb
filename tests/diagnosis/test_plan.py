"""Experiment planning: thresholds of planned runs, similar signatures, candidate runs, the next experiment."""

import dataclasses
import json
import math

import numpy as np
import pytest

from edhas_jax.commands import cli
from edhas_jax.core import structs
from edhas_jax.diagnosis.candidates.candidate import Candidate
from edhas_jax.diagnosis.planning.candidate_runs import candidate_runs, feasible_runs
from edhas_jax.diagnosis.planning.detectability_plan import plan_as_json, plan_detectability
from edhas_jax.diagnosis.planning.detection_threshold import DETECTION_NORM, Detectability
from edhas_jax.diagnosis.planning.figures import draw_similarity, draw_thresholds
from edhas_jax.diagnosis.planning.next_experiment import _distance_after_refit, next_experiment
from edhas_jax.diagnosis.planning.planned_campaign import read_planned_campaign, with_predicted_signals
from edhas_jax.diagnosis.planning.signature_gram import CandidatePoints, SignatureGram, cosines
from edhas_jax.diagnosis.search.diagnose import diagnose
from edhas_jax.diagnosis.search.posterior import SetPosterior
from edhas_jax.machine.effects import Backlash, ConstantBiasForce, InverterDeadTime, MagneticSaturation
from edhas_jax.measurements.campaign import CampaignError, Use
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.unknown_parameters import UnknownParameter
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
RECORDED_SET_POINT = """
rig: actuator_bench
reference: set_point
signals: {current: {unit: A, noise: 0.02}}
runs: [{file: one.csv, use: fit}]
"""


def ignore_progress(stage, share):
    pass


@pytest.fixture(scope="module")
def campaign():
    return with_predicted_signals(empty_campaign(), 8)


@pytest.fixture(scope="module")
def plan(campaign):
    return plan_detectability(campaign, library=EFFECTS)


@pytest.fixture(scope="module")
def gram(campaign):
    candidates = [CandidatePoints(Candidate(kind), np.array([[1.0]])) for kind in EFFECTS]
    return SignatureGram(campaign, campaign.runs, candidates, 8, ignore_progress)


@pytest.mark.parametrize("effect", ["inverter_dead_time", "constant_bias_force"])
def test_an_effect_at_the_threshold_has_the_detection_norm(campaign, plan, effect):
    (s,) = (s for s in plan.candidates if s.candidate.id == effect)
    (unknown,) = s.candidate.unknowns(campaign)

    def norm(size):
        points = CandidatePoints(s.candidate, np.array([[unknown.coordinate(size)]]))
        gram = SignatureGram(campaign, campaign.runs_for(Use.FIT), [points], 8, ignore_progress)
        return np.sqrt(gram.unexplained()[0, 0])

    assert norm(s.threshold) == pytest.approx(DETECTION_NORM, rel=0.3)
    assert norm(0.5 * s.threshold) < 0.7 * DETECTION_NORM < 1.4 * DETECTION_NORM < norm(2.0 * s.threshold)
    assert s.detectable and s.threshold_share < 0.1


def test_an_effect_that_fades_as_its_parameter_grows_has_an_upper_threshold(plan):
    (s,) = (s for s in plan.candidates if s.candidate.id == "magnetic_saturation")
    assert np.isinf(s.absent_value) and s.threshold_text().startswith("≤")


def test_the_projection_is_the_residual_of_a_regularised_regression(gram):
    rng = np.random.default_rng(1)
    known = len(gram._prior)
    table = rng.standard_normal((60, known + 4))
    jacobian = np.concatenate([table[:, :known], np.diag(gram._prior)])
    signature = np.concatenate([table[:, known:], np.zeros((known, 4))])
    residual = signature - jacobian @ np.linalg.lstsq(jacobian, signature, rcond=None)[0]
    np.testing.assert_allclose(gram.project(table.T @ table), residual.T @ residual, rtol=1e-9, atol=1e-9)


def test_a_further_run_never_lowers_a_norm(gram):
    one_run, all_runs = np.diag(gram.unexplained([0])), np.diag(gram.unexplained())
    assert (all_runs >= one_run * (1.0 - 1e-9)).all() and (one_run > 0.0).all()
    overlap = cosines(gram.unexplained())
    assert np.allclose(np.diag(overlap), 1.0) and (overlap <= 1.0 + 1e-12).all()


def test_the_plan_is_reported_and_drawn(plan):
    assert len(plan.candidates) == len(EFFECTS) + 4 * 3 and plan.feasible_run_count > 0
    for one, other, cosine in plan.indistinguishable_pairs():
        assert one != other and cosine > 0.95
    plain = json.loads(json.dumps(plan_as_json(plan), allow_nan=False))
    assert plain["next_run"]["conditions"].keys() == {"frequency", "amplitude"}
    detectable, pairs = sum(s.detectable for s in plan.candidates), len(list(plan.indistinguishable_pairs()))
    sentence = plan.sentence()
    assert sentence.startswith(f"{detectable} of {len(plan.candidates)} candidates are detectable")
    assert (f"{pairs} pair" in sentence) if pairs else ("all of them can be told apart" in sentence)
    assert f"of {plan.feasible_run_count} feasible ones: " in sentence
    assert draw_thresholds(plan).axes and draw_similarity(plan).axes


def test_feasible_runs_stay_within_stroke_and_supply_voltage(campaign):
    machine = structs.replace(campaign.machine, supply=structs.replace(campaign.machine.supply, supply_voltage=14.0))
    candidates, feasible = candidate_runs(campaign), feasible_runs(campaign, machine, 8)
    assert 0 < len(feasible) < len(candidates)
    model = MeasurementModel(campaign, machine, (), feasible, signals=("piston_position", "voltage"))
    for outcome in model.predict_all_runs(np.zeros(0), 8).values():
        assert np.abs(outcome.values["piston_position"]).max() < 5e-3
        assert np.abs(outcome.values["voltage"]).max() < 14.0


@pytest.mark.parametrize("frequencies, expected", [((10.0, 10.0), (6.7, 35.0)), ((5.0, 30.0), (3.3, 45.0))])
def test_candidates_extend_beyond_the_frequencies_of_the_campaign(campaign, frequencies, expected):
    runs = tuple(
        dataclasses.replace(run, conditions=run.conditions | {"frequency": f})
        for run, f in zip(campaign.runs, frequencies, strict=False)
    )
    values = [run.conditions["frequency"] for run in candidate_runs(dataclasses.replace(campaign, runs=runs))]
    assert (min(values), max(values)) == expected


def test_a_campaign_is_read_before_its_files_exist(tmp_path):
    (tmp_path / "campaign.yaml").write_text(YAML, encoding="utf-8")
    planned = read_planned_campaign(tmp_path, 2e3)
    assert [run.conditions["frequency"] for run in planned.runs] == [10.0, 20.0]
    assert planned.runs[0].interval == pytest.approx(5e-4) and planned.runs[0].time[-1] > planned.runs[1].time[-1]
    filled = with_predicted_signals(planned, 8)
    assert set(filled.runs[0].signals) == {"current", "piston_position"}


@pytest.mark.parametrize(
    "text, message",
    [
        (YAML.replace("frequency: 20 Hz", "frequency: 20 mm"), "length"),
        (RECORDED_SET_POINT, "recorded"),
        (YAML.replace("rig: actuator_bench", "rig: mill"), "rig"),
    ],
)
def test_an_invalid_plan_is_refused(tmp_path, text, message):
    (tmp_path / "campaign.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(CampaignError, match=message):
        read_planned_campaign(tmp_path, 2e3)


def test_the_plan_command_refuses_invalid_input(tmp_path, capsys):
    assert cli.main(["plan", str(tmp_path / "nowhere")]) == 2
    (tmp_path / "campaign.yaml").write_text(YAML, encoding="utf-8")
    assert cli.main(["plan", str(tmp_path), "--rate", "5 mm"]) == 2
    assert cli.main(["plan", str(tmp_path), "--rate", "0 Hz"]) == 2
    messages = capsys.readouterr().err
    assert messages.count("edhas:") == 3 and "must be above 0" in messages


def test_the_distance_after_refitting_matches_its_definition():
    rng = np.random.default_rng(2)
    jacobian, root = rng.standard_normal((50, 4)), rng.standard_normal((4, 4))
    covariance, difference = root @ root.T, rng.standard_normal(50)
    total = np.eye(50) + jacobian @ covariance @ jacobian.T
    expected = np.sqrt(difference @ np.linalg.solve(total, difference))
    assert _distance_after_refit(difference, jacobian, covariance) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("rank", [0, 2])
def test_the_distance_after_refitting_allows_for_a_singular_covariance(rank):
    """Directions of which the covariance knows no variance are not refitted."""
    rng = np.random.default_rng(4)
    jacobian, root = rng.standard_normal((50, 4)), rng.standard_normal((4, rank))
    covariance, difference = root @ root.T, rng.standard_normal(50)
    total = np.eye(50) + jacobian @ covariance @ jacobian.T
    expected = np.sqrt(difference @ np.linalg.solve(total, difference))
    assert _distance_after_refit(difference, jacobian, covariance) == pytest.approx(expected, rel=1e-9)
    assert _distance_after_refit(difference, jacobian, np.full((4, 4), np.nan)) == -np.inf


def test_the_next_experiment_discriminates_two_rivals():
    truth = structs.replace(bench(), effects=(*bench().effects, InverterDeadTime(dead_time_voltage=0.8)))
    diagnosis = diagnose(measured(empty_campaign(), truth), library=(InverterDeadTime,))
    best, *others = diagnosis.posterior.sets
    nothing = next(of for of in others if not of.members)

    def with_sets(*sets):
        return dataclasses.replace(diagnosis, posterior=SetPosterior(sets))

    assert next_experiment(with_sets(best)) is None
    twin = dataclasses.replace(best, log_weight=best.log_weight - 1.0)
    assert next_experiment(with_sets(best, twin, nothing)).separation == pytest.approx(0.0, abs=1e-6)
    experiment = next_experiment(with_sets(best, nothing))
    assert experiment.separation > 5.0 and set(experiment.conditions) == {"frequency", "amplitude"}
    fitted = nothing.evaluated.fit
    singular = dataclasses.replace(fitted, covariance=np.ones_like(fitted.covariance))
    uncertain = dataclasses.replace(nothing, evaluated=dataclasses.replace(nothing.evaluated, fit=singular))
    assert next_experiment(with_sets(best, uncertain)).separation > 5.0
    assert json.dumps(experiment.as_json())
    assert experiment.sentence.startswith("A run with") and "its best rival, nothing" in experiment.sentence


def test_where_nothing_is_missing_no_run_is_recommended_unless_a_set_is_nearly_as_probable():
    diagnosis = diagnose(measured(empty_campaign(), bench()), library=(InverterDeadTime,))
    best, other, *_ = diagnosis.posterior.sets
    far, near = (dataclasses.replace(other, log_weight=best.log_weight - gap, gain=2.0) for gap in (10.0, 1.0))
    assert next_experiment(dataclasses.replace(diagnosis, posterior=SetPosterior((best, far)))) is None
    found = next_experiment(dataclasses.replace(diagnosis, posterior=SetPosterior((best, near))))
    assert found.rivals == ("nothing", str(other))


@pytest.mark.parametrize(
    ("absent", "threshold", "weakest", "text"),
    [
        (0.0, 3e-6, 1e-6, "≥ 3 µm"), (0.0, 1e-8, 1e-6, "below 1 µm"), (math.inf, 1e6, 2e6, "≤ 1e6 m"),
        (math.inf, 3e6, 2e6, "above 2e6 m"), (1.0, 1.02, 1.1, "less than ± 100 mm of 1 m"),
    ],
)  # fmt: skip
def test_a_threshold_beyond_what_was_simulated_is_stated_as_a_bound(absent, threshold, weakest, text):
    unknown = UnknownParameter("width", 1e-6, 1.0, "m", (0.0, math.inf))
    found = Detectability(Candidate(Backlash), unknown, absent, threshold, 0.1, np.zeros(1), weakest=weakest)
    assert found.threshold_text() == text
