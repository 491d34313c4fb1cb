"""The benchmark of hidden effects: drawn cases, a short run with its real methods, and the rivals."""

import json

import numpy as np
import pytest

from edhas_jax.diagnosis.search.candidates import Candidate, candidate_unknowns, screening_grid
from edhas_jax.diagnosis.search.forward_selection import calibrate
from edhas_jax.machine.effects import CoggingForce, ForceConstantDroop, InverterDeadTime
from edhas_jax.measurements.sensor_models import SensorLag
from edhas_jax.measurements.synthetic_campaign import PlannedRun
from studies.hidden_effects import benchmark, cases
from studies.hidden_effects.calibrated_case import ScreenedCandidate, exact_fit, screen
from studies.hidden_effects.correlation import correlation


@pytest.fixture
def small(monkeypatch):
    """Three short runs, three effects, two uncertain parameters."""
    runs = [PlannedRun(run.use, 0.16, run.conditions) for run in cases.BENCH_RUNS[3:6:2] + cases.BENCH_RUNS[7:]]
    monkeypatch.setattr(cases, "PUMP_EFFECTS", [InverterDeadTime, CoggingForce, ForceConstantDroop])
    monkeypatch.setattr(cases, "MODEL_EFFECTS", cases.MODEL_EFFECTS[1:])
    monkeypatch.setattr(cases, "UNCERTAIN", {"force_constant": 0.02, "load_orifice_area": 0.03})
    monkeypatch.setattr(cases, "BENCH_RUNS", tuple(runs))
    monkeypatch.setattr(cases, "SAMPLE_INTERVAL", 4e-4)


def test_a_case_is_drawn_from_its_number_alone(small):
    one, again = cases.draw_case(0), cases.draw_case(0)
    assert one.family is cases.Family.ONE and len(one.hidden) == 1
    hidden = one.hidden[0]
    assert hidden.visible > cases.MIN_VISIBILITY and hidden.values == again.hidden[0].values
    for p in hidden.candidate.free_parameters():
        low, high = p.plausible
        assert low <= hidden.values[p.name] <= high
    for a, b in zip(one.campaign.runs, again.campaign.runs, strict=True):
        np.testing.assert_array_equal(a.signals["current"], b.signals["current"])


def test_the_benchmark_runs_its_methods_on_drawn_cases(small, tmp_path, capsys):
    arguments = ["--cases", "2", "--seed", "0", "--workers", "1", "--out", str(tmp_path)]
    assert benchmark.main([*arguments, "--methods", "ours,correlation"]) == 0
    line = dict(word.split("=") for word in capsys.readouterr().out.strip().splitlines()[-1].split())
    assert line["ours_top1"] == line["ours_in_set"] == line["ours_place"] == line["ours_adequate_on_nulls"] == "1.000"
    assert line["correlation_top1"] == "1.000" and float(line["ours_median_s"]) > 0.0
    stored = json.loads((tmp_path / "tuning" / "a00000" / "ours.json").read_text())
    assert stored["answer_set"] == stored["named"] and 0.5 < stored["probability"] <= 1.0
    (hidden,) = json.loads((tmp_path / "tuning" / "a00000" / "case.json").read_text())["hidden"]
    assert stored["parameters"][hidden["name"]].keys() == hidden["values"].keys()


def test_baselines_get_the_exact_projected_residual_and_the_grid_of_the_diagnosis(small):
    campaign = cases.draw_case(1).campaign
    calibrated = calibrate(campaign)[0].fit
    model, campaign = calibrated.problem.model(), calibrated.problem.campaign
    fitted, per_sample = exact_fit(calibrated)
    finest = model.predict_all_runs(calibrated.x, 4 * per_sample)
    for r, outcome in enumerate(fitted.outcomes):
        for name, channel in campaign.channels.items():
            difference = outcome.values[name] - finest[r].values[name]
            assert np.sqrt(np.mean(np.square(difference))) < 0.02 * channel.noise
    candidates = [Candidate(CoggingForce), Candidate(SensorLag, "current")]
    residual, found = screen(fitted, candidates)
    assert [len(c.signatures) for c in found] == [
        len(screening_grid(candidate_unknowns(c, campaign))) for c in candidates
    ]
    assert [c.parameter_count for c in found] == [3, 1]
    rows = [out.sensitivities[n] / c.noise for out in fitted.outcomes for n, c in campaign.channels.items()]
    sensitivities = np.concatenate([*rows, np.eye(len(calibrated.x))])
    for vector in (residual, *found[0].signatures):
        assert np.abs(sensitivities.T @ vector).max() < 1e-6 * np.linalg.norm(sensitivities) * np.linalg.norm(vector)


def screened(residual_of, shapes):
    """Candidates with given signatures at the sizes 1 and 2, and a residual of unit noise with some of them in it."""
    noise = np.random.default_rng(1).standard_normal(shapes.shape[1])
    residual = noise + sum(size * shapes[k] for k, size in residual_of.items())
    return residual, [ScreenedCandidate(f"law{k}", np.array([s, 2.0 * s]), 1) for k, s in enumerate(shapes)]


def test_correlation_names_what_is_in_the_residual():
    shapes = np.random.default_rng(0).standard_normal((6, 20000))
    residual, candidates = screened({}, 0.1 * shapes)
    assert correlation(residual, candidates).named == ()
    residual, candidates = screened({4: 2.0, 1: 1.0}, 0.1 * shapes)
    assert correlation(residual, candidates).named == ("law4", "law1")
