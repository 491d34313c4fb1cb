"""Decision rules of the search: what is promising, what is confirmed, and when something is left unexplained.

Everything is judged relative to what the model leaves unexplained, its floor. A real bench always leaves something:
small effects that nobody listed, and laws that differ a little from those of the library. A candidate is a finding only
if it removes much more than it leaves.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from edhas_jax.diagnosis.search.answer import log_weight, temperature
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit
from edhas_jax.diagnosis.search.law_deviation import LawDeviation
from edhas_jax.diagnosis.search.trial import Trial

MIN_GAIN = 12.0  # nats: the best of some fifty candidates gains less by chance
PROMISING_RATIO = 0.15  # gain over what is left, from which a candidate stays in the model while others are sought
MIN_SCATTERS = 0.05  # predicted gain over the scatter of fits below which a candidate is not tried
DIFFERING_LAW = 2.0  # gain with its own law deviating over that with the library's law, from which this law is wrong
LAW_ERROR_SHARE = 0.001  # of what a model explains: a law known as a curve over one variable leaves so much anywhere
# of half the number of samples: two fits of a model whose signals depend irregularly on its parameters differ by so
# much of ½χ², because there are many minima and because what is unpredictable is no white noise
IRREGULAR_SCATTER = 0.02
MIN_STRENGTH = 0.7  # of an accepted effect: gain over what is left; below it the effect is removed
# the same where the misfit, over the variance of the noise, is larger than small disturbances leave: what is left
# is then more of the law, or other effects
MIN_FAR_STRENGTH, FAR_MISFIT = 0.4, 3.0
CLEARLY_LESS = 0.5  # a model replaces another one if its misfit is less than this fraction of the other's
EXCESS_SIGMAS = 2.0  # an excess of ½χ² counts beyond this many of its standard deviations under noise alone


def remaining(excess: float, samples: int) -> float:
    """What is left of an excess of ½χ² beyond its scatter under noise alone [nats], at least 0."""
    return max(excess - EXCESS_SIGMAS * math.sqrt(0.5 * samples), 0.0)


def scatter_of_fits(evaluated: EvaluatedFit) -> float:
    """The gain [nats] that another fit of the same model may bring: nothing where the signals depend smoothly on it."""
    return IRREGULAR_SCATTER * 0.5 * evaluated.samples if evaluated.fit.problem.is_irregular else 0.0


def unexplained_floor(excess: float, samples: int, law_error: float = 0.0) -> float:
    """What a gain is compared with [nats]: the excess of ½χ² that is left, and the least gain that counts."""
    return remaining(excess, samples) + MIN_GAIN + law_error


def leaves_clearly_less(model: EvaluatedFit, other: EvaluatedFit) -> bool:
    """Whether one model leaves clearly less misfit than another model."""
    floors = [unexplained_floor(of.excess, of.samples) for of in (model, other)]
    return floors[0] < CLEARLY_LESS * floors[1]


def log_odds(trial: Trial, against: Trial, samples: int) -> float:
    """Logarithm of the odds of the name of a trial against the name of another trial of the same round.

    Args:
        trial: the trial. If its gain is larger than that of the other one, the gains count as equal.
        against: the other trial. The misfit that remains with it sets the scale of the comparison.
        samples: number of samples.
    """
    scale = temperature(against.mean_gain, remaining(against.own_law_excess, samples))
    return log_weight(
        min(trial.mean_gain - against.mean_gain, 0.0), trial.determined_parameters - against.determined_parameters,
        scale, prior_cost=trial.prior_cost - against.prior_cost,
    )  # fmt: skip


def strength(gain: float, excess_after: float, samples: int, law_error: float = 0.0) -> float:
    """The gain of a candidate over what is left with it, in units that are 1 where both are equal.

    Args:
        gain: log-evidence gain [nats].
        excess_after: excess of ½χ² that the model with the candidate leaves.
        samples: number of samples.
        law_error: what laws that are known as curves only, or an imperfect fit, may leave [nats].
    """
    return gain / unexplained_floor(excess_after, samples, law_error)


def least_strength(calibrated: EvaluatedFit) -> float:
    """The least strength that keeps an accepted effect, by the misfit of the calibrated model."""
    return MIN_FAR_STRENGTH if calibrated.excess > FAR_MISFIT * 0.5 * calibrated.samples else MIN_STRENGTH


def is_promising(trial: Trial, samples: int, law_error: float = 0.0) -> bool:
    """Whether a trial stays in the model for the next round; the backward pass decides finally.

    Args:
        trial: the trial.
        samples: number of samples.
        law_error: what laws that are known as curves only, or an imperfect fit, may leave [nats].
    """
    if trial.evaluated is None or not MIN_GAIN <= trial.gain_beyond_laws < math.inf:
        return False
    # the library's law may predict badly what the mechanism with another law would predict well
    law_differs = trial.own_law_gain > DIFFERING_LAW * trial.gain_beyond_laws
    if not trial.left_out_gain > 0.0 and not law_differs:
        return False
    return PROMISING_RATIO < strength(trial.own_law_gain, trial.own_law_excess, samples, law_error) < math.inf


def least_predicted_gain(
    baseline: EvaluatedFit, accepted: Sequence[Candidate], deviations: Sequence[Mapping[str, np.ndarray]] | None,
    law_error: float,
) -> float:  # fmt: skip
    """The predicted gain [nats] from which a candidate is tried.

    With laws as curves little is left, and nearly every candidate follows a part of it: there a prediction must be
    promising itself.

    Args:
        baseline: the model without the candidate.
        accepted: candidates that it has already.
        deviations: columns of the deviations of their laws; None for none.
        law_error: what laws that are known as curves only, or an imperfect fit, may leave [nats].
    """
    if not any(isinstance(candidate, LawDeviation) for candidate in accepted):
        return MIN_SCATTERS * law_error
    return PROMISING_RATIO * unexplained_floor(baseline.excess_with(deviations), baseline.samples, law_error)


def holds_by_library_law(trial: Trial, samples: int) -> bool:
    """Whether a trial is promising with the library's law; if not, it is accepted only if a fit with a curve succeeds.

    The gain with another law is predicted linearly, and may be far more than a fit with that law achieves. A law with
    memory has no curve that could be fitted, so that the prediction has to do.
    """
    return bool(trial.candidate.memory_of) or (
        strength(trial.gain_beyond_laws, trial.remaining_excess, samples) > PROMISING_RATIO
    )
