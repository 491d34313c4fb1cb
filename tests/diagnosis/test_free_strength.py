"""Strength of the best free term, the answers that follow from it, and the error that a fitted law curve may leave."""

from types import SimpleNamespace

import pytest

from edhas_jax.diagnosis.search import unknown_cause
from edhas_jax.diagnosis.search.answer import NOTHING, UNKNOWN, Evidence, Rivals, answer_from
from edhas_jax.diagnosis.search.backward_pass import LAW_ERROR_SHARE_AT_COMPONENT, _law_error, _needless_curve
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.decision_rules import IRREGULAR_SCATTER, LAW_ERROR_SHARE, MIN_GAIN
from edhas_jax.diagnosis.search.law_deviation import LawDeviation
from edhas_jax.diagnosis.search.localisation import FREE_COST, free_strength
from edhas_jax.machine.effects import CoggingForce, EddyDrag, HoseCompliance
from edhas_jax.machine.effects.tabulated_law import LawPlace, tabulated_class
from edhas_jax.measurements.time_resolution import TimeResolution

SAMPLES = 20_000


def model(excess: float, is_irregular: bool = False):
    fit = SimpleNamespace(problem=SimpleNamespace(is_irregular=is_irregular), values={})
    return SimpleNamespace(excess=excess, cost=excess, samples=SAMPLES, fit=fit)


def score(gain: float):
    return SimpleNamespace(predicted_gain=gain)


def test_near_the_noise_the_prediction_counts():
    assert free_strength(model(50.0), [score(FREE_COST)], ()) == 0.0
    assert free_strength(model(50.0), [score(FREE_COST + 10.0 * MIN_GAIN)], ()) == pytest.approx(10.0)


def test_a_gain_below_what_two_fits_of_an_irregular_model_differ_by_is_weak():
    gain = [score(FREE_COST + IRREGULAR_SCATTER * 0.5 * SAMPLES)]
    assert free_strength(model(50.0), gain, ()) > 5.0
    assert free_strength(model(50.0, is_irregular=True), gain, ()) < 1.0


def test_what_an_irregular_model_finds_without_the_term_is_no_merit_of_the_term(monkeypatch):
    monkeypatch.setattr(unknown_cause, "fit_coarse", lambda *_: model(60.0))
    monkeypatch.setattr(unknown_cause, "start_coordinates", lambda *_: None)
    term = SimpleNamespace(evaluated=model(50.0))
    refitted, regular = (
        unknown_cause._refitted_without_term(model(900.0, is_irregular), [term], TimeResolution(8, 8, 0.1))
        for is_irregular in (True, False)
    )
    assert refitted.excess == 60.0 and regular.excess == 900.0


def test_many_small_causes_leave_much_with_any_term():
    assert free_strength(model(9000.0), [score(2000.0)], ()) < 0.5
    assert free_strength(model(9000.0), [score(8500.0)], ()) > 5.0


def test_far_from_the_noise_only_a_fit_counts():
    fitted = SimpleNamespace(evaluated=model(5e3))
    assert free_strength(model(5e5), [score(4.9e5)], ()) == 0.0
    assert free_strength(model(5e5), [score(4.9e5)], (fitted,)) > 50.0


def test_a_cause_without_misfit_is_unknown_where_one_term_stands_out():
    small, large = (answer_from(Evidence((), 0.0, 0.3, 0.0, 1.0, strength)) for strength in (0.1, 30.0))
    assert small.first == NOTHING and large.first == UNKNOWN


def test_an_effect_that_a_single_curve_far_surpasses_only_imitates_its_cause():
    member = Rivals("magnetic_saturation", 1.3, {"magnetic_saturation": 977.0}, 850.0)
    alone, surpassed = (answer_from(Evidence((member,), 1.1, 0.9, 0.04, 1.0, free)) for free in (0.0, 170.0))
    assert alone.first == "magnetic_saturation" and surpassed.first == UNKNOWN
    assert sum(surpassed.probabilities.values()) == pytest.approx(1.0)


def deviation_of(kind) -> LawDeviation:
    place = LawPlace("mover_force", "piston_position")
    return LawDeviation(tabulated_class(f"{kind.id}_deviation", place, 2), None, place, 1.0, (0.0, 1.0))


def test_a_law_known_as_a_curve_leaves_a_share_of_what_it_explains():
    cogging, drag, hose = Candidate(CoggingForce), Candidate(EddyDrag), Candidate(HoseCompliance)
    curve = deviation_of(CoggingForce)

    def law_error(candidate, mounted, **explained):
        return _law_error(candidate, mounted, {"cogging_force": 1.0, "hose_compliance": 1.0} | explained)

    assert law_error(drag, [cogging, drag]) == 0.0
    assert law_error(drag, [cogging, curve, drag]) == LAW_ERROR_SHARE_AT_COMPONENT
    assert law_error(hose, [cogging, curve, hose]) == LAW_ERROR_SHARE
    assert law_error(cogging, [cogging, curve, hose]) == 0.0
    assert law_error(curve, [cogging, curve, hose]) == 0.0
    # what effects explain whose law is as in the library does not count
    assert law_error(drag, [cogging, curve, hose, drag], hose_compliance=1e6) == LAW_ERROR_SHARE_AT_COMPONENT
    assert law_error(drag, [cogging, curve, drag], cogging_force=5.0) == 5.0 * LAW_ERROR_SHARE_AT_COMPONENT


def test_a_curve_in_whose_place_an_effect_explains_far_more_is_removed_before_the_effect():
    cogging, hose = Candidate(CoggingForce), Candidate(HoseCompliance)
    mounted = [cogging, deviation_of(CoggingForce), hose]

    def needless(without_curve: float, without_hose: float, removable=(1, 2), hidden=(2,)):
        return _needless_curve(mounted, [model(1e6), model(without_curve), model(without_hose)], removable, hidden)

    assert needless(1000.0, 9000.0) == 1
    assert needless(8000.0, 9000.0) is None, "the curve follows as much as the effect: the simpler name stays"
    assert needless(1000.0, 9000.0, removable=(2,)) is None, "the curve is needed"
    assert needless(1000.0, 9000.0, hidden=()) is None, "the effect is weak without any error of the curve"
