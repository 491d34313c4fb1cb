"""Rival: the suspects whose signatures are most parallel to the residual of the calibrated model."""

import math

import numpy as np

from studies.hidden_effects.answers import Answer
from studies.hidden_effects.naming import MAX_NAMES, MAX_RANKED, answer_of_names
from studies.hidden_effects.signatures import Signatures, SignatureTable

MIN_DEVIATIONS = 4.5  # least cosine in units of its scatter by chance, 1/√samples; the largest of hundreds reaches 3.5


def correlation(table: SignatureTable) -> Answer:
    """Name the suspects with the largest cosines between projected signature and residual, beyond those of chance."""
    names = [suspect.name for suspect in table.suspects]
    found = np.array([largest_cosine(table, suspect) for suspect in table.suspects])
    order = np.argsort(-found)[:MAX_RANKED]
    least = MIN_DEVIATIONS / math.sqrt(len(table.residual))
    named = tuple(names[k] for k in order[:MAX_NAMES] if found[k] > least)
    return answer_of_names(named, tuple(names[k] for k in order))


def largest_cosine(table: SignatureTable, suspect: Signatures) -> float:
    """The largest cosine between the projected residual and the projected signatures of a suspect; 0 without any."""
    rows, residual = table.projected(suspect), table.projected_residual
    lengths = np.linalg.norm(rows, axis=1) * np.linalg.norm(residual)
    cosines = np.divide(rows @ residual, lengths, out=np.zeros(len(rows)), where=lengths > 0.0)
    return float(cosines.max())
