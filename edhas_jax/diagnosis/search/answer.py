"""The answer of a diagnosis: probabilities of nothing, of each name and of an unknown cause, and a set of them.

The evidence of a model is only as good as the model: where it leaves a misfit, differences of evidence below a share of
that misfit say nothing. All comparisons are therefore relative to what is left. The constants are those that make the
right answers of 333 development campaigns most probable, whose laws, disturbances and benches judge no later method.
"""

import dataclasses
import math
from collections.abc import Mapping

NOTHING, UNKNOWN = "nothing", "unknown"
FAR_STRONGER = 10.0  # a free term so many times as strong as the members: they imitate one cause with probability ½
SMALL_MISFIT, SMALL_STRENGTH = 0.01, 0.3  # lower limits of misfit and strength before their logarithm is taken
LARGE_MISFIT = 10.0  # more than small disturbances ever leave, so that it says no more
SMALL_LEFT = 12.0  # nats; less is left by chance
SMALL_SHARE = 0.05  # of a signal's rms: more is not left by many small causes
# the member that explains most is named first if its probability is at least this share of the largest: the engineer
# should correct the main cause first, even where a smaller one is a little more certain
NEARLY_AS_PROBABLE = 0.7
FURTHER_REAL = 0.7  # probability to be real from which a member beside the strongest one is named


@dataclasses.dataclass(frozen=True)
class Constants:
    """The constants of the probabilities.

    Args:
        temperature: scale [nats] on which the evidences of rivals are compared,
        temperature_share: what is added to it for each nat that is left,
        gain_share: and for each nat that the accepted candidate gains: real laws differ from those of the library.
        simplicity: probability of a name for each further parameter that the data determine, over one without it.
        real_offset: logit of a member to be real at a strength of 1,
        real_slope: its growth with the logarithm of the strength,
        real_misfit_slope: and, where something is left, with that of the misfit without the member: many small causes,
            one of which may imitate an effect, leave a small one.
        max_real: the largest probability to be real, as an unknown cause may be imitated well.
        max_nothing: the largest probability of nothing, where no candidate is real: what is too small to be seen, or is
            absorbed by the uncertain parameters, leaves no misfit.
        implausible_share: probability that a candidate with an implausible parameter only imitates another cause.
        unknown_offset: logit of one unknown cause against many small ones at a misfit as large as the noise,
        unknown_misfit_slope: its growth with the logarithm of the misfit,
        unknown_free_slope: with the logarithm of the strength of the best free term,
        unknown_place_slope: with the share of the misfit that one component explains, 0 … 1,
        unknown_signal_slope: with the logarithm of the share of a signal that is left, above `SMALL_SHARE`,
        unknown_distortion_slope: and with that of the distance of the calibrated parameters, above 1.
        coverage: probability that the members of a set have together.
    """

    temperature: float = 4.0
    temperature_share: float = 0.1
    gain_share: float = 0.01
    simplicity: float = 0.5
    real_offset: float = 1.0
    real_slope: float = 1.13
    real_misfit_slope: float = 0.52
    max_real: float = 0.97
    max_nothing: float = 0.75
    implausible_share: float = 0.27
    unknown_offset: float = -7.0
    unknown_misfit_slope: float = 0.6
    unknown_free_slope: float = 2.86
    unknown_place_slope: float = 3.65
    unknown_signal_slope: float = 5.17
    unknown_distortion_slope: float = 1.53
    coverage: float = 0.95


CONSTANTS = Constants()


def temperature(gain: float, left: float, constants: Constants = CONSTANTS) -> float:
    """The scale [nats] on which the evidences of rivals are compared, from the gain and from what is left with it."""
    return constants.temperature + constants.temperature_share * left + constants.gain_share * max(gain, 0.0)


def log_weight(
    gain: float, parameters: float, scale: float, constants: Constants = CONSTANTS, prior_cost: float = 0.0
) -> float:
    """The logarithm of the weight of a name.

    Args:
        gain: log-evidence gain [nats].
        parameters: number of parameters that the data determine.
        scale: the `temperature` [nats].
        constants: the constants of the probabilities.
        prior_cost: of implausible values of its parameters [nats]; that a model is wrong makes them no more plausible,
            so that it is not divided by the temperature.
    """
    return gain / scale - prior_cost + parameters * math.log(constants.simplicity)


