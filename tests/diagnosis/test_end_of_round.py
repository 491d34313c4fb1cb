"""The end of a round of the search: a candidate with an implausible value is replaced by a plausible one."""

import dataclasses
import types

import numpy as np
import pytest

from edhas_jax.diagnosis.search import selection_round
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.plausibility import ImplausibilityCost
from edhas_jax.diagnosis.search.result import Round
from edhas_jax.diagnosis.search.screening import Score
from edhas_jax.diagnosis.search.selection_round import end_of_round
from edhas_jax.diagnosis.search.stage_encoding import RoundEnd
from edhas_jax.diagnosis.search.trial import Trial
from edhas_jax.machine.effects import Backlash, CouplingCompliance
from edhas_jax.measurements.time_resolution import TimeResolution

SAMPLES, GAIN = 20_000, 90_000.0
PLAY, ROD = Candidate(Backlash), Candidate(CouplingCompliance)


def model(excess: float):
    """Stands in for a fitted model that leaves this excess of ½χ² over its expected value [nats]."""
    return types.SimpleNamespace(samples=SAMPLES, excess=excess, log_evidence=-excess, fit=excess)


def found() -> Round:
    """A search round in which backlash raises the log-evidence slightly more than an elastic coupling."""
    trials = []
    for candidate, gain in ((PLAY, GAIN), (ROD, GAIN - 3000.0)):
        trial = Trial.failed(Score(candidate, 2.0 * gain, np.zeros(1), np.zeros(0)))
        trials.append(dataclasses.replace(
            trial, evaluated=object(), left_out_gain=gain, gain_beyond_laws=gain, own_law_gain=gain,
            remaining_excess=2000.0, own_law_excess=2000.0,
        ))  # fmt: skip
    return Round(model(GAIN), (), tuple(trials), trials[0])


@pytest.fixture
def ended(monkeypatch):
    """`ended(left, implausible)`: the end of the round where the models leave `left` [nats] by candidate."""

    def ended(left, implausible):
        def end_with(of_round, trial, *others):
            return RoundEnd(dataclasses.replace(of_round, accepted=trial), model(left[trial.candidate]))

        monkeypatch.setattr(selection_round, "_end_with", end_with)
        def cost(candidate, evaluated, gain):
            return ImplausibilityCost(330.0, 2.5) if candidate in implausible else ImplausibilityCost()

        monkeypatch.setattr(selection_round, "implausibility_cost", cost)
        return end_of_round(found(), (), TimeResolution(4, 4, 0.0), lambda sentence: None, 0.0, 2)

    return ended


def test_the_best_candidate_is_accepted_if_it_is_plausible(ended):
    assert ended({PLAY: 1500.0, ROD: 1000.0}, ()).round.accepted.candidate == PLAY


def test_a_plausible_candidate_that_leaves_little_more_is_accepted_instead(ended):
    end = ended({PLAY: 1000.0, ROD: 1500.0}, (PLAY,))
    assert end.round.accepted.candidate == ROD and end.baseline.excess == 1500.0
    rejected = next(trial for trial in end.round.trials if trial.candidate == PLAY)
    assert rejected.prior_cost == 2.5
    # the evidence of the fits with curves counts now, and what the implausible value costs
    assert rejected.mean_gain - end.round.accepted.mean_gain == pytest.approx(500.0 - 330.0)


@pytest.mark.parametrize(("left", "implausible"), [(3000.0, (PLAY,)), (1000.0, (PLAY, ROD))])
def test_one_that_leaves_far_more_or_is_implausible_too_is_not(ended, left, implausible):
    assert ended({PLAY: 1000.0, ROD: left}, implausible).round.accepted.candidate == PLAY
