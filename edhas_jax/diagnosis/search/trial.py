"""Trials of candidates: everything is refitted with a candidate in place and compared with the model without it."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from edhas_jax.diagnosis.calibration.fit_problem import FitError, FitProblem
from edhas_jax.diagnosis.search.candidates import MOST_ON_GRID, Candidate, at_prior_means, with_candidate
from edhas_jax.diagnosis.search.evaluated_fit import NEAR_EXCESS, EvaluatedFit, fit_coarse, start_coordinates
from edhas_jax.diagnosis.search.free_term import FreeTerm
from edhas_jax.diagnosis.search.local_minima import fit_across_minima, fit_progressively
from edhas_jax.diagnosis.search.plausibility import implausibility_cost
from edhas_jax.diagnosis.search.screening import Score, with_scaled_size
from edhas_jax.diagnosis.workers import Workers
from edhas_jax.measurements.time_resolution import TimeResolution

MIN_ACHIEVED_FALL_SHARE = 0.3  # of the predicted fall of χ²: a fit that achieves less is restarted elsewhere
MIN_RESTARTED_SHARE = 0.2  # of the misfit, predicted: a candidate with less is not restarted from its grid point
MOST_PARAMETERS = 3.0  # that count against a candidate: more describe details of a law, which imitate no other one
SMALL_SIZE = 0.1  # of the predicted size, of a start that is hardly above the model without the candidate
MIN_CHI_SQUARE_FALL = 25.0  # predicted fall of χ² below which no trial is made: the best of forty reaches it by chance
MIN_IRREGULAR_FALL = 200.0  # the same for a model whose signals depend irregularly on its parameters
MAX_TRIALS, MAX_IRREGULAR_TRIALS = 6, 3
MIN_RIVAL_GAIN_SHARE = 0.1  # of the gain reached: a candidate that predicts less is not tried
# close to the noise level and to the prior means the linear prediction is accurate: there a candidate is fitted only if
# it predicts at least these shares, of the misfit and of the gain reached so far
MIN_NEAR_SHARE, MIN_NEAR_RIVAL_SHARE = 0.07, 0.25
TRIAL_STEPS = 12  # maximum number of Levenberg-Marquardt steps of a trial
# a trial is given up where, after so many steps, its fall of ½χ² is below a share of that of the best trial so far and
# would be so after as many nats more as the last `FALL_STEPS` steps have brought
CHECKED_STEPS, FALL_STEPS = {4: 0.4, 7: 0.75}, 2
CHECKED_ENSEMBLES = {12: 0.4, 16: 0.75}  # the same for fits with an ensemble, which may come from far above
NEARLY_ALL_SHARE = 0.7  # of the excess of χ²: below it the fit may have ended in a local minimum


@dataclasses.dataclass(frozen=True)
class Trial:
    """A candidate, its score, and the fit with it.

    Args:
        candidate: what was tried.
        score: its score test before the trial (chi-square scale).
        evaluated: the fit with the candidate; None where no fit was possible.
        log_evidence_gain: log-evidence with the candidate less that of the model without it, in nats, less a penalty
            where it depends on a parameter beyond its plausible range; −inf without a fit.
        left_out_gain: the same for the predictions of each fitted run from the others; −inf without a fit.
        explained_share: share of the excess of ½χ² over the noise that the candidate removes; −inf without a fit.
        holdout_half_chi_square_fall: fall of ½χ² on the held-out runs, on all runs where none is held out; −inf
            without a fit.
        gain_beyond_laws: log-evidence gain beyond what deviations of the accepted laws explain, in nats.
        remaining_excess: excess of ½χ² that the candidate and deviations of the accepted laws leave.
        own_law_excess: the same where its own law may deviate as well; `remaining_excess` where not computed.
        own_law_gain: log-evidence gain [nats] with its own law deviating, less the cost of the deviation's values.
        prior_cost: what the implausible values of its parameters cost [nats], see `implausibility_cost`.
    """

    candidate: Candidate
    score: Score
    evaluated: EvaluatedFit | None
    log_evidence_gain: float
    left_out_gain: float
    explained_share: float
    holdout_half_chi_square_fall: float
    gain_beyond_laws: float = -math.inf
    remaining_excess: float = math.inf
    own_law_excess: float = math.inf
    own_law_gain: float = -math.inf
    prior_cost: float = 0.0

    @property
    def mean_gain(self) -> float:
        """The mean of the log-evidence gains [nats] with the library's law and with a law that may differ from it."""
        return 0.5 * (self.gain_beyond_laws + self.own_law_gain)

    @property
    def determined_parameters(self) -> float:
        """The effective number of parameters that the data determine, at most `MOST_PARAMETERS`; 0 without a fit.

        Source: MacKay, Bayesian interpolation, Neural Computation 4 (1992) 415, well-determined parameters.
        """
        if self.evaluated is None:
            return 0.0
        fit = self.evaluated.fit
        own = {u.name for u in self.candidate.own_unknowns(fit.problem.unknowns).values()}
        found = sum(1.0 - std**2 for u, std in zip(fit.problem.unknowns, fit.std, strict=True) if u.name in own)
        return min(float(found), MOST_PARAMETERS)

    @classmethod
    def failed(cls, score: Score) -> "Trial":
        """The trial of a candidate with which the model cannot be fitted."""
        return cls(score.candidate, score, None, *[-math.inf] * 4)

    def with_fit(self, baseline: EvaluatedFit, evaluated: EvaluatedFit) -> "Trial":
        """The trial with another fit of its candidate, compared with `baseline`, the model without it."""
        gain = evaluated.log_evidence - baseline.log_evidence
        implausible = implausibility_cost(self.candidate, evaluated, gain)
        falls = baseline.holdout_half_chi_square() - evaluated.holdout_half_chi_square()
        return dataclasses.replace(
            self, evaluated=evaluated, log_evidence_gain=gain - implausible.gain,
            left_out_gain=float(np.sum(evaluated.left_out - baseline.left_out)),
            explained_share=(baseline.cost - evaluated.cost) / max(baseline.excess, 1.0),
            holdout_half_chi_square_fall=float(falls.sum()), prior_cost=implausible.weight,
        )  # fmt: skip


