"""The benchmark of hidden effects: drawn cases, a short run that is continued, and the rates of given results."""

import json

import numpy as np
import pytest

from edhas_jax.diagnosis.search.candidates import Candidate, candidate_unknowns, screening_grid
from edhas_jax.diagnosis.search.forward_selection import calibrate
from edhas_jax.machine.effects import CoggingForce, ForceConstantDroop, InverterDeadTime
from edhas_jax.measurements.sensor_models import SensorLag
from edhas_jax.measurements.synthetic_campaign import PlannedRun
from studies.hidden_effects import benchmark, cases, rates
from studies.hidden_effects.baselines import ScreenedCandidate, correlation, exact_fit, forward_bic, screen
from studies.hidden_effects.figures import save_figures
from tests.support import ROOT


@pytest.fixture
def small(monkeypatch):
    """Three short runs, three effects, two uncertain parameters."""
    runs = [PlannedRun(run.use, 0.16, run.conditions) for run in cases.BENCH_RUNS[3:6:2] + cases.BENCH_RUNS[7:]]
    for module in (cases, benchmark):
        monkeypatch.setattr(module, "PUMP_EFFECTS", [InverterDeadTime, CoggingForce, ForceConstantDroop])
    monkeypatch.setattr(cases, "MODEL_EFFECTS", cases.MODEL_EFFECTS[1:])
    monkeypatch.setattr(cases, "UNCERTAIN", {"force_constant": 0.02, "load_orifice_area": 0.03})
    monkeypatch.setattr(cases, "BENCH_RUNS", tuple(runs))
    monkeypatch.setattr(cases, "SAMPLE_INTERVAL", 4e-4)


def result_file(family, hidden, verdict, accepted, probability=0.99, **more):
    """The contents of the result file of a case."""
    entries = [{"name": n, "slots": sorted(rates.slots_of(n)), "values": {}, "visible": 500.0} for n in hidden]
    first = next(iter(sorted(rates.slots_of(accepted[0]))), "") if accepted else "mover"
    return {
        "number": 0, "family": family, "hidden": entries, "verdict": verdict, "accepted": accepted, "groups": [],
        "candidates": [[n, probability] for n in accepted], "where": {first: 1.0}, "parameters": {}, "seconds": 1.0,
        "errors": {"after": {"holdout": 1.0}}, "rounds": [], 
        "rivals": {"residual correlation": {"named": hidden[:1], "ranked": hidden[:1]}},
    } | more  # fmt: skip


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


def test_the_benchmark_runs_and_continues_from_its_result_files(small, tmp_path, monkeypatch, capsys):
    arguments = ["--cases", "2", "--seed", "0", "--workers", "1", "--out", str(tmp_path)]
    assert benchmark.main(arguments) == 0
    printed = capsys.readouterr().out
    assert "development cases 0 … 1" in printed
    line = printed.strip().splitlines()[-1]
    names = [word.split("=")[0] for word in line.split()]
    assert names == ["top1", "false_alarms", "slot", "both", "unknown", "calibration"]
    assert line.startswith("top1=1.000 false_alarms=0.000 slot=1.000")
    assert (tmp_path / "confusion.png").stat().st_size > 5000 and (tmp_path / "rates.png").stat().st_size > 5000
    stored = json.loads((tmp_path / "case0000.json").read_text())
    assert {"forward selection by BIC", "residual correlation"} <= set(stored["rivals"])
    monkeypatch.setattr(benchmark, "run_case", lambda *_: pytest.fail("a finished case was done again"))
    assert benchmark.main(arguments) == 0
    assert capsys.readouterr().out.strip().splitlines()[-1] == line


def test_test_cases_and_development_cases_are_not_mixed(tmp_path, capsys):
    with pytest.raises(SystemExit):
        benchmark.main(["--cases", "20", "--seed", str(cases.FIRST_TEST_CASE - 5), "--out", str(tmp_path)])
    assert "do not mix" in capsys.readouterr().err


def test_rates():
    results = [
        result_file("one", ["cogging_force"], "missing_effect", ["cogging_force"]),
        result_file("one", ["eddy_drag"], "missing_effect", ["parasitic_spring"]),
        result_file(
            "one", ["backlash"], "ambiguous", ["coupling_compliance"], groups=[["coupling_compliance", "backlash"]]
        ),
        result_file("null", [], "adequate", []),
        result_file("null", [], "missing_effect", ["cogging_force"], probability=0.5),
        result_file("pair", ["cogging_force", "eddy_drag"], "missing_effect", ["eddy_drag", "cogging_force"]),
        result_file("struck", ["seal_friction"], "unknown_effect", []),
        result_file("struck", ["hose_compliance"], "unknown_effect", ["eddy_drag"], probability=0.5),
        result_file("struck", ["eddy_drag"], "adequate", []),
        result_file("sensor", ["sensor_lag on current"], "missing_effect", ["sensor_lag on current"]),
    ]
    line = dict(word.split("=") for word in rates.last_line(results).split())
    # probability of at least 95 %: right are cogging_force, both of the pair, the sensor; wrong the other two
    assert line == {"top1": "0.667", "false_alarms": "0.500", "slot": "1.000", "both": "1.000", "unknown": "0.667",
                    "calibration": "0.667"}  # fmt: skip
    found = rates.rates(results, rates.PACKAGE_METHOD)
    assert found["right component, of all withheld effects"] == rates.Rate(1, 3)
    assert found["right component, of those reported as unknown"] == rates.Rate(1, 2)
    wrong_answers = rates.report(results).split("wrong answers")[1]
    assert "eddy_drag" in wrong_answers and "sensor_lag" not in wrong_answers


