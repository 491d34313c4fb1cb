"""The posterior over sets of causes of one campaign, and what it says of each cause."""

import dataclasses
import functools
import math
from collections.abc import Sequence

from edhas_jax.diagnosis.candidates.candidate import Candidate, FreeTerm
from edhas_jax.diagnosis.search.set_search import FittedSet
from edhas_jax.inference.fit.evaluated_fit import MUCH_LEFT

NOTHING, UNKNOWN = "nothing", "unknown"
COVERAGE = 0.95  # probability that a member of the set of names is right, if a right set was fitted
NOT_FITTED = 0.1  # probability that the search has fitted no right set: so in 6 of 53 development campaigns
LEAST_GAIN = 1.0  # nats of log likelihood; an effect that adds less explains nothing, and is no other answer
CONFOUNDED_ODDS = 20.0  # ratio of probabilities below which two sets are not told apart


@dataclasses.dataclass(frozen=True)
class SetPosterior:
    """Sets of causes with their probabilities.

    Args:
        sets: the fitted sets, the most probable first.
    """

    sets: tuple[FittedSet, ...]

    @property
    def best(self) -> FittedSet:
        """The most probable set."""
        return self.sets[0]

    @functools.cached_property
    def weights(self) -> tuple[float, ...]:
        """The probability of each set, see `set_probabilities`."""
        return set_probabilities([of.log_weight for of in self.sets], [of.gain for of in self.sets])

    @functools.cached_property
    def _answers(self) -> list[tuple[tuple[str, ...], float]]:
        """What each set answers, with its probability.

        Where the empty set leaves much, no free term explains it: the cause is as likely in the records.
        """
        found = []
        for of, weight in zip(self.sets, self.weights, strict=True):
            every = (labels(of),) if of.members or labels(of) == (NOTHING,) else ((UNKNOWN,), (NOTHING,))
            found += [(names, weight / len(every)) for names in every]
        return found

    @functools.cached_property
    def probabilities(self) -> dict[str, float]:
        """The probability of each name to be in the set, of an unknown cause, and of nothing; the largest first."""
        found: dict[str, float] = {UNKNOWN: 0.0, NOTHING: 0.0}
        for names, weight in self._answers:
            for name in names:
                found[name] = found.get(name, 0.0) + weight
        return dict(sorted(found.items(), key=lambda item: -item[1]))

    @functools.cached_property
    def members(self) -> tuple[tuple[Candidate, float], ...]:
        """The members of the most probable set, each with its fall of the misfit [nats], the largest first."""
        fitted, best = {of.key: of for of in self.sets}, self.sets[0]
        without = {c: fitted.get(best.key - {c.name}) for c in best.members}
        falls = {c: math.inf if of is None else of.misfit - best.misfit for c, of in without.items()}
        return tuple(sorted(falls.items(), key=lambda item: -item[1]))

    @functools.cached_property
    def credible(self) -> tuple[str, ...]:
        """The fewest names of which one at least is right with a probability of `COVERAGE`; taken one by one."""
        left, chosen = self._answers, []
        while sum(weight for _, weight in left) > (1.0 - COVERAGE) * (1.0 - NOT_FITTED):
            gains: dict[str, float] = {}
            for names, weight in left:
                for name in names:
                    gains[name] = gains.get(name, 0.0) + weight
            chosen.append(max(gains, key=gains.__getitem__))
            left = [(names, weight) for names, weight in left if chosen[-1] not in names]
        return tuple(chosen)

    @property
    def near(self) -> tuple[FittedSet, ...]:
        """The sets that the measurements do not tell from the best one, this one first."""
        least = self.weights[0] / CONFOUNDED_ODDS
        return tuple(of for of, weight in zip(self.sets, self.weights, strict=True) if weight > least)

    def alternatives(self, candidate: Candidate) -> tuple[Candidate, ...]:
        """The candidates that can take the place of a member of the best set, the most probable first."""
        others = self.best.key - {candidate.name}
        exchanged = [of for of in self.near if len(of.key) == len(self.best.key) and others < of.key]
        found = [c for of in exchanged for c in of.members if c.name not in self.best.key]
        return tuple(c for c in found if not isinstance(c, FreeTerm))

    def best_with(self, candidate: Candidate) -> FittedSet:
        """The most probable set that holds a candidate."""
        return next(of for of in self.sets if candidate.name in of.key)

    def evidence(self, candidate: Candidate) -> float:
        """The log weight [nats] of the best set with a candidate, less that of the best set without it or a free term.

        A free term may be the law of the candidate.
        """
        others = (of for of in self.sets if not any(isinstance(c, FreeTerm) for c in of.members))
        without = next((of.log_weight for of in others if candidate.name not in of.key), -math.inf)
        return self.best_with(candidate).log_weight - without

    def candidates(self) -> list[tuple[Candidate, float]]:
        """The effects and sensor faults of all fitted sets with their probabilities, the most probable first."""
        found = {c.name: c for of in self.sets for c in of.members if not isinstance(c, FreeTerm)}
        return sorted(((c, self.probabilities[n]) for n, c in found.items()), key=lambda item: -item[1])

    def locations(self) -> dict[str, float]:
        """The probability that something is missing in a component of the machine, the largest first.

        Of equal ones that of the member of the best set that explains more is first.
        """
        found = {candidate.location: 0.0 for candidate, _ in self.members}
        for of, weight in zip(self.sets, self.weights, strict=True):
            for place in {c.location for c in of.members}:
                found[place] = found.get(place, 0.0) + weight
        return dict(sorted(found.items(), key=lambda item: -item[1]))


def set_probabilities(log_weights: Sequence[float], gains: Sequence[float]) -> tuple[float, ...]:
    """The probability of each of some sets; together 1 − `NOT_FITTED`.

    Args:
        log_weights: their log weights [nats].
        gains: see `FittedSet.gain`; a set of less than `LEAST_GAIN` has no probability, unless it is the best one.
    """
    best = max(range(len(log_weights)), key=log_weights.__getitem__)
    counts = [k == best or gain >= LEAST_GAIN for k, gain in enumerate(gains)]
    weights = [counted * math.exp(log - log_weights[best]) for counted, log in zip(counts, log_weights, strict=True)]
    return tuple((1.0 - NOT_FITTED) * weight / sum(weights) for weight in weights)


def labels(of: FittedSet) -> tuple[str, ...]:
    """The names of the effects and faults of a set, and `UNKNOWN` for a free term.

    `NOTHING` for the empty set; `UNKNOWN` where that leaves more than `MUCH_LEFT` times the noise.
    """
    leaves_much = of.excess > 0.5 * (MUCH_LEFT**2 - 1.0) * of.samples
    of_empty = UNKNOWN if leaves_much else NOTHING
    return tuple(UNKNOWN if isinstance(c, FreeTerm) else c.name for c in of.members) or (of_empty,)
