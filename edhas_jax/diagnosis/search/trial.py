"""Trials of candidates: everything is refitted with a candidate in place and compared with the model without it."""

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from edhas_jax.diagnosis.calibration.fit import FitError
from edhas_jax.diagnosis.search.candidates import Candidate, build_problem
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit, fit_coarse, refine_fit, start_coordinates
from edhas_jax.diagnosis.search.plausibility import implausible_parameters
from edhas_jax.diagnosis.search.progressive_fit import fit_progressively
from edhas_jax.diagnosis.search.screening import Score
from edhas_jax.measurements.campaign import Use
from edhas_jax.measurements.residuals import rms_over_noise
from edhas_jax.measurements.time_resolution import TimeResolution

MIN_ACHIEVED_FALL_SHARE = 0.3  # of the predicted fall of χ²: a fit that achieves less is restarted elsewhere
RESTART_PRIOR_SHARE = 0.3  # of the calibrated coordinates: where the restart lies between prior mean and calibration
PRIOR_BOUND_PENALTY = 30.0  # nats off the gain of a candidate that depends on a parameter at its prior bound
MIN_CHI_SQUARE_FALL = 25.0  # predicted fall of χ² below which no trial is made: the best of forty reaches it by chance
MAX_TRIALS = 5
MIN_RIVAL_GAIN_SHARE = 0.1  # of the gain reached: a candidate that predicts less is not tried
TRIAL_STEPS = 12  # maximum number of Levenberg-Marquardt steps of a trial
WORST_RUN_RATIO = 2.0  # rms residual of a run over the median of all runs, above which the run is left out at first


@dataclasses.dataclass(frozen=True)
class Trial:
    """A candidate, its score, and the fit with it.

    Args:
        candidate: what was tried.
        score: its score test before the trial (chi-square scale).
        evaluated: the fit with the candidate; None where no fit was possible.
        log_evidence_gain: log-evidence with the candidate less that of the model without it, in nats, less
            `PRIOR_BOUND_PENALTY` where it depends on a parameter at the prior bound; −inf without a fit.
        holdout_half_chi_square_fall: fall of ½χ² on the held-out runs, on all runs where none is held out; −inf
            without a fit.
    """

    candidate: Candidate
    score: Score
    evaluated: EvaluatedFit | None
    log_evidence_gain: float
    holdout_half_chi_square_fall: float

    def with_fit(self, baseline: EvaluatedFit, evaluated: EvaluatedFit) -> "Trial":
        """The trial with another fit of its candidate, compared with `baseline`, the model without it."""
        gain = evaluated.log_evidence - baseline.log_evidence
        if implausible_parameters(self.candidate, evaluated.fit):
            gain -= PRIOR_BOUND_PENALTY
        falls = baseline.holdout_half_chi_square() - evaluated.holdout_half_chi_square()
        return dataclasses.replace(
            self, evaluated=evaluated, log_evidence_gain=gain, holdout_half_chi_square_fall=float(falls.sum())
        )


def try_candidate(
    baseline: EvaluatedFit, accepted: Sequence[Candidate], score: Score, resolution: TimeResolution, max_steps: int,
    finish: bool, progressive: bool = True,
) -> Trial:  # fmt: skip
    """Refit all unknowns with a candidate in place.

    The fit starts from the calibrated values. If it achieves less than 30 % of the predicted fall of χ², it is
    restarted nearer the prior mean, because a wrong model biases the calibrated values.

    Args:
        baseline: the model without the candidate.
        accepted: candidates that `baseline` has already.
        score: score test of the candidate; its `x` starts the fit.
        resolution: coarse and fine time steps per sample.
        max_steps: maximum number of Levenberg-Marquardt steps of each fit.
        finish: whether to refine the fit at the fine time step.
        progressive: whether to repeat a fit that stays far from the noise on growing fractions of the runs.

    Returns:
        The trial with the fit of the largest log-evidence.
    """
    fitted, candidate = baseline.fit, score.candidate
    known = fitted.problem
    problem = build_problem(known.campaign, known.machine, known.instruments, accepted, candidate)
    count = len(problem.unknowns) - len(score.x)
    calibrated_start = np.concatenate([start_coordinates(problem, fitted.values)[:count], score.x])
    shrunk_start = np.concatenate([RESTART_PRIOR_SHARE * calibrated_start[:count], score.x])
    best: EvaluatedFit | None = None
    for start in (calibrated_start, shrunk_start):
        try:
            found = fit_coarse(problem, start, resolution.coarse, max_steps)
            found = refine_fit(found, resolution, max_steps) if finish else found
        except FitError:
            continue
        if best is None or found.log_evidence > best.log_evidence:
            best = found
        if baseline.cost - best.cost > MIN_ACHIEVED_FALL_SHARE * score.predicted_gain:
            break
    if progressive and (best is None or not best.near_noise):
        starts = np.array([shrunk_start] if best is None else [best.fit.x, shrunk_start])
        best = fit_progressively(problem, starts, len(score.x), resolution.coarse, max_steps, best) or best
    failed = Trial(candidate, score, None, -math.inf, -math.inf)
    return failed if best is None else failed.with_fit(baseline, best)


