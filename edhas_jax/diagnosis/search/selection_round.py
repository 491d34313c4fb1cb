"""One round of the search: score all candidates, try the best, and find the one that explains most."""

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from edhas_jax.diagnosis.search.answer import log_weight, temperature
from edhas_jax.diagnosis.search.calibrated_model import misfit
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.decision_rules import MIN_GAIN, is_promising, remaining
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit, fit_coarse, with_solver_error
from edhas_jax.diagnosis.search.law_deviation import deviation_cost, law_deviation_columns
from edhas_jax.diagnosis.search.result import Round
from edhas_jax.diagnosis.search.screening import Score, ScoreTest
from edhas_jax.diagnosis.search.trial import (
    MAX_TRIALS,
    NEAR_EXCESS,
    NEARLY_ALL_SHARE,
    Trial,
    is_distorted,
    retry_progressively,
    try_best_candidates,
)
from edhas_jax.diagnosis.workers import Workers
from edhas_jax.measurements.time_resolution import TimeResolution

# candidates whose signatures are simulated again in later rounds: how many, and from which fall of χ² on
REFRESHED, MIN_REFRESHED_FALL = 8, 10.0
PROGRESSIVE_TRIALS = 8  # candidates that are fitted progressively where none explains nearly all
REFINED, REFINEMENT_STEPS = 2, 6  # trials that are refined where they end near the noise, and the steps of the fit
MIN_LAW_ERRORS = 0.05  # predicted gain over the error of laws below which a candidate is not tried
OWN_LAWS = 2  # trials whose own law may deviate
PROGRESSIVE_RMS = 3.0  # residual over noise below which a fit is not caught in a distant minimum
FAR_TRIALS = 8  # largest number of trials above it


def search_round(
    baseline: EvaluatedFit, accepted: Sequence[Candidate], candidates: Sequence[Candidate], resolution: TimeResolution,
    report: Callable[[str], None], first: ScoreTest, law_error: float = 0.0, workers: Workers | None = None,
) -> Round:  # fmt: skip
    """Search for one more candidate.

    Args:
        baseline: the model with the candidates of earlier rounds.
        accepted: these candidates.
        candidates: the effects and sensor faults to consider.
        resolution: coarse and fine time steps per sample.
        report: called with a sentence on the progress.
        first: the score test of the first round, whose signatures later rounds use again for most candidates.
        law_error: what laws that are known as curves only may have left [nats]; less is no reason to add a candidate.
        workers: processes for the trials; None for this one.
    """
    deviations = law_deviation_columns(baseline.fit, accepted) if accepted else None
    test = ScoreTest(baseline.fit, accepted, deviations, first) if accepted else first
    scores = score_all(test, candidates, report)
    if accepted:
        again = [score.candidate for score in scores[:REFRESHED] if score.chi_square_fall > MIN_REFRESHED_FALL]
        for candidate in again:
            test.refresh(candidate)
        scores = [score for score in scores if score.candidate not in again]
        scores = sorted([*scores, *score_all(test, again, report)], key=lambda score: -score.chi_square_fall)
    is_far = baseline.excess > PROGRESSIVE_RMS**2 * 0.5 * baseline.samples
    is_irregular = baseline.fit.problem.is_irregular
    if not is_irregular and (is_far or (is_distorted(baseline) and misfit(baseline) > 0.0)):
        scores = _with_scores_at_prior(baseline, accepted, scores, report)
    most = FAR_TRIALS if is_far else MAX_TRIALS
    scores = [score for score in scores if score.predicted_gain > MIN_LAW_ERRORS * law_error]
    trials = try_best_candidates(baseline, accepted, scores, resolution, report, max_trials=most, workers=workers)
    if is_far and not is_irregular:
        trials = _retry_progressively(baseline, accepted, trials, resolution, report, workers)
    trials = sorted(trials, key=lambda trial: -trial.log_evidence_gain)
    trials = [refine_trial(baseline, trial, resolution) if k < REFINED else trial for k, trial in enumerate(trials)]
    trials = [_beyond_deviations(baseline, trial, deviations) for trial in trials]
    trials = [
        _with_own_law(baseline, accepted, trial, deviations) if k < OWN_LAWS else trial
        for k, trial in enumerate(trials)
    ]
    trials.sort(key=lambda trial: -trial.mean_gain)
    promising = [trial for trial in trials if is_promising(trial, baseline.samples, law_error)]
    best = _simplest(promising, baseline.samples) if promising and promising[0] is trials[0] else None
    return Round(baseline, tuple(scores), tuple(trials), best)


def _simplest(trials: Sequence[Trial], samples: int) -> Trial:
    """The trial, of those that explain nearly the same as the first, whose name is the most probable one.

    A law with several parameters follows the difference between another law and that of the library, as a periodic
    force with a long pitch follows a spring that softens.
    """
    first = trials[0]
    scale = temperature(first.mean_gain, remaining(first.own_law_excess, samples))
    return max(trials, key=lambda trial: log_weight(trial.mean_gain, trial.determined_parameters, scale))


