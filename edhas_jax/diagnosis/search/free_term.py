"""A free term as a candidate: something at a place of the machine whose numbers are free and that follows no law."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.screening import Score, ScoreTest
from edhas_jax.machine.effects.tabulated_law import LawPlace

USUAL_COORDINATE = 1.5  # prior standard deviations


@dataclasses.dataclass(frozen=True)
class FreeTerm(Candidate):
    """A term that is linear in its numbers; values in SI.

    Args:
        place: slot, variable and factors.
        spread: prior standard deviation of each number.
    """

    place: LawPlace = LawPlace("", "")
    spread: float = 1.0

    @property
    def text(self) -> str:
        """Where the term acts and on what it depends, in words."""
        raise NotImplementedError

    @property
    def title(self) -> str:
        """See `Candidate.title`."""
        return self.text


def score_free_term(test: ScoreTest, term: FreeTerm, slopes: Sequence[Mapping[str, np.ndarray]]) -> Score:
    """The score test of a free term, with a prior as wide as the data demand.

    Args:
        test: the score test of a model.
        term: the term.
        slopes: by fitted run and signal (samples, k), the derivatives with respect to its k numbers, SI.
    """
    score = _score(test, term, slopes)
    size = float(np.abs(score.x).max(initial=0.0))
    if size > USUAL_COORDINATE:
        score = _score(test, dataclasses.replace(term, spread=size / USUAL_COORDINATE * term.spread), slopes)
    return score


def _score(test: ScoreTest, term: FreeTerm, slopes: Sequence[Mapping[str, np.ndarray]]) -> Score:
    return test.score_columns(term, [{n: term.spread * values for n, values in run.items()} for run in slopes])
