"""Decision rules of the search, on trials with given gains."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from edhas_jax.diagnosis.search.backward_pass import is_kept
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.decision_rules import (
    EXCESS_SIGMAS,
    holds_by_library_law,
    is_promising,
    least_predicted_gain,
    least_strength,
    remaining,
)
from edhas_jax.diagnosis.search.law_deviation import LawDeviation
from edhas_jax.diagnosis.search.result import MemberTest
from edhas_jax.diagnosis.search.screening import Score
from edhas_jax.diagnosis.search.trial import Trial
from edhas_jax.machine.effects import AmplifierLag, CoggingForce

SAMPLES = 20_000


def trial(kind, gain: float, left: float, own_law_gain: float, own_law_left: float) -> Trial:
    """A trial with its gain and its remaining misfit [nats], with the law of the library and with another law."""
    score = Score(Candidate(kind, None), 2.0 * gain, np.zeros(1), np.zeros(0))
    scatter = EXCESS_SIGMAS * math.sqrt(0.5 * SAMPLES)
    return dataclasses.replace(
        Trial.failed(score), evaluated=object(), left_out_gain=gain, gain_beyond_laws=gain,
        remaining_excess=left + scatter, own_law_gain=own_law_gain, own_law_excess=own_law_left + scatter,
    )  # fmt: skip


def test_what_is_left_counts_beyond_the_scatter_of_noise():
    assert remaining(EXCESS_SIGMAS * math.sqrt(0.5 * SAMPLES), SAMPLES) == 0.0
    assert remaining(1000.0, SAMPLES) == 1000.0 - EXCESS_SIGMAS * 100.0


def test_beside_a_large_misfit_a_smaller_gain_keeps_an_effect():
    """A misfit over the variance of the noise of 1, which small disturbances may leave, and of 10."""
    small, large = (
        least_strength(SimpleNamespace(excess=0.5 * share * SAMPLES, samples=SAMPLES)) for share in (1.0, 10.0)
    )
    assert large < small < 1.0


def test_a_candidate_is_promising_by_another_law_too():
    """A gain of 7158 nats with another law makes a trial promising, although the library's law gains only 19."""
    found = trial(CoggingForce, 19.0, 7000.0, 7158.0, 10.0)
    assert is_promising(found, SAMPLES)
    assert not is_promising(
        dataclasses.replace(found, own_law_gain=19.0, own_law_excess=found.remaining_excess), SAMPLES
    )


def test_only_a_law_without_memory_has_to_be_found_by_a_fit():
    assert not holds_by_library_law(trial(CoggingForce, 19.0, 7000.0, 7158.0, 10.0), SAMPLES)
    assert holds_by_library_law(trial(CoggingForce, 5000.0, 7000.0, 7158.0, 10.0), SAMPLES)
    assert holds_by_library_law(trial(AmplifierLag, 19.0, 7000.0, 7158.0, 10.0), SAMPLES)


def test_beside_a_law_as_a_curve_a_candidate_is_tried_only_if_it_promises_to_explain_what_is_left():
    """A tenth of what is left is tried beside the library's law, where a linear prediction may be far too small."""
    left, law_error = 2000.0, 400.0
    excess = left + EXCESS_SIGMAS * math.sqrt(0.5 * SAMPLES)
    model = SimpleNamespace(samples=SAMPLES, excess_with=lambda deviations: excess)
    effect, curve = Candidate(CoggingForce, None), object.__new__(LawDeviation)
    assert least_predicted_gain(model, (), None, 0.0) == 0.0
    assert least_predicted_gain(model, (effect,), None, law_error) < 0.1 * left
    assert 0.1 * left < least_predicted_gain(model, (effect, curve), None, law_error) < 0.3 * left


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("name", ["gain_beyond_laws", "own_law_gain", "own_law_excess"])
def test_a_number_that_is_not_finite_never_makes_a_trial_promising(name, value):
    sound = trial(CoggingForce, 5000.0, 10.0, 5000.0, 10.0)
    assert is_promising(sound, SAMPLES)
    assert not is_promising(dataclasses.replace(sound, **{name: value}), SAMPLES)


@pytest.mark.parametrize("strength", [math.nan, -math.inf])
def test_a_member_whose_strength_is_not_a_number_does_not_stay(strength):
    test = MemberTest(Candidate(CoggingForce), 1.0, 1.0, strength)
    assert not is_kept(test, 0.7) and is_kept(test._replace(strength=0.7), 0.7)
