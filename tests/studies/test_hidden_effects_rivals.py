"""The rival methods of the benchmark of hidden effects, on constructed residuals and features."""

import dataclasses
import types

import numpy as np
import pytest
from scipy.optimize import nnls

from edhas_jax.diagnosis.search.candidates import Candidate, screening_grid
from edhas_jax.machine.effects.mover.lugre_friction import LugreFriction
from edhas_jax.measurements.campaign import BenchRun, Use
from studies.hidden_effects.answers import NOTHING, UNKNOWN, HiddenEffect, Law, Truth, Verdict
from studies.hidden_effects.drawing import CaseKey, draw
from studies.hidden_effects.generators.hidden_case import Split
from studies.hidden_effects.naming import answer_of_names, credible_set, unknown_where_unexplained
from studies.hidden_effects.rivals.best_subset import best_subset
from studies.hidden_effects.rivals.bic_refits import schwarz_weights
from studies.hidden_effects.rivals.classifier import Classifier, NotTrained, TrainingCase, read_training
from studies.hidden_effects.rivals.correlation import correlation
from studies.hidden_effects.rivals.features import SUSPECT_FEATURES, Features, features_of
from studies.hidden_effects.rivals.grams import grams_of
from studies.hidden_effects.rivals.weak_rates import _windows
from studies.hidden_effects.signatures import Signatures, SignatureTable
from studies.hidden_effects.whitening import whitened

NAMES = ("eddy_drag", "backlash", "supply_sag", "seal_friction", "hose_compliance", "sensor_gain on current")
RUNS, SIGNALS, SAMPLES, PARAMETERS = 4, 2, 500, 3


def table(sizes=None, of_parameters=0.0, drift=0.0):
    """A table with signatures at the sizes 1 and 2, and a residual of unit noise with some of them in it.

    Args:
        sizes: size of each suspect in the residual.
        of_parameters: how much of the first parameter every signature contains.
        drift: an addition to the residual of the first run only.
    """
    rng = np.random.default_rng(5)
    count = RUNS * SIGNALS * SAMPLES
    run = np.repeat(np.arange(RUNS), SIGNALS * SAMPLES)
    slopes = rng.standard_normal((count, PARAMETERS))
    shapes = 0.2 * rng.standard_normal((len(NAMES), count)) + of_parameters * slopes[:, 0]
    residual = rng.standard_normal(count) + sum(size * shapes[NAMES.index(n)] for n, size in (sizes or {}).items())
    residual = residual + drift * (run == 0) * shapes[0]
    suspects = [
        Signatures(types.SimpleNamespace(name=n), np.array([[0.0], [1.0]]), np.array([shape, 2.0 * shape]))
        for n, shape in zip(NAMES, shapes, strict=True)
    ]
    return SignatureTable(
        run, np.tile(np.repeat(np.arange(SIGNALS), SAMPLES), RUNS), tuple(f"run{r}" for r in range(RUNS)),
        ("current", "voltage"), residual, slopes, np.zeros(PARAMETERS), np.ones(PARAMETERS, bool), tuple(suspects),
    )  # fmt: skip


@pytest.mark.parametrize("method", [correlation, best_subset])
def test_linear_methods_name_what_is_in_the_residual(method):
    assert method(table()).named == () and method(table()).verdict is Verdict.ADEQUATE
    found = method(table({"hose_compliance": 2.0, "backlash": 1.0}))
    assert found.named == ("hose_compliance", "backlash") and found.place == "outlet"
    assert set(found.ranked[:2]) == {"hose_compliance", "backlash"} and len(found.ranked) == len(NAMES)
    assert found.verdict is Verdict.MISSING_EFFECT


@pytest.mark.parametrize("method", [correlation, best_subset])
def test_linear_methods_name_neither_negative_sizes_nor_what_parameters_explain(method):
    assert method(table({"hose_compliance": -2.0})).named == ()
    whole = table(of_parameters=0.3)
    shifted = dataclasses.replace(whole, residual=whole.residual + whole.slopes @ [0.5, -0.4, 0.3])
    assert method(shifted).named == ()


def test_the_best_subset_must_explain_more_than_one_run():
    assert best_subset(table(drift=1.0)).named == ()
    assert best_subset(table({"eddy_drag": 1.0})).named == ("eddy_drag",)