@dataclasses.dataclass(frozen=True)
class Rivals:
    """An accepted candidate and the others tried in its place.

    Args:
        name: the accepted candidate.
        strength: its gain over what is left.
        gains: log-evidence gain [nats] of every candidate that was tried in its place, by name.
        left: excess of ½χ² that is left with it, beyond the scatter of noise [nats].
        is_implausible: whether the data demand an implausible value of one of its parameters.
        parameters: how many parameters the data determine of each of these candidates, by name; 1 where not stated.
        prior_costs: of their implausible values [nats], by name; 0 where not stated.
    """

    name: str
    strength: float
    gains: Mapping[str, float]
    left: float
    is_implausible: bool = False
    parameters: Mapping[str, float] = dataclasses.field(default_factory=dict)
    prior_costs: Mapping[str, float] = dataclasses.field(default_factory=dict)

    @property
    def left_without(self) -> float:
        """The excess of ½χ² that is left without it [nats]: what it explains, and what is left with it."""
        return max(self.gains[self.name], 0.0) + self.left

    def probability_real(self, misfit: float, constants: Constants = CONSTANTS) -> float:
        """The probability that something is missing that this candidate, or a rival of it, describes.

        Args:
            misfit: of the model without the member, over the number of samples, as in `Evidence`.
            constants: the constants of the probabilities.
        """
        logit = constants.real_offset + constants.real_slope * math.log(max(self.strength, 1e-9))
        share = self.left / (self.left + SMALL_LEFT)
        logit += constants.real_misfit_slope * share * math.log(min(max(misfit, SMALL_MISFIT), LARGE_MISFIT))
        return constants.max_real * _logistic(logit)

    def names(self, constants: Constants = CONSTANTS) -> dict[str, float]:
        """The probability of each name, given that one of them is right."""
        own = self.gains[self.name]
        scale = temperature(own, self.left, constants)
        logs = {
            name: log_weight(
                min(gain - own, 0.0), self.parameters.get(name, 1.0), scale, constants, self.prior_costs.get(name, 0.0)
            )
            for name, gain in self.gains.items()
        }
        largest = max(logs.values())
        weights = {name: math.exp(value - largest) for name, value in logs.items()}
        total = sum(weights.values())
        names = {name: weight / total for name, weight in weights.items()}
        if self.is_implausible:
            names[self.name] *= 1.0 - constants.implausible_share
        return names


@dataclasses.dataclass(frozen=True)
class Evidence:
    """What an answer follows from.

    Args:
        members: the accepted candidates, the most important first.
        misfit: excess of χ² of the calibrated model over the number of samples, beyond the scatter of noise.
        place_share: largest share of this misfit that the laws of one component, or one free term there, explain.
        unexplained: largest share of a signal's rms that the calibrated model leaves beyond the noise.
        free_strength: gain of the best free term, at any place, over what it leaves of the calibrated model's misfit.
        distortion: root mean square distance of the calibrated parameters from their prior means, in prior standard
            deviations; 1 is usual, and more says that they stand in for something else.
    """

    members: tuple[Rivals, ...]
    misfit: float
    place_share: float
    unexplained: float = 0.0
    distortion: float = 1.0
    free_strength: float = 0.0

    def probabilities_real(self, constants: Constants = CONSTANTS) -> list[float]:
        """The probability of each member that something is missing that it, or a rival of it, describes.

        The misfit without a member but with the others is a share of the whole one: that of what it explains and what
        is left.
        """
        largest = max((member.left_without for member in self.members), default=0.0)
        shares = [member.left_without / largest if largest > 0.0 else 1.0 for member in self.members]
        return [
            member.probability_real(share * self.misfit, constants)
            for member, share in zip(self.members, shares, strict=True)
        ]

    def probability_imitation(self) -> float:
        """The probability that the members only imitate one cause, which a single free term explains far better."""
        strongest = max((member.strength for member in self.members), default=0.0)
        if not strongest > 0.0:
            return 0.0
        odds = (self.free_strength / (FAR_STRONGER * strongest)) ** 2
        return odds / (1.0 + odds)

    def probability_unknown(self, constants: Constants = CONSTANTS) -> float:
        """The probability that a misfit without a candidate has one cause, rather than many small ones or none."""
        least = 1.0 - constants.max_nothing
        if self.misfit <= 0.0 and self.free_strength <= 0.0:  # then shares are those of noise
            return least
        logit = constants.unknown_offset + constants.unknown_misfit_slope * math.log(max(self.misfit, SMALL_MISFIT))
        logit += constants.unknown_free_slope * math.log(max(self.free_strength, SMALL_STRENGTH))
        logit += constants.unknown_place_slope * self.place_share
        logit += constants.unknown_signal_slope * math.log(max(self.unexplained, SMALL_SHARE) / SMALL_SHARE)
        logit += constants.unknown_distortion_slope * math.log(max(self.distortion, 1.0))
        return max(_logistic(logit), least)


