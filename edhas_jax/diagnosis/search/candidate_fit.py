"""The fit of a model with one more candidate, from several starts."""

from collections.abc import Callable, Sequence

import numpy as np

from edhas_jax.diagnosis.calibration.fit_problem import FitError, FitProblem
from edhas_jax.diagnosis.search.candidates import MOST_ON_GRID, Candidate, at_prior_means, with_candidate
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit, fit_coarse, start_coordinates
from edhas_jax.diagnosis.search.free_term import FreeTerm
from edhas_jax.diagnosis.search.local_minima import fit_across_minima
from edhas_jax.diagnosis.search.screening import SMALL_SIZE, Score, with_scaled_size
from edhas_jax.measurements.time_resolution import TimeResolution

CANDIDATE_STEPS = 12  # maximum number of Levenberg-Marquardt steps
MIN_ACHIEVED_FALL_SHARE = 0.3  # of the predicted fall of χ²: a fit that achieves less is restarted elsewhere
MIN_RESTARTED_SHARE = 0.2  # of the misfit, predicted: a candidate with less is not restarted from its grid point
NEARLY_ALL_SHARE = 0.7  # of the excess of χ²: below it the fit may have ended in a local minimum
# a fit is given up where, after so many steps, it is above the model without the candidate and would be so after as
# many nats more as the last `FALL_STEPS` steps have brought
CHECKED_STEPS, CHECKED_ENSEMBLES, FALL_STEPS = (4, 7), (12, 16), 2


def fit_with_candidate(
    baseline: EvaluatedFit, accepted: Sequence[Candidate], score: Score, resolution: TimeResolution, max_steps: int
) -> EvaluatedFit | None:
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

    Returns:
        The fit with the largest log-evidence; None where the model fails from every start.
    """
    fitted, candidate = baseline.fit, score.candidate
    problem = with_candidate(fitted.problem, accepted, candidate)
    centre = start_coordinates(problem, fitted.values)  # of the priors of the candidate; a free term has no influence
    count, placed = len(centre) - len(score.x), (*accepted, candidate)
    calibrated_start = np.append(centre[:count], score.x)
    if problem.is_irregular:
        return _fit_irregular(baseline, problem, [centre, calibrated_start], score, resolution, max_steps)
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
            rule = _give_up_rule(baseline.cost, CHECKED_STEPS)
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
        if best is not None and not distorted and achieved > MIN_ACHIEVED_FALL_SHARE * score.predicted_gain:
            break
    if best is not None and is_large and baseline.cost - best.cost < MIN_ACHIEVED_FALL_SHARE * score.predicted_gain:
        best = fit_across_minima(best, resolution.coarse)
    return best


def _fit_irregular(
    baseline: EvaluatedFit, problem: FitProblem, starts: list[np.ndarray], score: Score, resolution: TimeResolution,
    max_steps: int,
) -> EvaluatedFit | None:  # fmt: skip
    """As `fit_with_candidate`, for a model whose signals depend irregularly on its unknowns.

    The first start is the centre of the candidate's prior: an ensemble finds the way from a large effect to a small
    one, but not from one that is too small to matter. Where that brings less than predicted, the second one follows,
    from the score test, and where all end above the model without the candidate, one of so small a size that it begins
    there.
    """
    calibrated_start, best = starts[1], None
    while starts:
        start = starts.pop(0)
        rule = _give_up_rule(baseline.cost, CHECKED_ENSEMBLES)
        try:
            found = fit_coarse(problem, start, resolution.coarse, max_steps, rule)
        except FitError:
            continue
        if best is None or found.log_evidence > best.log_evidence:
            best = found
        if baseline.cost - found.cost > score.predicted_gain:
            break
        has_failed = start is calibrated_start and best.cost > baseline.cost
        if has_failed and not isinstance(score.candidate, FreeTerm):
            starts.append(_with_small_size(problem, score, start))
    return best


def _with_small_size(problem: FitProblem, score: Score, start: np.ndarray) -> np.ndarray:
    """A start (n,) at which the candidate of a score is hardly felt."""
    count = len(start) - len(score.x)
    return np.append(start[:count], with_scaled_size(problem.unknowns[count:], score.x, SMALL_SIZE, score.exponent))


def _give_up_rule(baseline_cost: float, checked: Sequence[int]) -> Callable[[int, float], bool]:
    """Whether a fit goes on, asked after every step with its number and ½χ²; see `CHECKED_STEPS`."""
    costs: list[float] = []

    def keep_on(step: int, cost: float) -> bool:
        costs.append(cost)
        if step not in checked:
            return True
        soon = cost - (costs[-1 - FALL_STEPS] - cost)
        return soon <= baseline_cost

    return keep_on