def try_best_candidates(
    baseline: EvaluatedFit, accepted: Sequence[Candidate], scores: Sequence[Score], resolution: TimeResolution,
    report: Callable[[str], None], reached: float = 0.0,
) -> list[Trial]:  # fmt: skip
    """Try the candidates with the largest predicted fall of χ², until the others predict too little.

    Args:
        baseline: the model without the candidates.
        accepted: candidates that `baseline` has already.
        scores: score tests, the largest predicted fall of χ² first.
        resolution: coarse and fine time steps per sample.
        report: called with a sentence on the progress.
        reached: log-evidence gain [nats] that other candidates have achieved already.
    """
    trials: list[Trial] = []
    for score in scores[:MAX_TRIALS]:
        too_little = score.predicted_gain < MIN_RIVAL_GAIN_SHARE * reached
        if score.chi_square_fall < MIN_CHI_SQUARE_FALL or too_little:
            break
        report(f"trying {score.candidate.name}: predicted fall of χ² {score.chi_square_fall:.0f}")
        # once one candidate explains nearly all, rivals need no search for a better minimum
        progressive = not any(t.evaluated is not None and t.evaluated.near_noise for t in trials)
        trials.append(
            try_candidate(baseline, accepted, score, resolution, TRIAL_STEPS, baseline.near_noise, progressive)
        )
        reached = max(reached, best_gain(trials, scores))
    return trials


def best_gain(trials: Sequence[Trial], scores: Sequence[Score]) -> float:
    """The largest log-evidence gain of some trials [nats], at most half the largest predicted fall of χ².

    The limit keeps rivals in the race: where a candidate achieves far more than predicted, rivals may as well.
    """
    return min(max((t.log_evidence_gain for t in trials), default=0.0), scores[0].predicted_gain) if scores else 0.0


def refit_without_worst_runs(baseline: EvaluatedFit, trial: Trial, steps_per_sample: int, max_steps: int) -> Trial:
    """Refit a trial first without the runs that it fits worst, then on all runs.

    Runs at the edge of resonance or cavitation give the cost many local minima, and a fit caught in one of them
    explains these runs worst. Without them the fit finds the region of the global minimum.

    Args:
        baseline: the model without the candidate of the trial.
        trial: a trial with a fit.
        steps_per_sample: time steps per sample.
        max_steps: maximum number of Levenberg-Marquardt steps of each fit.

    Returns:
        The trial with the new fit, or unchanged where no run stands out or the log-evidence is not larger.
    """
    found = trial.evaluated
    problem = found.fit.problem
    runs = problem.campaign.runs_for(Use.FIT)
    rms = np.array([rms_over_noise(found.residuals[run.name].values()) for run in runs])
    selected = tuple(run for run, of in zip(runs, rms, strict=True) if of <= WORST_RUN_RATIO * np.median(rms))
    if len(selected) == len(runs):
        return trial
    try:
        part = fit_coarse(dataclasses.replace(problem, runs=selected), found.fit.x, steps_per_sample, max_steps)
        whole = fit_coarse(problem, part.fit.x, steps_per_sample, max_steps)
    except FitError:
        return trial
    return trial.with_fit(baseline, whole) if whole.log_evidence > found.log_evidence else trial
