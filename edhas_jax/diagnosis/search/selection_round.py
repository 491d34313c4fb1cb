"""One round of the search: score all candidates, try the best, and find the one that explains most."""

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from edhas_jax.diagnosis.search.calibrated_model import misfit
from edhas_jax.diagnosis.search.candidates import Candidate, at_prior_means
from edhas_jax.diagnosis.search.decision_rules import (
    MIN_GAIN,
    holds_by_library_law,
    is_promising,
    least_predicted_gain,
    log_odds,
    remaining,
    unexplained_floor,
)
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit, fit_coarse
from edhas_jax.diagnosis.search.free_law import free_law
from edhas_jax.diagnosis.search.law_deviation import LawDeviation, deviation_cost, law_deviation_columns
from edhas_jax.diagnosis.search.plausibility import ImplausibilityCost, implausibility_cost
from edhas_jax.diagnosis.search.result import Round
from edhas_jax.diagnosis.search.screening import Score, ScoreTest
from edhas_jax.diagnosis.search.settled_fit import (
    REFINEMENT_STEPS,
    refine_fit,
    settle,
    with_recorded_time,
    without_wrong_samples,
)
from edhas_jax.diagnosis.search.stage_encoding import RoundEnd
from edhas_jax.diagnosis.search.tightened_bench import with_tightened_bench
from edhas_jax.diagnosis.search.trial import (
    MAX_TRIALS,
    NEARLY_ALL_SHARE,
    Trial,
    retry_progressively,
    try_best_candidates,
)
from edhas_jax.diagnosis.workers import Workers
from edhas_jax.measurements.time_resolution import TimeResolution

# candidates whose signatures are simulated again in later rounds: how many, and from which fall of χ² on
REFRESHED, MIN_REFRESHED_FALL = 8, 10.0
PROGRESSIVE_TRIALS = 8  # candidates that are fitted progressively where none explains nearly all
REFINED, OWN_LAWS = 2, 2  # trials that are refined, and whose own law may deviate
AS_MUCH = 2.0  # what another candidate may leave, over what one with an implausible parameter leaves
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
    if not is_irregular and (is_far or (baseline.fit.is_distorted and misfit(baseline) > 0.0)):
        scores = _with_scores_at_prior(baseline, accepted, scores, report)
    most = FAR_TRIALS if is_far else MAX_TRIALS
    least = least_predicted_gain(baseline, accepted, deviations, law_error)
    scores = [score for score in scores if score.predicted_gain > least]
    trials = try_best_candidates(baseline, accepted, scores, resolution, report, max_trials=most, workers=workers)
    if is_far and not is_irregular:
        trials = _retry_progressively(baseline, accepted, trials, resolution, report, workers)
    trials = sorted(trials, key=lambda trial: -trial.log_evidence_gain)
    trials = [refine_trial(baseline, trial, resolution) if k < REFINED else trial for k, trial in enumerate(trials)]
    trials = [beyond_deviations(baseline, trial, deviations) for trial in trials]
    trials = [with_own_law(baseline, accepted, t, deviations) if k < OWN_LAWS else t for k, t in enumerate(trials)]
    trials.sort(key=lambda trial: -trial.mean_gain)
    promising = [trial for trial in trials if is_promising(trial, baseline.samples, law_error)]
    best = _simplest(promising, baseline.samples) if promising and promising[0] is trials[0] else None
    return Round(baseline, tuple(scores), tuple(trials), best)


def end_of_round(
    found: Round, mounted: Sequence[Candidate], resolution: TimeResolution, report: Callable[[str], None],
    law_error: float, most: int,
) -> RoundEnd:  # fmt: skip
    """Accept a trial of a round, and fit the model with it and with the laws that differ as curves.

    The best trial is accepted if its parameters are plausible. If not, the next promising trial is accepted, provided
    that its parameters are plausible and that it leaves less than `AS_MUCH` times as much unexplained.

    Args:
        found: the round, with the trial that is best.
        mounted: the candidates of earlier rounds.
        resolution: coarse and fine time steps per sample.
        report: called with a sentence on the progress.
        law_error: what laws that are known as curves only may have left [nats].
        most: largest number of trials with which the model is fitted.
    """
    first: RoundEnd | None = None
    for trial in _promising(found, law_error)[:most]:
        end = _end_with(found, trial, mounted, resolution, report)
        if end is None:
            continue
        model, cost = end.baseline, implausibility_cost(trial.candidate, end.baseline, trial.own_law_gain)
        end, is_plausible = _with_prior_cost(end, cost.weight), not cost.gain
        if first is None:
            first, its_cost, best = end, cost, model
            if is_plausible:
                return end
        elif is_plausible and _leaves_as_little(model.excess, best.excess, best.samples, law_error):
            return _with_rejected(end, first, its_cost)
    return first or RoundEnd(dataclasses.replace(found, accepted=None), None)


def _promising(found: Round, law_error: float) -> list[Trial]:
    """The accepted trial of a round, then its other promising ones, the best first; none where nothing was accepted."""
    first = found.accepted
    others = [t for t in found.trials if t is not first and is_promising(t, found.baseline.samples, law_error)]
    return [] if first is None else [first, *others]