def try_candidate(
    baseline: EvaluatedFit, accepted: Sequence[Candidate], score: Score, resolution: TimeResolution, max_steps: int,
    reached: float = 0.0,
) -> Trial:  # fmt: skip
    """Refit all unknowns with a candidate in place.

    The fit starts from the calibrated values. If it achieves less than 30 % of the predicted fall of χ², it is
    restarted at the prior means, because a wrong model biases the calibrated values; also if a calibrated parameter
    is implausible and less than half of the misfit is removed. If it ends above the model without the candidate, it is
    restarted with so small a size that it begins there; if all that achieves less than 30 % of a large predicted fall,
    with the size of the grid point. If that is too little as well, `fit_across_minima` continues the fit. A free term
    of a rig of one's own begins without influence first.

    Args:
        baseline: the model without the candidate.
        accepted: candidates that `baseline` has already.
        score: score test of the candidate; its `x` starts the fit.
        resolution: coarse and fine time steps per sample.
        max_steps: maximum number of Levenberg-Marquardt steps of each fit.
        reached: fall of ½χ² that another candidate has achieved; a fit that stays far below it is given up.

    Returns:
        The trial with the fit of the largest log-evidence.
    """
    fitted, candidate = baseline.fit, score.candidate
    problem = with_candidate(fitted.problem, accepted, candidate)
    centre = start_coordinates(problem, fitted.values)  # of the priors of the candidate; a free term has no influence
    count, placed = len(centre) - len(score.x), (*accepted, candidate)
    calibrated_start = np.append(centre[:count], score.x)
    if problem.is_irregular:
        return _try_irregular(baseline, problem, [centre, calibrated_start], score, resolution, max_steps, reached)
    starts = [calibrated_start, at_prior_means(problem.unknowns, placed, calibrated_start)]
    is_own_curve = isinstance(candidate, FreeTerm) and fitted.machine.is_own
    if is_own_curve:  # far from the calibrated model the linear prediction overshoots
        starts = [centre, at_prior_means(problem.unknowns, placed, centre), *starts]
    # a law with many parameters begins at plausible values, and elsewhere only where that explains too little
    begins_at_centre = len(score.x) > MOST_ON_GRID and not isinstance(candidate, FreeTerm)
    if begins_at_centre:
        starts.insert(0, centre)
    grid_starts = []
    is_large = score.predicted_gain > MIN_RESTARTED_SHARE * baseline.excess
    if score.point is not None and is_large:
        grid_starts = [np.concatenate([start[:count], score.point]) for start in starts[-2:]]
    best: EvaluatedFit | None = None
    distorted = baseline.fit.is_distorted
    while starts:
        start = starts.pop(0)
        try:
            rule = _give_up_rule(baseline.cost, reached, CHECKED_STEPS)
            found = fit_coarse(problem, start, resolution.coarse, max_steps, rule, may_update=not is_own_curve)
        except FitError:
            found = None
        if found is not None and (best is None or found.log_evidence > best.log_evidence):
            best = found
        has_failed = best is None or best.cost > baseline.cost
        if has_failed and start is calibrated_start and not isinstance(candidate, FreeTerm):
            starts.insert(0, _with_small_size(problem, score, calibrated_start))
            continue
        achieved = 0.0 if best is None else baseline.cost - best.cost
        if begins_at_centre and start is centre and achieved <= NEARLY_ALL_SHARE * baseline.excess:
            continue
        if not starts and grid_starts and achieved < MIN_ACHIEVED_FALL_SHARE * score.predicted_gain:
            starts, grid_starts = grid_starts, []
        if distorted and achieved > 0.5 * baseline.excess:
            break
        if best is not None and not distorted and (
            reached > 0.0 or achieved > MIN_ACHIEVED_FALL_SHARE * score.predicted_gain
        ):
            break
    if best is not None and is_large and baseline.cost - best.cost < MIN_ACHIEVED_FALL_SHARE * score.predicted_gain:
        best = fit_across_minima(best, resolution.coarse)
    return Trial.failed(score) if best is None else Trial.failed(score).with_fit(baseline, best)


