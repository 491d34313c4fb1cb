"""Decision rules of the diagnosis: acceptance of a candidate, significance of a residual, and the verdict.

Each function states the scale on which it decides: chi-square, log-evidence gain [nats], or rms residual over noise.
"""

import math
from collections.abc import Sequence

import numpy as np

from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit
from edhas_jax.diagnosis.search.plausibility import implausible_parameters
from edhas_jax.diagnosis.search.result import Round, Verdict, accepted_trials
from edhas_jax.diagnosis.search.trial import Trial
from edhas_jax.measurements.campaign import Use

# acceptance: log-evidence gain [nats], and standard deviations by which ½χ² of the held-out runs must fall
MIN_GAIN, HOLDOUT_SIGMAS = 12.0, 2.0
# above this gain one standard deviation suffices, because held-out runs may be short and uninformative
OVERWHELMING_GAIN, HOLDOUT_SIGMAS_OVERWHELMING = 40.0, 1.0
REPLACEMENT_MARGIN = 30.0  # nats by which one candidate must exceed the accepted effects to replace them
EXPLAINED_HOLDOUT_RMS = 1.02  # rms residual over noise of held-out runs above which something is unexplained
CHI_SQUARE_SIGMAS, RMS_SIGMAS = 3.0, 3.0  # tolerated scatter of χ² and of an rms under noise alone


def is_confirmed(baseline: EvaluatedFit, trial: Trial) -> bool:
    """Whether a trial is accepted: sufficient log-evidence gain [nats], and a significant fall on held-out runs.

    Args:
        baseline: the model without the candidate.
        trial: the trial; its gain must reach 12 nats. ½χ² of the held-out runs must fall by two standard deviations,
            by one where the gain exceeds 40 nats.
    """
    if trial.evaluated is None or trial.log_evidence_gain < MIN_GAIN:
        return False
    falls = baseline.holdout_half_chi_square() - trial.evaluated.holdout_half_chi_square()
    # if the better model is true, the fall of ½χ² has a variance of twice its expectation
    sigmas = HOLDOUT_SIGMAS_OVERWHELMING if trial.log_evidence_gain > OVERWHELMING_GAIN else HOLDOUT_SIGMAS
    return float(falls.sum()) > sigmas * math.sqrt(2.0 * max(float(np.abs(falls).sum()), 1.0))


def replaces_accepted(rounds: Sequence[Round], trial: Trial) -> bool:
    """Whether one candidate alone explains clearly more (log-evidence gain) than all accepted ones together."""
    total = sum(t.log_evidence_gain for t in accepted_trials(rounds))
    return is_confirmed(rounds[0].baseline, trial) and trial.log_evidence_gain > REPLACEMENT_MARGIN + total


def is_unexplained(evaluated: EvaluatedFit) -> bool:
    """Whether the rms residual of the held-out runs (of the fitted ones without any) exceeds the noise."""
    campaign = evaluated.fit.problem.campaign
    use = Use.HOLDOUT if campaign.runs_for(Use.HOLDOUT) else Use.FIT
    samples = sum(int(np.isfinite(v).sum()) for v in evaluated.run_residuals(campaign.runs_for(use)))
    # an rms over n samples of noise has a standard deviation of 1/√(2n)
    limit = max(EXPLAINED_HOLDOUT_RMS, 1.0 + RMS_SIGMAS / math.sqrt(2.0 * max(samples, 1)))
    return evaluated.rms_over_noise(use) > limit


def chi_square_excess(evaluated: EvaluatedFit) -> float:
    """The excess of χ² of the fitted runs over its expectation under noise and three standard deviations of it."""
    samples = sum(np.isfinite(v).sum() for signals in evaluated.fit.residuals.values() for v in signals.values())
    return 2.0 * evaluated.cost - float(samples) - CHI_SQUARE_SIGMAS * math.sqrt(2.0 * float(samples))


def decide_verdict(rounds: Sequence[Round]) -> Verdict:
    """Decide the verdict.

    The effect is unknown where a generic term explains clearly more than the library, an accepted candidate depends on
    a parameter at its prior bound, or the final residual exceeds the noise. Otherwise the model is adequate if the
    first round accepted nothing, and ambiguous if an accepted candidate is confounded with another one.

    Args:
        rounds: all rounds of the search, the last of which accepted nothing.
    """
    after = rounds[-1].baseline
    implausible = any(implausible_parameters(t.candidate, after.fit) for t in accepted_trials(rounds))
    if rounds[-1].generic_trials or implausible or is_unexplained(after):
        return Verdict.UNKNOWN_EFFECT
    if rounds[0].accepted is None:
        return Verdict.ADEQUATE
    ambiguous = any(len(r.confounded_candidates()) > 1 for r in rounds)
    return Verdict.AMBIGUOUS if ambiguous else Verdict.MISSING_EFFECT
