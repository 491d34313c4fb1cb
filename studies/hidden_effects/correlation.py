"""Rival: the suspects whose signatures are most parallel to the residual of the calibrated model."""

import numpy as np

from studies.hidden_effects.answers import Answer, Verdict, places_of
from studies.hidden_effects.calibrated_case import ScreenedCandidate

MIN_COSINE = 0.02  # cosine between signature and residual below which a suspect is not named; chance gives 0.015
MAX_NAMES, MAX_RANKED = 3, 10


def correlation(residual: np.ndarray, candidates: list[ScreenedCandidate]) -> Answer:
    """Name the suspects with the largest cosines between signature and residual, above `MIN_COSINE`.

    Args:
        residual: the projected residual (m,).
        candidates: the suspects with their projected signatures.
    """
    length = float(np.linalg.norm(residual))
    cosines = [float(np.max(c.signatures @ residual / np.linalg.norm(c.signatures, axis=1))) for c in candidates]
    order = np.argsort(-np.array(cosines))[:MAX_RANKED]
    named = tuple(candidates[k].name for k in order[:MAX_NAMES] if cosines[k] > MIN_COSINE * length)
    return answer_of_names(named, tuple(candidates[k].name for k in order))


def answer_of_names(named: tuple[str, ...], ranked: tuple[str, ...]) -> Answer:
    """The answer of a method that gives names and nothing else: its place is that of the first name."""
    verdict = Verdict.MISSING_EFFECT if named else Verdict.ADEQUATE
    return Answer(verdict, named, place=next(iter(places_of(named[0])), None) if named else None, ranked=ranked)