def _with_scores_at_prior(
    baseline: EvaluatedFit, accepted: Sequence[Candidate], scores: Sequence[Score], report: Callable[[str], None]
) -> list[Score]:
    """The scores, each the better one of that at the fit and that at the prior means of the uncertain parameters.

    A model that lacks something is calibrated to parameters that stand in for it, far from the true ones, where the
    right candidate may explain little. Falls of χ² at the prior means are scaled to the misfit of the fit.
    """
    fitted, problem = baseline.fit, baseline.fit.problem
    own = [any(u.name.startswith(candidate.prefix) for candidate in accepted) for u in problem.unknowns]
    x = np.where(own, fitted.x, 0.0)
    (outcomes,) = problem.predict(x[None], fitted.resolution.coarse, with_sensitivities=True)
    test = ScoreTest(dataclasses.replace(fitted, x=x, uncorrected=x, outcomes=outcomes), accepted)
    residual = test.projected_residual()
    scale = 2.0 * baseline.excess / max(float(residual @ residual), np.finfo(float).tiny)
    there = {s.candidate: s for s in score_all(test, [s.candidate for s in scores], report)}
    found = [
        dataclasses.replace(there[s.candidate], chi_square_fall=scale * there[s.candidate].chi_square_fall)
        if scale * there[s.candidate].chi_square_fall > s.chi_square_fall
        else s
        for s in scores
    ]
    return sorted(found, key=lambda score: -score.chi_square_fall)


def _retry_progressively(
    baseline: EvaluatedFit, accepted: Sequence[Candidate], trials: Sequence[Trial], resolution: TimeResolution,
    report: Callable[[str], None], workers: Workers | None,
) -> list[Trial]:  # fmt: skip
    """Fit the first candidates progressively until one of them explains nearly all; on workers all at once."""
    trials, retried = list(trials), list(trials[:PROGRESSIVE_TRIALS])
    at_once: list[Trial] = []
    if workers is not None and max((t.explained_share for t in trials), default=1.0) <= NEARLY_ALL_SHARE:
        report("fitting growing parts of the runs on the workers")
        at_once = workers.map(retry_progressively, [(baseline, accepted, trial, resolution) for trial in retried])
    for k, trial in enumerate(retried):
        if max(t.explained_share for t in trials) > NEARLY_ALL_SHARE:
            break
        if workers is None:
            report(f"{trial.candidate.name}: fitting growing parts of the runs")
        trials[k] = at_once[k] if at_once else retry_progressively(baseline, accepted, trial, resolution)
    return trials


def _beyond_deviations(
    baseline: EvaluatedFit, trial: Trial, deviations: Sequence[dict[str, np.ndarray]] | None
) -> Trial:
    """The trial with its remaining excess beyond what deviations of the accepted laws explain."""
    if trial.evaluated is None:
        return trial
    before, after = baseline.excess_with(deviations), trial.evaluated.excess_with(deviations)
    share = (before - after) / max(before, 1.0)
    gain = before - after - _penalty(baseline, trial)
    return dataclasses.replace(
        trial, explained_share=share, remaining_excess=after, gain_beyond_laws=gain,
        own_law_excess=after, own_law_gain=gain,
    )  # fmt: skip


def refine_trial(baseline: EvaluatedFit, trial: Trial, resolution: TimeResolution) -> Trial:
    """A trial that ends near the noise, refitted with its own solver error in place of that of the baseline.

    Where the signals depend irregularly on the parameters, one that has found a better model is fitted again with a
    wide ensemble.
    """
    found = trial.evaluated
    if found is not None and found.fit.problem.is_irregular:
        is_better = found.cost < baseline.cost
        again = fit_coarse(found.fit.problem, found.fit.x, resolution.coarse, REFINEMENT_STEPS) if is_better else found
        return trial.with_fit(baseline, again) if again.cost < found.cost else trial
    if found is None or found.excess > NEAR_EXCESS * 0.5 * found.samples:
        return trial
    refined = with_solver_error(found, resolution, REFINEMENT_STEPS)
    return trial.with_fit(baseline, refined) if refined.excess < found.excess else trial


def _with_own_law(
    baseline: EvaluatedFit, accepted: Sequence[Candidate], trial: Trial,
    deviations: Sequence[dict[str, np.ndarray]] | None,
) -> Trial:  # fmt: skip
    """The trial with what it leaves if its own law may deviate from that of the library."""
    found = trial.evaluated
    left = found is not None and remaining(trial.remaining_excess, found.samples)
    if not left or trial.gain_beyond_laws < MIN_GAIN:
        return trial
    columns = law_deviation_columns(found.fit, [*accepted, trial.candidate])
    after = found.excess_with(columns)
    gain = (
        trial.gain_beyond_laws + trial.remaining_excess - after - deviation_cost(columns) + deviation_cost(deviations)
    )
    if gain < trial.gain_beyond_laws:
        return trial
    return dataclasses.replace(trial, own_law_excess=after, own_law_gain=gain)


def _penalty(baseline: EvaluatedFit, trial: Trial) -> float:
    """The part of the log-evidence that the parameters of a candidate cost [nats]."""
    fall = baseline.cost - trial.evaluated.cost
    return fall - trial.log_evidence_gain if math.isfinite(trial.log_evidence_gain) else math.inf


def score_all(test: ScoreTest, candidates: Sequence[Candidate], report: Callable[[str], None]) -> list[Score]:
    """The scores of all candidates, the largest predicted fall of χ² first."""
    scores = []
    for k, candidate in enumerate(candidates):
        report(f"screening {k + 1} of {len(candidates)}: {candidate.name}")
        scores.append(test.score(candidate))
    return sorted(scores, key=lambda score: -score.chi_square_fall)
