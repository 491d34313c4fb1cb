"""Are stated probabilities right? The reliability of first answers and its expected calibration error."""

import dataclasses
import math
from collections.abc import Iterable

import numpy as np

from studies.hidden_effects.rates import Answered, Rate, first_is_right

BINS = 10  # of equal width
DRAWS = 2000  # of right and wrong, for the error that chance alone gives


@dataclasses.dataclass(frozen=True)
class Bin:
    """The answers whose probability lies between two limits: the mean of it, and how many of them are right."""

    low: float
    high: float
    mean_probability: float
    right: Rate


@dataclasses.dataclass(frozen=True)
class Reliability:
    """How often first answers are right, over the probability that the method states for them.

    Args:
        bins: the bins that have answers, by growing probability.
        error: expected calibration error, the mean over all answers of |share right − mean probability| of their bin.
        by_chance: the mean of this error for answers that are right with exactly the stated probabilities.
    """

    bins: tuple[Bin, ...]
    error: float
    by_chance: float

    @property
    def count(self) -> int:
        """The number of answers with a probability."""
        return sum(b.right.of for b in self.bins)


def reliability(cases: Iterable[Answered], bins: int = BINS) -> Reliability:
    """The reliability of the first answers that have a probability.

    Source of the error: Naeini, Cooper, Hauskrecht (2015), Obtaining well calibrated probabilities using Bayesian
    binning, with bins of equal width.
    """
    found = [(a.probability, first_is_right(t, a)) for t, a, *_ in cases if a.probability is not None]
    if not found:
        return Reliability((), math.nan, math.nan)
    p, right = np.array(found, float).T
    which = np.minimum((p * bins).astype(int), bins - 1)
    members = [np.flatnonzero(which == k) for k in range(bins)]
    rows = tuple(
        Bin(k / bins, (k + 1) / bins, float(p[m].mean()), Rate(int(right[m].sum()), len(m)))
        for k, m in enumerate(members)
        if len(m)
    )
    draws = np.random.default_rng(0).random((DRAWS, len(p))) < p
    chance = sum(np.abs((draws[:, m] - p[m]).sum(axis=1)) for m in members)
    error = sum(abs(float((right[m] - p[m]).sum())) for m in members)
    return Reliability(rows, error / len(p), float(chance.mean()) / len(p))