def test_scalar_products_give_the_fit_to_some_runs_and_its_error_on_another():
    data = table({"eddy_drag": 1.5, "supply_sag": 0.5})
    data = dataclasses.replace(data, x=np.array([0.3, -0.2, 0.1]))
    grams = grams_of(data)
    columns = np.array([0, 1, 5])
    signatures = np.concatenate([s.rows for s in data.suspects])[columns]
    inside, outside = data.run != 2, data.run == 2
    # unknowns of either sign as differences of two that are not negative
    prior = np.concatenate([np.eye(3), -np.eye(3)], axis=1)
    rows = np.concatenate([data.slopes, -data.slopes, signatures.T], axis=1)
    whole = np.concatenate([rows[inside], np.concatenate([prior, np.zeros((3, 3))], axis=1)])
    expected, length = nnls(whole, np.concatenate([data.residual[inside], -data.x]), maxiter=1000)
    fit = grams.fitted_to([0, 1, 3])
    weights, fall = fit.weights(columns)
    np.testing.assert_allclose(signatures.T @ weights, signatures.T @ expected[6:], atol=1e-4)
    assert fall == pytest.approx(fit.projected[0, 0] - length**2, rel=1e-5)
    error = np.sum(np.square(data.residual[outside] - rows[outside] @ expected))
    assert fit.error_on(2, columns, weights) == pytest.approx(error, rel=1e-5)
    assert grams.counts.sum() == len(data.residual)


def test_whitened_noise_is_white_and_of_unit_size():
    rng = np.random.default_rng(1)
    coefficients, noise = (0.6, -0.2), np.zeros(40000)
    innovations = rng.standard_normal(40000)
    for t in range(2, 40000):
        noise[t] = 0.6 * noise[t - 1] - 0.2 * noise[t - 2] + innovations[t]
    found = whitened(noise / noise.std(), coefficients)
    assert np.isnan(found[:2]).all()
    white = found[100:]
    assert white.std() == pytest.approx(1.0, abs=0.02)
    assert abs(np.mean(white[1:] * white[:-1])) < 0.02 and abs(np.mean(white[2:] * white[:-2])) < 0.02
    both = whitened(np.stack([noise, 2.0 * noise], axis=1), coefficients)
    np.testing.assert_allclose(both[2:, 1], 2.0 * both[2:, 0])
    np.testing.assert_array_equal(whitened(noise, ()), noise)


def test_names_that_leave_most_of_the_misfit_are_not_an_answer():
    rng = np.random.default_rng(0)
    before, half, noise = (size * rng.standard_normal(20000) for size in (3.0, 2.5, 1.05))
    named = answer_of_names(("eddy_drag",), ("eddy_drag",))
    assert unknown_where_unexplained(named, before, noise) == named
    unknown = unknown_where_unexplained(named, before, half)
    assert unknown.first == UNKNOWN and unknown.place == "mover" and unknown.answer_set == (UNKNOWN,)
    nothing = answer_of_names((), ("hose_compliance",))
    assert unknown_where_unexplained(nothing, noise, noise) == nothing
    assert unknown_where_unexplained(nothing, before, before).place == "outlet"


def test_weights_of_models_and_the_smallest_set():
    weights = schwarz_weights({"a": 10.0, NOTHING: 14.0, "b": 11.0})
    assert list(weights) == ["a", "b", NOTHING] and sum(weights.values()) == pytest.approx(1.0)
    assert weights["b"] / weights["a"] == pytest.approx(np.exp(-0.5))
    assert credible_set({"a": 0.6, "b": 0.36, "c": 0.04}) == ("a", "b")
    assert credible_set({"a": 0.6, "b": 0.3, "c": 0.1}) == ("a", "b", "c")


def test_weak_form_needs_no_derivative():
    """∫φ ẏ = −∫φ̇ y and ∫φ ÿ = ∫φ̈ y for a sine."""
    time = 1e-4 * np.arange(800)
    run = BenchRun("run", None, Use.FIT, {}, time, {}, np.arange(800))
    windows, omega = _windows(run), 2.0 * np.pi * 30.0
    y, speed, acceleration = np.sin(omega * time), omega * np.cos(omega * time), -(omega**2) * np.sin(omega * time)
    np.testing.assert_allclose(-windows.first @ y, windows.value @ speed, atol=2e-4 * omega)
    np.testing.assert_allclose(windows.second @ y, windows.value @ acceleration, atol=2e-3 * omega**2)
    assert len(windows.value) > 20 and windows.value.sum(axis=1) == pytest.approx(1.0)


def test_sparse_regression_finds_terms_that_hold_in_all_runs():
    pytest.importorskip("pysindy")
    from studies.hidden_effects.rivals.sparse_regression import Regression, chosen_threshold, ensemble

    rng = np.random.default_rng(2)
    terms, run = rng.standard_normal((900, 8)), np.repeat(np.arange(6), 150)
    noise = rng.standard_normal(900)
    names = tuple("abcdefgh")
    assert chosen_threshold(Regression(noise, terms, names, run)) is None
    target = noise + 0.6 * terms[:, 3] + 0.4 * terms[:, 6]
    problem = Regression(target / target.std(), terms, names, run)
    inclusion, weights = ensemble(problem, chosen_threshold(problem))
    assert set(np.flatnonzero(inclusion > 0.6)) == {3, 6} and weights[3] > weights[6] > 0.2