def _end_with(
    found: Round, trial: Trial, mounted: Sequence[Candidate], resolution: TimeResolution,
    report: Callable[[str], None],
) -> RoundEnd | None:  # fmt: skip
    """A round that accepts a trial, and the model with it and the laws that differ; None where it does not hold."""
    settled = settle(with_tightened_bench(trial.evaluated, resolution.coarse), resolution, report)
    settled = with_recorded_time(settled, resolution, report)
    law, model = free_law(settled, (*mounted, trial.candidate), trial.candidate, resolution, report)
    if law is None and not holds_by_library_law(trial, found.baseline.samples):
        return None
    laws = () if law is None else (law,)
    curves = {candidate.of for candidate in mounted if isinstance(candidate, LawDeviation)}
    for earlier in mounted:  # what another candidate explains now has hidden whether its law differs
        present = (*mounted, trial.candidate, *laws)
        if not isinstance(earlier, LawDeviation) and earlier.id not in curves:
            law, model = free_law(model, present, earlier, resolution, report)
            laws = laws if law is None else (*laws, law)
    model = without_wrong_samples(with_tightened_bench(model, resolution.coarse), resolution)
    return RoundEnd(dataclasses.replace(found, accepted=trial, laws=laws), model)


def _leaves_as_little(excess: float, other: float, samples: int, law_error: float = 0.0) -> bool:
    """Whether an excess of ½χ² that is left is not much more than another one."""
    return unexplained_floor(excess, samples, law_error) < AS_MUCH * unexplained_floor(other, samples, law_error)


def _with_prior_cost(end: RoundEnd, cost: float) -> RoundEnd:
    """The end of a round, implausible values that only the law of the library needs at their cost beside its curve."""
    trial = end.round.accepted
    if cost >= trial.prior_cost or all(law.of != trial.candidate.id for law in end.round.laws):
        return end
    return end._replace(round=end.round.with_trial(dataclasses.replace(trial, prior_cost=cost)))


def _with_rejected(end: RoundEnd, rejected: RoundEnd, cost: ImplausibilityCost) -> RoundEnd:
    """The end of a round, the trial of the rejected candidate with the evidence of its fit with laws as curves."""
    kept, lost, model = end.round.accepted, rejected.round.accepted, rejected.baseline
    change = model.log_evidence - end.baseline.log_evidence - cost.gain
    gains = {name: getattr(kept, name) + change for name in ("gain_beyond_laws", "own_law_gain")}
    return end._replace(round=end.round.with_trial(dataclasses.replace(lost, prior_cost=cost.weight, **gains)))


def _simplest(trials: Sequence[Trial], samples: int) -> Trial:
    """The trial, of those that explain nearly the same as the first, whose name is the most probable one.

    A law with several parameters follows the difference between another law and that of the library, as a periodic
    force with a long pitch follows a spring that softens.
    """
    first = trials[0]
    return max(
        (t for t in trials if _leaves_as_little(t.remaining_excess, first.remaining_excess, samples)),
        key=lambda t: log_odds(t, first, samples),
    )


def _with_scores_at_prior(
    baseline: EvaluatedFit, accepted: Sequence[Candidate], scores: Sequence[Score], report: Callable[[str], None]
) -> list[Score]:
    """The scores, each the better one of that at the fit and that at the prior means of the uncertain parameters.

    Where parameters stand in for what is missing, the right candidate may explain little. Falls of χ² at the prior
    means are scaled to the misfit of the fit.
    """
    fitted, problem = baseline.fit, baseline.fit.problem
    x = at_prior_means(problem.unknowns, accepted, fitted.x)
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


def beyond_deviations(
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
    """A trial with its fit refined, see `refine_fit`.

    Where the signals depend irregularly on the parameters, one that has found a better model is fitted again with a
    wide ensemble.
    """
    found = trial.evaluated
    if found is not None and found.fit.problem.is_irregular:
        is_better = found.cost < baseline.cost
        again = fit_coarse(found.fit.problem, found.fit.x, resolution.coarse, REFINEMENT_STEPS) if is_better else found
        return trial.with_fit(baseline, again) if again.cost < found.cost else trial
    if found is None:
        return trial
    refined = refine_fit(found, resolution)
    return trial if refined is found else trial.with_fit(baseline, refined)


def with_own_law(
    baseline: EvaluatedFit, accepted: Sequence[Candidate], trial: Trial,
    deviations: Sequence[dict[str, np.ndarray]] | None,
) -> Trial:  # fmt: skip
    """The trial with what it leaves if its own law may deviate from that of the library."""
    found = trial.evaluated
    left = found is not None and remaining(trial.remaining_excess, found.samples)
    if not left or not trial.gain_beyond_laws >= MIN_GAIN:
        return trial
    columns = law_deviation_columns(found.fit, [*accepted, trial.candidate])
    after = found.excess_with(columns)
    gain = (
        trial.gain_beyond_laws + trial.remaining_excess - after - deviation_cost(columns) + deviation_cost(deviations)
    )
    if not gain >= trial.gain_beyond_laws:
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
