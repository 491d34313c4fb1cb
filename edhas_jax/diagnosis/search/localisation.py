"""Discrepancy localisation: the share of an unexplained misfit that each component of the machine accounts for.

A relation that the library lacks resembles a linear combination of effects that act on the same component of the
machine. With E the matrix of all projected signatures of a component (see `screening`), at all points of their grids,
the share is

    share = (|P r|² − k)/|r|²,   P the orthogonal projector onto the k directions of the span of E,

the fraction of χ² of the projected residual r that the best combination removes, less the k that noise alone is
expected to contribute. It is at least the share that one free term at the component explains (see `free_curves`,
`memory_term`). Signatures are linear, so a fit may achieve less than they predict: far from the noise the share is
reduced by the ratio of achieved to predicted fall of χ². It is at least what a trial of a candidate there has achieved.

A combination of lag, delay, gain and offset follows almost any residual of one signal. Sensors therefore count only by
trials, and only by the part of the remaining misfit that lies in the sensor's own signal, since a faulty sensor does
not affect the other signals.
"""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from edhas_jax.diagnosis.search.candidates import SENSOR_LOCATION, Candidate
from edhas_jax.diagnosis.search.decision_rules import EXCESS_SIGMAS, scatter_of_fits, strength
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit
from edhas_jax.diagnosis.search.screening import Score, ScoreTest
from edhas_jax.diagnosis.search.trial import Trial

SHARE_EXPONENT = 3.0  # probability ∝ share³
FREE_COST = 20.0  # nats: the best of some fifty free terms gains less by chance
NEAR_EXCESS = 1.0  # excess over half the number of samples below which signatures predict what a fit achieves


def component_shares(
    test: ScoreTest, baseline: EvaluatedFit, candidates: Iterable[Candidate], trials: Sequence[Trial],
    free: Sequence[Score] = (),
) -> dict[str, float]:  # fmt: skip
    """The share of the misfit of a model that each component accounts for, 0 … 1, the largest first.

    Args:
        test: score test of that model.
        baseline: the model.
        candidates: effects to consider.
        trials: trials with that model as baseline.
        free: scores of free terms with that model.
    """
    by_location: dict[str, list[Candidate]] = {}
    for candidate in candidates:
        if candidate.location != SENSOR_LOCATION:
            by_location.setdefault(candidate.location, []).append(candidate)
    falls: dict[str, float] = {}
    for score in free:
        location = score.candidate.location
        falls[location] = max(falls.get(location, 0.0), score.chi_square_fall - len(score.x))
    for location, of in by_location.items():
        _, fall, directions = test.joint_scores(of)
        falls[location] = max(falls.get(location, 0.0), fall - directions)
    # near the noise the excess may be far smaller than what is missing, because noise may lower it
    scatter = EXCESS_SIGMAS * math.sqrt(0.5 * baseline.samples) + scatter_of_fits(baseline)
    excess = max([2.0 * (baseline.excess + scatter), *falls.values(), 1.0])
    far = baseline.excess > NEAR_EXCESS * 0.5 * baseline.samples
    overall = _achieved_share(trials)
    shares = {}
    for location, fall in falls.items():
        found = [t for t in trials if t.candidate.location == location]
        achieved = (_achieved_share(found) if found else overall) if far else 1.0
        of_trials = (_share(t) * min(2.0 * max(baseline.excess, 0.0) / excess, 1.0) for t in found)
        shares[location] = min(max([achieved * fall / excess, *of_trials]), 1.0)
    for trial in trials:
        if trial.candidate.location == SENSOR_LOCATION and trial.evaluated is not None:
            share = _share(trial) * _own_signal_share(trial)
            shares[SENSOR_LOCATION] = max(shares.get(SENSOR_LOCATION, 0.0), share)
    return dict(sorted(shares.items(), key=lambda item: -item[1]))


def free_strength(baseline: EvaluatedFit, free: Sequence[Score], trials: Sequence[Trial]) -> float:
    """The gain of the best free term over what it leaves, 0 or more: whether one cause stands out, without any law.

    Near the noise as predicted, far from it as achieved by a fit.

    Args:
        baseline: the model.
        free: scores of free terms with that model.
        trials: fits of the best of them.
    """
    far = baseline.excess > NEAR_EXCESS * 0.5 * baseline.samples
    gains = [0.0 if far else score.predicted_gain for score in free]
    gains += [baseline.excess - t.evaluated.excess for t in trials if t.evaluated is not None]
    best = max(gains, default=0.0)
    return max(strength(best - FREE_COST, baseline.excess - best, baseline.samples, scatter_of_fits(baseline)), 0.0)


def _share(trial: Trial) -> float:
    """The share of the excess that a trial has removed, 0 … 1."""
    return float(np.clip(trial.explained_share, 0.0, 1.0))


def _achieved_share(trials: Sequence[Trial]) -> float:
    """The largest achieved fall of ½χ² of some trials over their largest predicted one; 0 … 1."""
    predicted = max((t.score.predicted_gain for t in trials), default=0.0)
    if not predicted > 0.0:
        return 1.0
    return float(np.clip(max(t.log_evidence_gain for t in trials) / predicted, 0.0, 1.0))


def _own_signal_share(trial: Trial) -> float:
    """The share of the excess of χ² over noise that lies in the signal of a faulty sensor; 1 without any excess."""
    excess: dict[str, float] = {}
    for run in trial.evaluated.fit.problem.model().runs:
        for name, values in trial.evaluated.residuals[run.name].items():
            excess[name] = excess.get(name, 0.0) + float(np.nansum(np.square(values) - 1.0))
    excess = {name: max(value, 0.0) for name, value in excess.items()}
    total = sum(excess.values())
    return excess[trial.candidate.signal] / total if total > 0.0 else 1.0


def location_probabilities(shares: dict[str, float]) -> dict[str, float]:
    """Probability of each component to be the origin of a misfit, proportional to the cube of its share of χ²."""
    weights = {location: share**SHARE_EXPONENT for location, share in shares.items()}
    total = sum(weights.values())
    return {location: weight / total for location, weight in weights.items()} if total > 0.0 else {}