def test_sparse_regression_names_nothing_where_no_rate_is_measured(monkeypatch):
    pytest.importorskip("pysindy")
    from studies.hidden_effects.rivals import sparse_regression

    monkeypatch.setattr(sparse_regression, "WeakRates", lambda *_: types.SimpleNamespace(equations={}))
    fitted = types.SimpleNamespace(problem=types.SimpleNamespace(campaign=None))
    answer = sparse_regression.sparse_discrepancy(fitted, [], 1)
    assert answer.verdict is Verdict.ADEQUATE and answer.named == ()


def test_sparse_regression_leaves_out_sizes_that_contradict_each_other():
    """LuGre friction needs a static friction that is not below the Coulomb friction; not all points of the grid do."""
    pytest.importorskip("pysindy")
    from studies.hidden_effects.rivals.sparse_regression import _on_grid

    case = draw(CaseKey("f", Split.VARIED, 2))
    machine = dataclasses.replace(case.machine, effects=())
    candidate = Candidate(LugreFriction)
    found = list(_on_grid(candidate, types.SimpleNamespace(machine=machine, instruments=()), case.campaign))
    assert 0 < len(found) < len(screening_grid(candidate.unknowns(case.campaign)))
    for changed in found:
        friction = changed.effects[0]
        assert friction.static_friction >= friction.coulomb_friction


def test_features_of_a_constructed_case():
    features = features_of(table({"seal_friction": 1.5}), (2e-4,) * RUNS)
    by = dict(zip(SUSPECT_FEATURES, features.suspects[NAMES.index("seal_friction")], strict=True))
    assert by["rank"] == 0 and by["positive_runs"] == 1.0 and 0.05 < by["left_out_share"] < 0.1
    assert by["log_weight"] == pytest.approx(np.log10(0.75), abs=0.1) or by["log_weight"] == pytest.approx(
        np.log10(1.5), abs=0.1
    )
    others = np.delete(features.suspects, NAMES.index("seal_friction"), axis=0)
    assert others[:, SUSPECT_FEATURES.index("cosine")].max() < 0.3 * by["cosine"]
    again = Features.from_json(features.as_json())
    np.testing.assert_array_equal(again.suspects, features.suspects)
    np.testing.assert_array_equal(again.case, features.case)
    assert again.names == NAMES and np.isnan(again.case).sum() == 6 * 7


def training_case(rng, number):
    """A case with the largest cosine where an effect is hidden; all are small for nothing, all large for unknown."""
    hidden = NAMES[number % len(NAMES)]
    kind = ("named", "named", "named", NOTHING, UNKNOWN)[number % 5]
    suspects = np.abs(0.02 * rng.standard_normal((len(NAMES), len(SUSPECT_FEATURES))))
    suspects[:, SUSPECT_FEATURES.index("kind")] = np.arange(len(NAMES))
    case = np.zeros(6 + 8 * 7)
    case[:2] = 0.0 if kind == NOTHING else 0.6
    suspects[:, SUSPECT_FEATURES.index("log_fall")] += 0.5 if kind == NOTHING else 2.0
    suspects[:, SUSPECT_FEATURES.index("cosine")] += 0.3 if kind == UNKNOWN else 0.0
    if kind == "named":
        suspects[NAMES.index(hidden), SUSPECT_FEATURES.index("cosine")] += 0.8
    effects = () if kind == NOTHING else (HiddenEffect(hidden, ("mover",), Law.LIBRARY, {}, 100.0),)
    return TrainingCase(Truth("b", "tuning", number, effects, kind == UNKNOWN), Features(NAMES, suspects, case))


def test_the_classifier_learns_names_nothing_and_unknown(tmp_path):
    pytest.importorskip("sklearn")
    rng = np.random.default_rng(4)
    classifier = Classifier([training_case(rng, k) for k in range(150)])
    right = 0
    for number in range(200, 220):
        case = training_case(rng, number)
        answer = classifier.answer(case.features)
        right += answer.first == (case.truth.hidden[0].name if case.kind == "named" else case.kind)
        assert answer.first in answer.answer_set and answer.probability > 0.3
        probabilities = classifier.probabilities(case.features)
        assert sum(probabilities.values()) == pytest.approx(1.0) and set(probabilities) == {*NAMES, NOTHING, UNKNOWN}
    assert right >= 17  # of 20; by chance 5
    with pytest.raises(NotTrained, match="0 training cases for the classifier, 20 are needed"):
        read_training(tmp_path)
