"""Effects of the final model compared with their rivals once more, with all other effects in the model."""

import dataclasses
from types import SimpleNamespace

import pytest

from edhas_jax.core import structs
from edhas_jax.diagnosis.chosen_effects import calibrated_model
from edhas_jax.diagnosis.search import forward_selection
from edhas_jax.diagnosis.search.backward_pass import TakenBack, take_back
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.law_deviation import LawDeviation
from edhas_jax.diagnosis.search.member_rivals import with_rivals_compared
from edhas_jax.diagnosis.search.result import Round
from edhas_jax.diagnosis.search.screening import ScoreTest
from edhas_jax.diagnosis.search.trial import Trial, try_candidate
from edhas_jax.machine.effects import (
    AsymmetricFriction,
    EddyDrag,
    ForceConstantDroop,
    InverterDeadTime,
    ParasiticSpring,
)
from edhas_jax.machine.effects.tabulated_law import LawPlace, tabulated_class
from edhas_jax.measurements.campaign import Use
from tests.support.synthetic_campaign import bench, empty_campaign, measured

SPRING, DEAD_TIME = Candidate(ParasiticSpring), Candidate(InverterDeadTime)
STEPS = 12  # maximum number of Levenberg-Marquardt steps


@pytest.fixture(scope="module")
def calibrated():
    """The calibrated model, with its time step; the bench has a spring and a dead time that the model does not have."""
    campaign, machine = empty_campaign(), bench()
    hidden = (ParasiticSpring(spring_rate=700.0), InverterDeadTime(dead_time_voltage=0.8))
    return calibrated_model(measured(campaign, structs.replace(machine, effects=(*machine.effects, *hidden))))


def tried(baseline, accepted, candidate, resolution) -> Trial:
    """A fit with the candidate, with its gain and misfit entered as a round of the search does it."""
    score = ScoreTest(baseline.fit, accepted).score(candidate)
    trial = try_candidate(baseline, accepted, score, resolution, STEPS)
    excess, gain = trial.evaluated.excess, trial.log_evidence_gain
    return dataclasses.replace(
        trial, remaining_excess=excess, own_law_excess=excess, gain_beyond_laws=gain, own_law_gain=gain
    )


def rounds_with(calibrated, first: Candidate, *rivals: Candidate) -> list[Round]:
    """The rounds of a search that has accepted one candidate over its rivals, and then the dead time."""
    start, resolution = calibrated.evaluated, calibrated.resolution
    trials = tuple(tried(start, (), candidate, resolution) for candidate in (first, *rivals))
    second = tried(trials[0].evaluated, (first,), DEAD_TIME, resolution)
    return [
        Round(start, (), trials, trials[0]),
        Round(trials[0].evaluated, (), (second,), second),
        Round(second.evaluated, (), (), None),
    ]


def test_rivals_are_compared_by_what_the_final_model_leaves(calibrated):
    rounds = rounds_with(calibrated, SPRING, Candidate(EddyDrag), Candidate(ForceConstantDroop))
    # as if the candidates had hardly differed in that round
    rounds[0] = dataclasses.replace(
        rounds[0],
        trials=tuple(
            dataclasses.replace(t, gain_beyond_laws=1000.0 - k, own_law_gain=1000.0 - k, own_law_excess=5000.0)
            for k, t in enumerate(rounds[0].trials)
        ),
    )
    rounds[0] = dataclasses.replace(rounds[0], accepted=rounds[0].trials[0])
    sentences = []
    found = with_rivals_compared(TakenBack(rounds, []), calibrated.resolution, sentences.append)
    member, *rivals = found.rounds[0].trials
    assert found.rounds[0].accepted is member and member.candidate == SPRING
    assert member.evaluated is rounds[-1].baseline
    assert member.own_law_excess < 100.0 < min(trial.own_law_excess for trial in rivals)
    assert all(member.mean_gain - trial.mean_gain > 100.0 for trial in rivals)
    assert found.rounds[1:] == rounds[1:], "the last member was compared with the others in the model already"
    assert any("in the place of parasitic_spring" in sentence for sentence in sentences)


def test_a_rival_that_leaves_far_less_takes_the_place_of_the_member(calibrated):
    wrong = Candidate(AsymmetricFriction)
    rounds = rounds_with(calibrated, wrong, SPRING)
    sentences = []
    found = with_rivals_compared(TakenBack(rounds, []), calibrated.resolution, sentences.append)
    assert "parasitic_spring takes the place of asymmetric_friction" in sentences
    assert {member.candidate for member in found.members} == {SPRING, DEAD_TIME}
    final = found.rounds[-1].baseline
    assert final.rms_over_noise(Use.FIT) < 1.05 < 2.0 < rounds[-1].baseline.rms_over_noise(Use.FIT)
    assert final.fit.values["parasitic_spring.spring_rate"] == pytest.approx(700.0, rel=0.1)


def test_a_single_member_is_compared_in_its_round_only(calibrated):
    first, _, last = rounds_with(calibrated, SPRING, Candidate(EddyDrag))
    alone = take_back([first, last], calibrated.resolution, lambda sentence: None)
    sentences = []
    assert with_rivals_compared(alone, calibrated.resolution, sentences.append) == alone and not sentences


@pytest.mark.parametrize(("left", "goes_on"), [(50.0, True), (0.0, False)])
def test_the_search_goes_on_where_a_curve_was_not_needed(monkeypatch, left, goes_on):
    place = LawPlace("mover_force", "piston_position")
    kind = tabulated_class("parasitic_spring_deviation", place, 2)
    curve = LawDeviation(kind, None, place, 1.0, (0.0, 1.0))
    model, spring, dead_time = object(), SimpleNamespace(candidate=SPRING), SimpleNamespace(candidate=DEAD_TIME)
    forward = [Round(model, (), (spring,), spring, (curve,)), Round(model, (), (), None)]
    reduced = [Round(model, (), (spring,), spring), Round(model, (), (), None)]
    more = [reduced[0], Round(model, (), (dead_time,), dead_time), Round(model, (), (), None)]
    results = {len(forward): TakenBack(reduced, []), len(more): TakenBack(more, [])}
    begun = []
    monkeypatch.setattr(forward_selection, "take_back", lambda rounds, *others: results[len(rounds)])
    monkeypatch.setattr(forward_selection, "_left", lambda rounds: left)
    monkeypatch.setattr(forward_selection, "_select_forward", lambda *values: begun.append(values[4:]) or more)
    search = SimpleNamespace(report=None, workers=None)
    found = forward_selection._take_back_and_go_on(search, forward, None, None, "round")
    assert found.rounds == (more if goes_on else reduced)
    assert begun == ([(reduced[:1], "round_on")] if goes_on else [])
    # with the curve still in the model nothing is searched
    results[len(forward)] = TakenBack(forward, [])
    assert forward_selection._take_back_and_go_on(search, forward, None, None, "round").rounds == forward
