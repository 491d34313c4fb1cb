"""Discrepancy localisation: the share of an unexplained residual that each component accounts for.

A relation that the library lacks resembles a linear combination of effects that act on the same component of the
machine. With E the matrix of all projected signatures of a component (see `screening`), at all points of their grids,
the share is

    share = |P r|²/|r|²,   P the orthogonal projector onto the span of E,

the fraction of χ² of the residual r that the best combination removes. It is a fraction of the chi-square scale.
Signatures are linear, so a fit may achieve less or more than they predict. Unless a trial has explained everything,
the best-scoring candidates of each component are therefore fitted. The share is at least what the best fit achieves;
far from the noise it is reduced by the ratio of achieved to predicted fall of χ².

A combination of lag, delay, gain and offset follows almost any residual of one signal. Sensors therefore count only by
accepted sensor faults, and only by the part of the remaining misfit that lies in the sensor's own signal, since a
faulty sensor does not affect the other signals.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.diagnosis.search.candidates import SENSOR_LOCATION, Candidate
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit
from edhas_jax.diagnosis.search.plausibility import implausible_parameters
from edhas_jax.diagnosis.search.screening import Score, ScoreTest
from edhas_jax.diagnosis.search.trial import Trial
from edhas_jax.measurements.campaign import Use

SHARE_EXPONENT = 3.0  # probability ∝ share³: calibrated on cases whose true effect was withheld from the library
FITS_PER_LOCATION = 2
EXPLAINED_RMS = 1.02  # rms residual over noise of the fitted runs below which a trial explains everything
MIN_RELATIVE_FALL = 0.1  # joint fall of χ² of a component over the largest, below which nothing is fitted


class Localisation(NamedTuple):
    """Where an unexplained residual originates.

    Args:
        shares: fraction of χ² of the calibrated model's residual, 0 … 1, by component, the largest first.
        trials: the candidates that were fitted for it.
    """

    shares: dict[str, float]
    trials: tuple[Trial, ...]


def localise_discrepancy(
    calibrated: EvaluatedFit, candidates: Iterable[Candidate], trials: Sequence[Trial], accepted: Sequence[Trial],
    attempt: Callable[[Score], Trial],
) -> Localisation:  # fmt: skip
    """Determine the share of the residual of the calibrated model that each component accounts for.

    Args:
        calibrated: the model with its uncertain parameters fitted and no candidate added.
        candidates: effects and generic terms to consider.
        trials: trials of the first round, whose baseline is `calibrated`.
        accepted: trials accepted in any round.
        attempt: makes a trial of a scored candidate, with `calibrated` as baseline.
    """
    test = ScoreTest(calibrated.fit, ())
    chi_square = float(test.residual @ test.residual)
    refuted = {t.candidate for t in trials if not t.log_evidence_gain > 0.0}
    by_location: dict[str, list[Candidate]] = {}
    for candidate in candidates:
        if candidate.location != SENSOR_LOCATION and candidate not in refuted:
            by_location.setdefault(candidate.location, []).append(candidate)
    joint = {location: test.joint_scores(members) for location, members in by_location.items()}
    min_fall = MIN_RELATIVE_FALL * max((fall for _, fall in joint.values()), default=0.0)
    unexplained = not any(map(_explains_all, trials))
    shares, new_trials = {}, []
    for location, (scores, fall) in joint.items():
        found = [t for t in trials if t.candidate.location == location]
        if unexplained and fall > min_fall:
            tried = {t.candidate for t in found}
            best_scores = [s for s in scores[:FITS_PER_LOCATION] if s.chi_square_fall > 0.0]
            new = [attempt(score) for score in best_scores if score.candidate not in tried]
            new_trials += new
            found += new
            fall *= 1.0 if calibrated.near_noise else _achieved_share(found)
        shares[location] = max([fall / chi_square, *(_share(t, chi_square) for t in found)])
    accepted_candidates = {t.candidate for t in accepted}
    for trial in trials:
        if trial.candidate in accepted_candidates and trial.candidate.location == SENSOR_LOCATION:
            share = _share(trial, chi_square) * _own_signal_share(trial)
            shares[SENSOR_LOCATION] = max(shares.get(SENSOR_LOCATION, 0.0), share)
    return Localisation(dict(sorted(shares.items(), key=lambda item: -item[1])), tuple(new_trials))


def _share(trial: Trial, chi_square: float) -> float:
    """The log-evidence gain of a trial, doubled to the chi-square scale, as a share of χ²; at most 1."""
    return min(2.0 * trial.log_evidence_gain / chi_square, 1.0)


def _explains_all(trial: Trial) -> bool:
    """Whether a trial ends at the noise with plausible parameters."""
    fitted = trial.evaluated
    if fitted is None or not fitted.rms_over_noise(Use.FIT) < EXPLAINED_RMS:
        return False
    return not implausible_parameters(trial.candidate, fitted.fit)


def _achieved_share(trials: Sequence[Trial]) -> float:
    """The largest gain of some trials, on the chi-square scale, over their largest predicted fall of χ²; 0 … 1."""
    predicted = max((t.score.chi_square_fall for t in trials), default=0.0)
    if not predicted > 0.0:
        return 0.0
    return float(np.clip(2.0 * max(t.log_evidence_gain for t in trials) / predicted, 0.0, 1.0))


def _own_signal_share(trial: Trial) -> float:
    """The share of the excess of χ² over noise that lies in the signal of a faulty sensor; 1 without any excess."""
    excess: dict[str, float] = {}
    for signals in trial.evaluated.fit.residuals.values():
        for name, values in signals.items():
            excess[name] = excess.get(name, 0.0) + float(np.nansum(np.square(values) - 1.0))
    excess = {name: max(value, 0.0) for name, value in excess.items()}
    total = sum(excess.values())
    return excess[trial.candidate.signal] / total if total > 0.0 else 1.0


def location_probabilities(shares: dict[str, float]) -> dict[str, float]:
    """Probability of each component to be the origin of a misfit, proportional to the cube of its share of χ²."""
    weights = {location: share**SHARE_EXPONENT for location, share in shares.items()}
    total = sum(weights.values())
    return {location: weight / total for location, weight in weights.items()} if total > 0.0 else {}