def _try_irregular(
    baseline: EvaluatedFit, problem: FitProblem, starts: list[np.ndarray], score: Score, resolution: TimeResolution,
    max_steps: int, reached: float,
) -> Trial:  # fmt: skip
    """The trial of a candidate where the signals depend irregularly on the unknowns; arguments as in `try_candidate`.

    The first start is the centre of the candidate's prior: an ensemble finds the way from a large effect to a small
    one, but not from one that is too small to matter. Where that brings less than predicted, the second one follows,
    from the score test, and where all end above the model without the candidate, one of so small a size that it begins
    there.
    """
    calibrated_start, trial = starts[1], Trial.failed(score)
    while starts:
        start = starts.pop(0)
        rule = _give_up_rule(baseline.cost, reached, CHECKED_ENSEMBLES)
        try:
            found = fit_coarse(problem, start, resolution.coarse, max_steps, rule)
        except FitError:
            continue
        if trial.evaluated is None or found.log_evidence > trial.evaluated.log_evidence:
            trial = trial.with_fit(baseline, found)
        if baseline.cost - found.cost > score.predicted_gain:
            break
        has_failed = start is calibrated_start and trial.evaluated.cost > baseline.cost
        if has_failed and not isinstance(score.candidate, FreeTerm):
            starts.append(_with_small_size(problem, score, start))
    return trial


def _with_small_size(problem: FitProblem, score: Score, start: np.ndarray) -> np.ndarray:
    """A start (n,) at which the candidate of a score is hardly felt."""
    count = len(start) - len(score.x)
    return np.append(start[:count], with_scaled_size(problem.unknowns[count:], score.x, SMALL_SIZE, score.exponent))


