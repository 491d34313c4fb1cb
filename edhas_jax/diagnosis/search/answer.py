"""The answer of a diagnosis: probabilities of nothing, of each name and of an unknown cause, and a set of them.

The evidence of a model is only as good as the model: where it leaves a misfit, differences of evidence below a share of
that misfit say nothing. All comparisons are therefore relative to what is left. The constants were chosen by hand on
about fifty campaigns of the tuning families of `studies.hidden_effects`, whose laws and disturbances judge nothing.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

NOTHING, UNKNOWN = "nothing", "unknown"
COVERAGE = 0.95  # probability that the set holds the truth
TEMPERATURE, TEMPERATURE_SHARE = 4.0, 0.1  # nats, and of what is left: scale on which evidences are compared
# logit of a member to be real, over the logarithm of its strength; the largest probability, as others may imitate it
REAL_OFFSET, REAL_SLOPE, MAX_REAL = -1.2, 3.0, 0.96
IMPLAUSIBLE_SHARE = 0.4  # probability that a candidate which needs an implausible parameter only imitates another cause
# logit of one unknown cause against many small ones: over the logarithm of the misfit, its reference, over the share of
# the misfit that one component explains, and the share at which both are equally probable
UNKNOWN_SLOPE, UNKNOWN_MISFIT, UNKNOWN_PLACE_SLOPE, UNKNOWN_PLACE = 0.5, 0.3, 12.0, 0.62


@dataclasses.dataclass(frozen=True)
class Rivals:
    """An accepted candidate and the others tried in its place.

    Args:
        name: the accepted candidate.
        strength: its gain over what is left.
        gains: log-evidence gain [nats] of every candidate that was tried in its place, by name.
        left: excess of ½χ² that is left with it, beyond the scatter of noise [nats].
        is_implausible: whether the data demand an implausible value of one of its parameters.
    """

    name: str
    strength: float
    gains: Mapping[str, float]
    left: float
    is_implausible: bool = False

    def probability_real(self) -> float:
        """The probability that something is missing that this candidate, or a rival of it, describes."""
        return MAX_REAL * _logistic(REAL_OFFSET + REAL_SLOPE * math.log(max(self.strength, 1e-9)))

    def names(self) -> dict[str, float]:
        """The probability of each name, given that one of them is right."""
        scale = TEMPERATURE + TEMPERATURE_SHARE * self.left
        own = self.gains[self.name]
        weights = {name: math.exp(min(gain - own, 0.0) / scale) for name, gain in self.gains.items()}
        total = sum(weights.values())
        names = {name: weight / total for name, weight in weights.items()}
        if self.is_implausible:
            names[self.name] *= 1.0 - IMPLAUSIBLE_SHARE
        return names


@dataclasses.dataclass(frozen=True)
class Answer:
    """What a diagnosis says is missing.

    Args:
        probabilities: of each name, of `NOTHING` and of `UNKNOWN`, the largest first; for several missing effects the
            probability of each to be among them, so that they may sum to more than 1.
        members: the set that holds the truth with a probability of `COVERAGE`: the first names first.
    """

    probabilities: dict[str, float]
    members: tuple[str, ...]

    @property
    def first(self) -> str:
        """The most probable member."""
        return next(iter(self.probabilities))


def unknown_probability(left: float, samples: int, place_share: float) -> float:
    """The probability that a misfit without a candidate has one cause, rather than many small ones.

    Args:
        left: excess of ½χ² beyond the scatter of noise [nats].
        samples: number of samples.
        place_share: largest share of the misfit that the laws of one component explain together, 0 … 1.
    """
    relative = 2.0 * left / max(samples, 1)
    if relative <= 0.0:
        return 0.0
    misfit = UNKNOWN_SLOPE * math.log(relative / UNKNOWN_MISFIT)
    return _logistic(misfit + UNKNOWN_PLACE_SLOPE * (place_share - UNKNOWN_PLACE))


def combine(members: Sequence[Rivals], unknown: float) -> Answer:
    """The answer from the accepted candidates and the probability of an unknown cause of what they leave.

    Args:
        members: the accepted candidates, the most important first.
        unknown: probability that a misfit without an accepted candidate has one cause.
    """
    found: dict[str, float] = {}
    for member in members:
        real = member.probability_real()
        for name, p in member.names().items():
            found[name] = max(found.get(name, 0.0), real * p)
    # without any real member the misfit has one cause that no name describes, or many small ones
    none_real = 1.0 - max((member.probability_real() for member in members), default=0.0)
    imitated = max((m.probability_real() * (1.0 - sum(m.names().values())) for m in members), default=0.0)
    found |= {NOTHING: none_real * (1.0 - unknown), UNKNOWN: none_real * unknown + imitated}
    found = dict(sorted(found.items(), key=lambda item: -item[1]))
    chosen, covered = [], 0.0
    target = COVERAGE * max(len(members), 1)
    for name, p in found.items():
        if covered >= target and len(chosen) >= len(members):
            break
        chosen.append(name)
        covered += p
    return Answer(found, tuple(chosen))


def _logistic(x: float) -> float:
    return 1.0 / (1.0 + math.exp(-x)) if x > -700.0 else 0.0
