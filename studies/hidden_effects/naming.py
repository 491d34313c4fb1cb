"""How the rival methods turn names into an answer."""

import dataclasses

import numpy as np

from studies.hidden_effects.answers import UNKNOWN, Answer, Verdict, places_of

MAX_NAMES, MAX_RANKED = 3, 10
SET_PROBABILITY = 0.95
# an answer with names holds where they explain this share of the χ² above the noise, or leave little
MIN_EXPLAINED_SHARE, LITTLE_OVER_NOISE = 0.5, 1.2


def answer_of_names(named: tuple[str, ...], ranked: tuple[str, ...]) -> Answer:
    """The answer of a method that gives names: its place is that of the first one."""
    verdict = Verdict.MISSING_EFFECT if named else Verdict.ADEQUATE
    return Answer(verdict, named, place=next(iter(places_of(named[0])), None) if named else None, ranked=ranked)


def unknown_where_unexplained(answer: Answer, before: np.ndarray, after: np.ndarray) -> Answer:
    """The answer, or `unknown_effect` at its place where its names leave most of the misfit.

    Args:
        answer: an answer with or without names.
        before: residual over noise (m,) of the calibrated model.
        after: the same with what is named.
    """
    left = float(np.mean(np.square(after))) - 1.0
    if left < LITTLE_OVER_NOISE**2 - 1.0 or left < (1.0 - MIN_EXPLAINED_SHARE) * (
        float(np.mean(np.square(before))) - 1.0
    ):
        return answer
    place = answer.place or next((p for name in answer.ranked for p in places_of(name)), None)
    return dataclasses.replace(
        answer, verdict=Verdict.UNKNOWN_EFFECT, named=(), place=place, answer_set=(UNKNOWN,), probability=None
    )


def credible_set(probabilities: dict[str, float], share: float = SET_PROBABILITY) -> tuple[str, ...]:
    """The fewest names whose probabilities sum to a share, the most probable first."""
    members: list[str] = []
    total = 0.0
    for name, p in sorted(probabilities.items(), key=lambda item: -item[1]):
        if total >= share:
            break
        members.append(name)
        total += p
    return tuple(members)
