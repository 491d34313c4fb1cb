"""One round of forward selection: score all candidates, try the best, and decide whether one of them is accepted."""

from collections.abc import Callable, Sequence

from edhas_jax.diagnosis.search.candidates import Candidate, can_mount
from edhas_jax.diagnosis.search.decision_rules import REPLACEMENT_MARGIN, chi_square_excess, is_confirmed
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit, fit_coarse
from edhas_jax.diagnosis.search.generic_terms import GENERIC_TERMS
from edhas_jax.diagnosis.search.result import Round
from edhas_jax.diagnosis.search.screening import Score, ScoreTest
from edhas_jax.diagnosis.search.trial import (
    MIN_CHI_SQUARE_FALL,
    TRIAL_STEPS,
    Trial,
    best_gain,
    refit_without_worst_runs,
    try_best_candidates,
)
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.time_resolution import TimeResolution, choose_time_resolution

REFIT_STEPS = 25  # maximum number of Levenberg-Marquardt steps of a refit of the best trial
GENERIC_EXCESS_SHARE = 0.5  # of the excess of χ²: generic terms are scored where no effect predicts a larger fall
GENERIC_FALL_RATIO = 2.0  # ratio of predicted falls of χ² above which generic terms are tried before effects
FULL_EXPLANATION_SHARE = 0.9  # of the excess of χ²: an effect that removes more leaves nothing to generic terms


def search_round(
    baseline: EvaluatedFit, accepted: Sequence[Candidate], candidates: Sequence[Candidate], resolution: TimeResolution,
    report: Callable[[str], None], last: bool,
) -> tuple[Round, TimeResolution]:  # fmt: skip
    """Search for one more candidate.

    Generic terms are scored where no effect predicts a fall of half the excess of χ² over the noise. They are tried
    before the effects if their predicted fall of χ² is twice as large, else after them if the accepted effect leaves
    more than 10 % of the excess.

    Args:
        baseline: the model with the candidates of earlier rounds.
        accepted: these candidates.
        candidates: the effects and sensor faults to consider.
        resolution: coarse and fine time steps per sample.
        report: called with a sentence on the progress.
        last: whether the candidates are only scored, because no more may be accepted.

    Returns:
        The round, and the time steps per sample that its trials need.
    """
    test, excess = ScoreTest(baseline.fit, accepted), chi_square_excess(baseline)
    scores = _score_all(test, candidates, report)
    if last:
        return Round(baseline, tuple(scores), (), None), resolution
    largest_fall = scores[0].chi_square_fall if scores else 0.0
    generic: list[Score] = []
    if excess > MIN_CHI_SQUARE_FALL and largest_fall < GENERIC_EXCESS_SHARE * excess:
        generic = _score_all(test, generic_candidates(baseline.fit.problem.machine), report)
    generic_first = bool(generic) and generic[0].chi_square_fall > GENERIC_FALL_RATIO * largest_fall
    generic_trials = try_best_candidates(baseline, accepted, generic, resolution, report) if generic_first else []
    reached = best_gain(generic_trials, generic)
    trials = try_best_candidates(baseline, accepted, scores, resolution, report, reached)
    trials, resolution = _refit_best(baseline, trials, resolution, report)
    best = max(trials, key=lambda t: t.log_evidence_gain, default=None)
    found = best if best is not None and is_confirmed(baseline, best) else None
    gain = found.log_evidence_gain if found else 0.0
    # 2 · gain converts a log-evidence gain to the chi-square scale
    if generic and not generic_first and 2.0 * gain < FULL_EXPLANATION_SHARE * excess:
        promising = [s for s in generic if s.predicted_gain > gain]
        generic_trials = try_best_candidates(baseline, accepted, promising, resolution, report, gain)
    generic_trials = sorted(generic_trials, key=lambda t: -t.log_evidence_gain)
    if generic_trials:
        top = generic_trials[0]
        if is_confirmed(baseline, top) and top.log_evidence_gain > REPLACEMENT_MARGIN + gain:
            # the library lacks the effect if a generic term explains clearly more than its effects
            return Round(baseline, tuple(scores), tuple(trials), None, tuple(generic_trials)), resolution
    return Round(baseline, tuple(scores), tuple(trials), found), resolution


def generic_candidates(machine: Rig) -> list[Candidate]:
    """The generic terms that can be added to a machine."""
    return [Candidate(kind) for kind in GENERIC_TERMS if can_mount(machine, kind)]


def _score_all(test: ScoreTest, candidates: Sequence[Candidate], report: Callable[[str], None]) -> list[Score]:
    """The scores of all candidates, the largest predicted fall of χ² first."""
    scores = []
    for k, candidate in enumerate(candidates):
        report(f"screening {k + 1} of {len(candidates)}: {candidate.name}")
        scores.append(test.score(candidate))
    return sorted(scores, key=lambda score: -score.chi_square_fall)


def _refit_best(
    baseline: EvaluatedFit, trials: list[Trial], resolution: TimeResolution, report: Callable[[str], None]
) -> tuple[list[Trial], TimeResolution]:
    """Refit the best trial where it is confirmed but stays far from the noise; return trials and time steps.

    The candidate may need a finer time step, or the fit may have ended in a local minimum.
    """
    best = max(trials, key=lambda t: t.log_evidence_gain, default=None)
    if best is None or not is_confirmed(baseline, best):
        return trials, resolution
    refitted, finer = best, _resolution_with(best, resolution)
    if not best.evaluated.near_noise and finer.coarse > resolution.coarse:
        report(f"a finer time step for {best.candidate.name}")
        fitted = best.evaluated.fit
        refitted = best.with_fit(baseline, fit_coarse(fitted.problem, fitted.x, finer.coarse, TRIAL_STEPS))
    if not refitted.evaluated.near_noise:
        report(f"{best.candidate.name}: refitting without the runs with the largest residuals")
        refitted = refit_without_worst_runs(baseline, refitted, finer.coarse, REFIT_STEPS)
        finer = _resolution_with(refitted, finer)
    return [refitted if t is best else t for t in trials], finer


def _resolution_with(trial: Trial, resolution: TimeResolution) -> TimeResolution:
    """The time steps that are fine enough for the given ones and for the fit of a trial."""
    needed = choose_time_resolution(trial.evaluated.fit.problem.model(), trial.evaluated.fit.x)
    return TimeResolution(max(resolution.coarse, needed.coarse), max(resolution.fine, needed.fine), needed.error)