def _give_up_rule(baseline_cost: float, reached: float, checked: Mapping[int, float]) -> Callable[[int, float], bool]:
    """Whether a fit goes on, asked after every step with its number and ½χ²; see `CHECKED_STEPS`."""
    costs: list[float] = []

    def keep_on(step: int, cost: float) -> bool:
        costs.append(cost)
        if step not in checked:
            return True
        soon = cost - (costs[-1 - FALL_STEPS] - cost)
        return baseline_cost - soon >= checked[step] * reached

    return keep_on


def try_best_candidates(
    baseline: EvaluatedFit, accepted: Sequence[Candidate], scores: Sequence[Score], resolution: TimeResolution,
    report: Callable[[str], None], reached: float = 0.0, max_trials: int = MAX_TRIALS, workers: Workers | None = None,
) -> list[Trial]:  # fmt: skip
    """Try the candidates with the largest predicted fall of χ², until the others predict too little.

    On workers all are tried at once, so that none is given up early; those that would not have been tried without
    workers are left out.

    Args:
        baseline: the model without the candidates.
        accepted: candidates that `baseline` has already.
        scores: score tests, the largest predicted fall of χ² first.
        resolution: coarse and fine time steps per sample.
        report: called with a sentence on the progress.
        reached: fall of ½χ² that other candidates have achieved already.
        max_trials: largest number of trials.
        workers: processes for the trials; None for this one.
    """
    trials: list[Trial] = []
    is_near = baseline.excess < NEAR_EXCESS * 0.5 * baseline.samples and not baseline.fit.is_distorted
    least = MIN_NEAR_SHARE * baseline.excess if is_near else 0.0
    is_irregular = baseline.fit.problem.is_irregular
    least_fall = MIN_IRREGULAR_FALL if is_irregular else MIN_CHI_SQUARE_FALL
    share = MIN_NEAR_RIVAL_SHARE if is_near else MIN_RIVAL_GAIN_SHARE
    most = MAX_IRREGULAR_TRIALS if is_irregular else max_trials
    tried = [score for score in scores[:most] if score.chi_square_fall >= least_fall]

    def is_enough(score: Score) -> bool:
        # the prediction is linear: where one fit gains far more than predicted, others may gain more too
        return score.predicted_gain >= max(share * min(reached, scores[0].predicted_gain), least)

    at_once: list[Trial] = []
    if workers is not None and (tried := list(itertools.takewhile(is_enough, tried))):
        report(f"trying {', '.join(score.candidate.name for score in tried)} on the workers")
        jobs = [(baseline, accepted, score, resolution, TRIAL_STEPS, reached) for score in tried]
        at_once = workers.map(try_candidate, jobs)
    for k, score in enumerate(tried):
        if not is_enough(score):
            break
        if not at_once:
            report(f"trying {score.candidate.name}: predicted fall of χ² {score.chi_square_fall:.0f}")
        trial = at_once[k] if at_once else try_candidate(baseline, accepted, score, resolution, TRIAL_STEPS, reached)
        trials.append(trial)
        if trial.evaluated is not None:
            reached = max(reached, baseline.cost - trial.evaluated.cost)
    return trials


def retry_progressively(
    baseline: EvaluatedFit, accepted: Sequence[Candidate], trial: Trial, resolution: TimeResolution
) -> Trial:
    """Repeat a trial on growing fractions of the runs; unchanged where that finds no better fit.

    Where the machine resonates or cavitates, the cost of whole runs has many local minima.

    Args:
        baseline: the model without the candidate.
        accepted: candidates that `baseline` has already.
        trial: the trial to improve.
        resolution: coarse and fine time steps per sample.
    """
    problem = with_candidate(baseline.fit.problem, accepted, trial.candidate)
    scanned = len(trial.score.x)
    calibrated = np.concatenate([start_coordinates(problem, baseline.fit.values)[:-scanned], trial.score.x])
    prior_start = at_prior_means(problem.unknowns, (*accepted, trial.candidate), calibrated)
    starts = np.array([prior_start] if trial.evaluated is None else [trial.evaluated.fit.x, prior_start])
    found = fit_progressively(problem, starts, scanned, resolution.coarse, TRIAL_STEPS, trial.evaluated)
    return trial if found is None else trial.with_fit(baseline, found)