def without_answer(result):
    """The result file of a case in which the diagnosis ended in an error; the baselines have answered."""
    kept = {n: result[n] for n in ("number", "family", "hidden", "rivals")}
    return kept | {"failed": "LinAlgError: Singular matrix"}


@pytest.mark.parametrize(
    ("number", "family", "hidden", "label"),
    [
        (0, "one", ["cogging_force"], "right name first"),
        (1, "null", [], "false alarms"),
        (3, "sensor", ["sensor_lag on current"], "right sensor and fault"),
        (5, "pair", ["cogging_force", "eddy_drag"], "both of two"),
        (7, "struck", ["eddy_drag"], "withheld effect reported as unknown"),
    ],
)
@pytest.mark.parametrize("when", ["in the diagnosis", "before anything was hidden"])
def test_a_case_that_ended_in_an_error_counts_as_wrong(number, family, hidden, label, when, tmp_path):
    right = "adequate" if family == "null" else "unknown_effect" if family == "struck" else "missing_effect"
    answered = result_file(family, hidden, right, [] if family in ("null", "struck") else hidden, number=number)
    failed = without_answer(answered) if when == "in the diagnosis" else {"number": number, "failed": "OSError: disk"}
    before, after = (rates.rates(results, rates.PACKAGE_METHOD) for results in ([answered], [answered, failed]))
    assert before[label] == (rates.Rate(0, 1) if family == "null" else rates.Rate(1, 1))
    assert after[label] == rates.Rate(1, 2)
    assert after["right where the probability is at least 95 %"].of == len(answered["candidates"])
    report = rates.report([answered, failed])
    assert "2 cases, 1 failed (counted as wrong)" in report and failed["failed"] in report
    if number in (0, 1):
        save_figures([answered, failed], tmp_path)
        assert (tmp_path / "confusion.png").stat().st_size > 5000


def test_rates_of_the_baselines_alone():
    """Without an answer of the package; a method that did not answer counts as wrong."""
    named = {"named": ["cogging_force"], "ranked": ["cogging_force", "eddy_drag"]}
    hidden = [{"name": "eddy_drag", "slots": ["mover"], "values": {}, "visible": 500.0}]
    results = [
        {"number": 0, "family": "one", "hidden": hidden, "rivals": {rates.BIC: named}, "seconds": 2.0},
        {"number": 1, "family": "null", "hidden": [], "rivals": {rates.BIC: {"named": [], "ranked": []}}},
        {"number": 9, "failed": "OSError: disk"},
    ]
    found = rates.rates(results, rates.BIC)
    assert found["right name first"] == rates.Rate(0, 1) and found["right name among three"] == rates.Rate(1, 1)
    assert found["false alarms"] == rates.Rate(1, 2)
    line = rates.last_line(results[:2])
    assert line == "bic_top1=0.000 bic_false_alarms=0.000 bic_slot=1.000 bic_both=nan"


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


def test_baselines_name_what_is_in_the_residual():
    shapes = np.random.default_rng(0).standard_normal((6, 20000))
    residual, candidates = screened({}, 0.1 * shapes)
    assert forward_bic(residual, candidates).named == [] and correlation(residual, candidates).named == []
    residual, candidates = screened({4: 2.0, 1: 1.0}, 0.1 * shapes)
    assert forward_bic(residual, candidates).named == ["law4", "law1"]
    assert correlation(residual, candidates).named == ["law4", "law1"]
    assert len(correlation(residual, candidates).ranked) == 3


def test_bic_of_a_law_with_many_parameters_is_worse():
    shape = 0.05 * np.ones((1, 5000))
    residual = shape[0] * 1.3
    cheap, dear = (ScreenedCandidate(f"k{k}", shape, k) for k in (1, 4))
    assert forward_bic(residual, [dear, cheap]).named[0] == "k1"
    assert forward_bic(residual, [dear]).named == []


PUBLISHED = ROOT / "studies" / "hidden_effects" / "published" / "baselines.json"
PAGE = ROOT / "docs" / "hidden_effects.md"


def test_the_published_rates_of_the_baselines_are_those_of_the_stored_results():
    results = json.loads(PUBLISHED.read_text(encoding="utf-8"))
    methods = (rates.BIC, rates.CORRELATION, rates.SPARSE)
    found = [rates.rates(results, method) for method in methods]
    rows = (
        PAGE.read_text(encoding="utf-8").split("| | BIC | correlation | PySINDy |")[1].split("\n\n")[0].splitlines()[2:]
    )
    published = {row.split("|")[1].strip(): [cell.strip() for cell in row.split("|")[2:5]] for row in rows}
    titles = {
        "right name first, one effect": "right name first",
        "right name among the first three": "right name among three",
        "right component of the machine": "right component of the machine",
        "right sensor and fault": "right sensor and fault",
        "both of two effects": "both of two",
        "at least one of two effects": "at least one of two",
        "nothing but what is hidden, one or two effects or a fault": "nothing but what is hidden",
        "false alarms where nothing is missing": "false alarms",
    }
    assert published.keys() == titles.keys()
    for title, label in titles.items():
        counted = [table[label] for table in found]
        assert published[title] == [f"{100 * r.right / r.of:.0f} % ({r.right}/{r.of})" for r in counted]


def test_wilson_interval():
    """The two ends solve (p̂ − p)² = z² p (1 − p)/n."""
    low, high = rates.Rate(45, 50).interval()
    for p in (low, high):
        assert (0.9 - p) ** 2 == pytest.approx(1.96**2 * p * (1.0 - p) / 50)
    assert low < 0.9 < high
    assert rates.Rate(0, 50).interval()[0] == pytest.approx(0.0, abs=1e-12)
