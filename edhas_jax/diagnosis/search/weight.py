"""The weight of a set of effects, from its misfit.

The weight of a set is its prior times a Student distribution of its misfit X (`FlooredModel.misfit`) with α freedoms,
and one with 2 β of them as wide as the noise of all n samples,

    ln w = Σ ln prior odds − (α/2) ln(1 + 2 (X − X₀)/α) − β ln(1 + 2 (X − X₀)/n)

with X₀ the misfit of the best set where that is at the noise, and else what the noise alone would leave; less what the
error of its laws may leave anywhere, and a few nats at least, which the error of any model of a bench may leave. Laws
err elsewhere by as much as they do over their own variables, and by a share of what the best set explains at most. Near
the noise (X − X₀ ≪ α) that is the usual evidence. Far above it only the ratio of misfits counts, because the error of a
model is a few smooth functions, not one error for each sample: half the misfit is worth (α/2) ln 2, and β ln 2 more
where it is larger than the noise: the small effects that no list has seldom leave that much.

Source: Student distribution in place of a normal one for model error: Miller and Dunson, J. Am. Stat. Assoc. 114 (2019)
1113 (coarsened posterior).
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Protocol

from edhas_jax.diagnosis.candidates.candidate import Candidate, FreeTerm
from edhas_jax.inference.fit.evaluated_fit import noise_level


@dataclasses.dataclass(frozen=True)
class WeightConstants:
    """The six numbers of the weight.

    Args:
        freedoms: α: number of independent numbers in the error of a model, about.
        beyond_noise: β: what a factor e on the misfit costs above the noise [nats], in addition to α/2.
        expected: named effects that a campaign hides on average, over all candidates together.
        unknown_odds: odds that it hides one that no list has, over all places together.
        law_error: largest share of what a set explains: 12 % of its amplitude.
        least_error: error of a model with the right effects [nats], because settings, sensors and clocks deviate in
            more ways.
    """

    freedoms: float = 12.0
    beyond_noise: float = 6.0
    expected: float = 1.0
    unknown_odds: float = 0.3
    law_error: float = 0.015
    least_error: float = 20.0


WEIGHT = WeightConstants()
"""The numbers that a diagnosis uses."""


class Weighable(Protocol):
    """A fitted set: its members, misfit, cost of its numbers, and what deviations of its laws explain [nats]."""

    members: Sequence[Candidate]
    misfit: float
    numbers: float
    fall_by_laws: float


class Weighing:
    """The weights of the sets of one campaign.

    Args:
        named: number of effects and sensor faults that could be missing.
        free: number of free terms.
        samples: number of whitened samples of the fitted runs.
        constants: the numbers of the weight.

    Attributes:
        noise: the most ½χ² that noise alone leaves [nats].
    """

    def __init__(self, named: int, free: int, samples: int, constants: WeightConstants = WEIGHT):
        self.named, self.free, self.samples, self.constants = named, free, samples, constants
        self._log_named = math.log(constants.expected / max(named, 1))
        self._log_free = math.log(constants.unknown_odds / max(free, 1))
        self._least_numbers = self._least_misfit = self._of_nothing = math.inf
        self._most_evidence, self._fall_by_laws = -math.inf, math.inf
        self.noise = noise_level(samples)

    def note(self, of: Weighable) -> None:
        """Take account of a fitted set."""
        self._least_numbers = min(self._least_numbers, of.numbers)
        self._least_misfit = min(self._least_misfit, of.misfit)
        evidence = self._log_prior(*counts(of.members)) - of.misfit
        if evidence > self._most_evidence:
            self._most_evidence, self._fall_by_laws = evidence, of.fall_by_laws
        if not of.members:
            self._of_nothing = min(self._of_nothing, of.misfit)

    @property
    def _least(self) -> float:
        """X₀ of the module."""
        least = min(self.noise + self._least_numbers, self._least_misfit)
        of_laws = min(self.constants.law_error * (self._of_nothing - least), self._fall_by_laws)
        return least - max(of_laws, self.constants.least_error)

    def of(self, fitted: Weighable) -> float:
        """The logarithm of the weight of a fitted set [nats]."""
        return self.at(fitted.misfit, *counts(fitted.members))

    def at(self, misfit: float, named: int, free: int) -> float:
        """The same from the misfit [nats] of a set and its numbers of named members and of free terms."""
        return self.log_likelihood(misfit) + self._log_prior(named, free)

    def _log_prior(self, named: int, free: int) -> float:
        return named * self._log_named + free * self._log_free

    def log_likelihood(self, misfit: float) -> float:
        """The logarithm of the weight of a misfit [nats] without the prior."""
        return log_likelihood(misfit - self._least, self.samples, self.constants)

    def gain(self, key: frozenset[str], misfits: Mapping[frozenset[str], float]) -> float:
        """The rise of the log likelihood [nats] by that member of a set that adds least, from the set without it.

        Args:
            key: the names of the set.
            misfits: the misfit of each fitted set [nats], by its names.

        Returns:
            Infinite where no set without one of its members was fitted.
        """
        without = [misfits[key - {name}] for name in key if key - {name} in misfits]
        own = self.log_likelihood(misfits[key])
        return min((own - self.log_likelihood(less) for less in without), default=math.inf)


def counts(members: Sequence[Candidate]) -> tuple[int, int]:
    """The numbers of named members and of free terms."""
    free = sum(isinstance(c, FreeTerm) for c in members)
    return len(members) - free, free


def log_likelihood(misfit: float, samples: int, constants: WeightConstants = WEIGHT) -> float:
    """The logarithm of the weight of a misfit [nats] without the prior; see the module."""
    if misfit < 0.0:
        return -misfit
    half = 0.5 * constants.freedoms
    return -half * math.log1p(misfit / half) - constants.beyond_noise * math.log1p(2.0 * misfit / samples)