@dataclasses.dataclass(frozen=True)
class Answer:
    """What a diagnosis says is missing.

    Args:
        probabilities: of each name, of `NOTHING` and of `UNKNOWN`, the largest first; for several missing effects the
            probability of each to be among them, so that they may sum to more than 1.
        members: the set that holds the truth with a probability of `Constants.coverage`: the first names first.
        first: the most probable of all; of names that are nearly as probable, that of the candidate that explains most.
    """

    probabilities: dict[str, float]
    members: tuple[str, ...]
    first: str


def answer_from(evidence: Evidence, constants: Constants = CONSTANTS) -> Answer:
    """The answer that follows from the evidence."""
    found: dict[str, float] = {}
    reals = evidence.probabilities_real(constants)
    imitates = evidence.probability_imitation()
    names = [{n: p * (1.0 - imitates) for n, p in member.names(constants).items()} for member in evidence.members]
    for real, of in zip(reals, names, strict=True):
        for name, p in of.items():
            found[name] = max(found.get(name, 0.0), real * p)
    # without any real member the misfit has one cause that no name describes, or many small ones
    none_real, unknown = 1.0 - max(reals, default=0.0), evidence.probability_unknown(constants)
    imitated = max((real * (1.0 - sum(of.values())) for real, of in zip(reals, names, strict=True)), default=0.0)
    found |= {NOTHING: none_real * (1.0 - unknown), UNKNOWN: none_real * unknown + imitated}
    found = dict(sorted(found.items(), key=lambda item: -item[1]))
    others = {NOTHING: found[NOTHING], UNKNOWN: found[UNKNOWN]}
    strongest = max(range(len(reals)), key=reals.__getitem__, default=None)
    chosen = _covering(others, constants.coverage) if strongest is None else set()
    for k, (real, of) in enumerate(zip(reals, names, strict=True)):
        if k != strongest and real < FURTHER_REAL:
            continue
        outcomes = {name: real * p for name, p in of.items()}
        # that a further member is not real adds no name
        outcomes |= others if k == strongest else {"": 1.0 - sum(outcomes.values())}
        chosen |= _covering(outcomes, constants.coverage)
    return Answer(found, tuple(name for name in found if name in chosen), _first(evidence, found))


def _first(evidence: Evidence, found: Mapping[str, float]) -> str:
    """The first answer; see `Answer`."""
    first, largest = next(iter(found.items()))  # the most probable
    if first in (NOTHING, UNKNOWN):
        return first
    nearly = (member.name for member in evidence.members if found[member.name] >= NEARLY_AS_PROBABLE * largest)
    return next(nearly, first)


def _covering(outcomes: Mapping[str, float], coverage: float) -> set[str]:
    """The fewest outcomes that have a probability of `coverage` together, without the one that has no name."""
    chosen, covered = set(), 0.0
    for name, p in sorted(outcomes.items(), key=lambda item: -item[1]):
        if covered >= coverage:
            break
        chosen.add(name)
        covered += p
    return chosen - {""}


def _logistic(x: float) -> float:
    return 1.0 / (1.0 + math.exp(-x)) if x > -700.0 else 0.0
