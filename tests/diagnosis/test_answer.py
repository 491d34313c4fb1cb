"""Probabilities and sets of a diagnosis from its evidence."""

import dataclasses
import math

import pytest

from edhas_jax.diagnosis.search.answer import CONSTANTS, NOTHING, UNKNOWN, Evidence, Rivals, answer_from


def rivals(strength: float, left: float = 0.0, is_implausible: bool = False, **gains: float) -> Rivals:
    """Candidates with log-evidence gains, the first of which was accepted."""
    return Rivals(next(iter(gains)), strength, gains, left, is_implausible)


def test_without_a_misfit_nothing_is_missing():
    answer = answer_from(Evidence((), 0.0, 0.0))
    unseen = 1.0 - CONSTANTS.max_nothing
    assert answer.first == NOTHING and answer.members == (NOTHING, UNKNOWN)
    assert answer.probabilities == pytest.approx({NOTHING: 1.0 - unseen, UNKNOWN: unseen})


def test_probabilities_of_single_causes_sum_to_one():
    for strength in (0.1, 1.0, 30.0):
        for is_implausible in (False, True):
            member = rivals(strength, 50.0, is_implausible, cogging_force=500.0, parasitic_spring=480.0)
            answer = answer_from(Evidence((member,), 0.5, 0.4))
            assert sum(answer.probabilities.values()) == pytest.approx(1.0)
            assert answer.probabilities["cogging_force"] > answer.probabilities["parasitic_spring"]


def test_a_strong_candidate_is_named_and_a_weak_one_is_not():
    strong = answer_from(Evidence((rivals(100.0, cogging_force=1000.0, seal_friction=10.0),), 0.5, 0.0))
    assert strong.first == "cogging_force"
    weak = answer_from(Evidence((rivals(0.05, 1e4, cogging_force=500.0),), 0.5, 0.0))
    assert weak.first == NOTHING


def test_rivals_are_compared_on_the_scale_of_what_is_left():
    gains = {"cogging_force": 1000.0, "parasitic_spring": 900.0}
    sharp, blurred = (
        answer_from(Evidence((rivals(9.0, left, **gains),), 0.5, 0.0)).probabilities for left in (0.0, 5000.0)
    )
    assert sharp["parasitic_spring"] < 0.01 < 0.2 < blurred["parasitic_spring"]


def test_rivals_are_compared_on_the_scale_of_what_is_explained():
    """Real laws differ from those of the library by so much that a small share of the gain says nothing."""
    small, large = (
        answer_from(Evidence((rivals(9.0, 0.0, cogging_force=gain, parasitic_spring=gain - 50.0),), 0.5, 0.0))
        for gain in (100.0, 50_000.0)
    )
    assert small.probabilities["parasitic_spring"] < 1e-3 < 0.4 < large.probabilities["parasitic_spring"]


def test_of_names_that_explain_the_same_the_one_with_fewer_parameters_is_more_probable():
    gains, counts = {"parasitic_spring": 500.0, "cogging_force": 501.0}, {"parasitic_spring": 1.0, "cogging_force": 3.0}
    counted = dataclasses.replace(rivals(50.0, **gains), parameters=counts)
    names = counted.names()
    assert names["parasitic_spring"] == pytest.approx(0.8) and names["cogging_force"] == pytest.approx(0.2)


def test_one_place_that_explains_a_misfit_speaks_for_one_unknown_cause():
    scattered, placed = (
        answer_from(Evidence((), 0.5, share, free_strength=share / (1.0 - share))).probabilities[UNKNOWN]
        for share in (0.1, 0.95)
    )
    assert scattered == pytest.approx(1.0 - CONSTANTS.max_nothing) and placed > 0.8


def test_many_small_causes_leave_little_of_a_signal():
    small, large = (answer_from(Evidence((), 5.0, 0.1, left, free_strength=0.5)).first for left in (0.01, 0.3))
    assert (small, large) == (NOTHING, UNKNOWN)


def test_the_answer_to_a_large_misfit_of_a_signal_is_never_nothing():
    """Also where no free curve at any place explains it."""
    answer = answer_from(Evidence((), 200.0, 0.3, 0.3, distortion=2.4))
    assert answer.first == UNKNOWN and answer.probabilities[NOTHING] < 0.05


def test_a_gain_as_large_as_what_is_left_is_more_probably_real_where_the_misfit_is_large():
    """Many small causes, one of which may imitate an effect, do not add up to a large misfit."""
    small, large = (rivals(1.0, 5000.0, cogging_force=5000.0).probability_real(misfit) for misfit in (0.01, 10.0))
    assert small < 0.2 and large > 0.5
    alone = rivals(4.0, 0.0, cogging_force=48.0)  # where nothing is left nothing can be imitated
    assert alone.probability_real(0.01) == alone.probability_real(10.0) > 0.8


def test_an_implausible_value_speaks_for_an_unknown_cause():
    usual, implausible = (
        answer_from(Evidence((rivals(50.0, 0.0, flag, cogging_force=900.0),), 0.5, 0.0)).probabilities[UNKNOWN]
        for flag in (False, True)
    )
    assert implausible > usual + 0.2


def test_of_nearly_equally_probable_names_the_one_that_explains_most_is_first():
    """A large effect whose value is implausible is named before a small certain one, unless it is far less probable."""
    small = rivals(20.0, seal_friction=60.0)
    for strength, first in ((200.0, "cogging_force"), (0.8, "seal_friction")):
        answer = answer_from(Evidence((rivals(strength, 0.0, True, cogging_force=2400.0), small), 0.5, 0.0))
        largest = max(answer.probabilities, key=answer.probabilities.get)
        assert largest == "seal_friction" and answer.first == first


def test_a_set_holds_the_nominal_probability():
    member = rivals(3.0, 1000.0, cogging_force=500.0, parasitic_spring=480.0, seal_friction=300.0)
    sizes = []
    for coverage in (0.5, 0.9, 0.99):
        answer = answer_from(Evidence((member,), 0.5, 0.4), dataclasses.replace(CONSTANTS, coverage=coverage))
        assert sum(answer.probabilities[name] for name in answer.members) >= coverage
        sizes.append(len(answer.members))
    assert sizes == sorted(sizes) and sizes[0] < sizes[-1]


def test_a_further_member_that_is_hardly_real_adds_no_names_to_the_set():
    first = rivals(1000.0, cogging_force=5000.0)
    doubtful = rivals(0.03, parasitic_spring=300.0, seal_friction=299.0, eddy_drag=298.0)
    real = rivals(100.0, parasitic_spring=300.0)
    assert doubtful.probability_real(1.0) < 1.0 - CONSTANTS.coverage
    assert answer_from(Evidence((first, doubtful), 0.5, 0.0)).members == ("cogging_force",)
    assert set(answer_from(Evidence((first, real), 0.5, 0.0)).members) == {"cogging_force", "parasitic_spring"}


def test_an_implausible_value_costs_the_same_however_much_is_left():
    """Of two equally good effects, that with a parameter 3 standard deviations from its prior mean is less probable."""
    for left in (0.0, 5000.0):
        member = rivals(50.0, left, backlash=1000.0, coupling_compliance=1000.0)
        names = dataclasses.replace(member, prior_costs={"backlash": 2.5}).names()
        assert names["backlash"] / names["coupling_compliance"] == pytest.approx(math.exp(-2.5))
