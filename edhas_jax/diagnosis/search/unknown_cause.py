"""Where an unknown cause acts: free terms at all places of the machine, and fits of the best of them."""

from collections.abc import Callable, Sequence

from edhas_jax.diagnosis.calibration.fit_problem import FitError
from edhas_jax.diagnosis.search.decision_rules import MIN_GAIN
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit, fit_coarse, start_coordinates
from edhas_jax.diagnosis.search.free_curves import score_free_curves
from edhas_jax.diagnosis.search.localisation import FREE_COST, component_shares, free_strength
from edhas_jax.diagnosis.search.memory_term import score_memory_terms
from edhas_jax.diagnosis.search.result import Round
from edhas_jax.diagnosis.search.screening import Score, ScoreTest
from edhas_jax.diagnosis.search.selection_round import refine_trial
from edhas_jax.diagnosis.search.trial import Trial, try_candidate
from edhas_jax.diagnosis.workers import Workers, fits_of
from edhas_jax.measurements.time_resolution import TimeResolution

# free terms that are fitted, their least predicted share of the misfit, and the largest number of steps
FREE_TRIALS, MIN_FREE_SHARE, FREE_STEPS = 2, 0.2, 12
OWN_FREE_TRIALS, OWN_FREE_STEPS = 4, 60  # the same of a rig of one's own, where curves take the place of a library

Report = Callable[[str], None]


def localise(
    rounds: Sequence[Round], test: ScoreTest, resolution: TimeResolution, report: Report, workers: Workers | None
) -> tuple[dict[str, float], list[Trial], float]:
    """Where an unknown cause acts.

    Args:
        rounds: the rounds of the search; the first one's model is examined.
        test: score test of that model.
        resolution: coarse and fine time steps per sample.
        report: called with a sentence on the progress.
        workers: processes for the fits; None for this one.

    Returns:
        The share of the misfit of each component, fits of the free terms that explain most of it, and their strength.
    """
    report("localising the discrepancy")
    baseline = rounds[0].baseline
    terms = [*score_free_curves(test, baseline.fit, report), *score_memory_terms(test, baseline.fit, report)]
    terms.sort(key=lambda score: -score.chi_square_fall)
    is_own = baseline.fit.machine.is_own
    least, steps = max(MIN_FREE_SHARE * baseline.excess, FREE_COST + MIN_GAIN), OWN_FREE_STEPS if is_own else FREE_STEPS
    terms_tried = [s for s in terms[: OWN_FREE_TRIALS if is_own else FREE_TRIALS] if s.predicted_gain > least]
    jobs = [(baseline, score, resolution, steps) for score in terms_tried]
    sentences = [f"fitting {score.candidate.text}" for score in terms_tried]
    trials = fits_of(_try_free_term, jobs, sentences, workers, report)
    effects = [score.candidate for score in rounds[0].scores]
    shares = component_shares(test, baseline, effects, [*rounds[0].trials, *trials], terms)
    trials.sort(key=lambda trial: -trial.log_evidence_gain)
    return shares, trials, free_strength(_refitted_without_term(baseline, trials, resolution), terms, trials)


def _try_free_term(baseline: EvaluatedFit, score: Score, resolution: TimeResolution, max_steps: int) -> Trial:
    """The calibrated model with a free term."""
    trial = try_candidate(baseline, (), score, resolution, max_steps)
    return refine_trial(baseline, trial, resolution)


def _refitted_without_term(baseline: EvaluatedFit, trials: Sequence[Trial], resolution: TimeResolution) -> EvaluatedFit:
    """A model whose signals depend irregularly on its parameters, refitted from the values with the best free term.

    Such a fit may end in another minimum by chance. What is found there without the term is no merit of the term.
    """
    found = [t.evaluated for t in trials if t.evaluated is not None and t.evaluated.cost < baseline.cost]
    problem = baseline.fit.problem
    if not problem.is_irregular or not found:
        return baseline
    best = min(found, key=lambda evaluated: evaluated.cost)
    try:
        again = fit_coarse(problem, start_coordinates(problem, best.fit.values), resolution.coarse, FREE_STEPS)
    except FitError:
        return baseline
    return min(baseline, again, key=lambda evaluated: evaluated.cost)
