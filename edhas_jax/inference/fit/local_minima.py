"""Fits for a cost with many local minima: progressively longer parts of the runs, or ensemble derivatives.

The effect of a wrong parameter accumulates along a run, and quickly so where a motion resonates, cavitates or sticks.
Far from the solution the cost of whole runs therefore has many local minima, while that of their beginnings is smooth.
In a progressive fit, the beginnings of all runs are fitted first, then larger and larger fractions of them. Each
fraction brings the fit into the region in which the cost of the next one is smooth.

Where valves bounce, or static friction almost stops the mover, the cost also has many local minima close to a
solution. The derivatives at one of them do not show in which direction the cost is lower elsewhere. The slopes of a
linear regression over an ensemble of scattered points do, because they average over these minima.

Source: progressive fitting of trajectories, e.g. Voss, Timmer, Kurths, Int. J. Bifurcation Chaos 14 (2004) 1905; for
the ensemble see `ensemble_search`.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from edhas_jax.inference.fit.ensemble_search import minimise_by_ensemble
from edhas_jax.inference.fit.evaluated_fit import EvaluatedFit, find_minima, fit_coarse
from edhas_jax.inference.fit.fit_problem import FitError, FitProblem
from edhas_jax.inference.fit.starts import spread_points
from edhas_jax.measurements.campaign import BenchRun
from edhas_jax.measurements.measurement_model import EvaluationPoint
from edhas_jax.measurements.residuals import normalised_residuals
from edhas_jax.measurements.time_resolution import choose_time_resolution

RUN_FRACTIONS = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2)
SCAN_STAGE, RESOLUTION_STAGE = 1, 3  # indices of the fractions used for the scan, and to choose the time step
MIN_RUN_SAMPLES = 20  # of a run at any fraction
SCAN_POINTS, SCAN_POINTS_1D = 64, 25  # evaluated for several unknowns, and for a single one
SCAN_HALF_WIDTH = 3.0  # in standard deviations of the prior
STARTS_KEPT = 3  # best points of a stage that start the next one
# of the whole-run fit's excess: a fraction fitted alone that leaves more gives up; the shortest ones say too little
MAX_RELATIVE_EXCESS = (np.inf, np.inf, 0.5, 0.5, 0.5)
MIN_EXCESS_SIGMAS = 10.0  # excess of χ² above which the residual of a fraction is significant
MAX_ENSEMBLE_STEPS = 12  # maximum number of steps of the ensemble, and of the Levenberg-Marquardt fit that follows
# the ensemble fit stops if its last COMPARED_STEPS steps together lower ½χ² by no more than the larger of two limits:
# MIN_FALL [nats], and MIN_FALL_SHARE of the excess of ½χ² at its start
COMPARED_STEPS, MIN_FALL, MIN_FALL_SHARE = 3, 2.0, 0.02


def fit_progressively(
    problem: FitProblem, starts: np.ndarray, scanned: int, steps_per_sample: int, max_steps: int,
    whole: EvaluatedFit | None = None,
) -> EvaluatedFit | None:  # fmt: skip
    """Fit growing fractions of all runs, and finally the whole runs.

    First the last `scanned` unknowns are scanned around the last start, because a derivative says little about the
    size at which, for example, a valve sticks. The fit is given up early where it cannot improve on `whole`: where the
    beginnings of the runs, fitted alone, are not fitted clearly better than by `whole`.

    Args:
        problem: what is fitted.
        starts: coordinates (k, n) of the starts.
        scanned: number of unknowns, at the end of the list, that are scanned.
        steps_per_sample: minimum number of time steps per sample.
        max_steps: maximum number of Levenberg-Marquardt steps of each stage.
        whole: a fit of the whole runs that is to be improved.

    Returns:
        The fit of the whole runs; None where the model fails, or where the log-evidence of `whole` is not exceeded.
    """
    runs, starts = problem.model().runs, np.atleast_2d(starts)
    rough = dataclasses.replace(problem, solver_error=None)  # it holds for one time step only
    stages = [_truncate_runs(rough, runs, fraction) for fraction in RUN_FRACTIONS]
    excesses = [np.inf if whole is None else _excess_of_fit(whole, stage) for stage in stages]
    if excesses[-1] < MIN_EXCESS_SIGMAS:
        return None
    x = np.concatenate([starts, _scan(stages[SCAN_STAGE], starts[-1], scanned, steps_per_sample)])
    resolution = choose_time_resolution(stages[RESOLUTION_STAGE].model(), x[len(starts)])
    whole_steps, steps_per_sample = steps_per_sample, max(steps_per_sample, resolution.coarse)
    prior = np.array([float(u.has_prior) for u in problem.unknowns])
    for stage, excess, limit in zip(stages, excesses, MAX_RELATIVE_EXCESS, strict=True):
        found = find_minima(stage, x, steps_per_sample, max_steps)
        x = found.x[np.argsort(found.model.cost)[:STARTS_KEPT]]
        best = 2.0 * found.model.cost.min() - prior @ np.square(x[0])
        not_improved = excess > MIN_EXCESS_SIGMAS and _excess_sigmas(best, stage) > limit * excess
        if not np.isfinite(best) or not_improved:
            return None
    try:
        end = fit_coarse(problem, x[0], whole_steps, max_steps)
    except FitError:
        return None
    return end if whole is None or end.log_evidence > whole.log_evidence else None


def _truncate_runs(problem: FitProblem, runs: Sequence[BenchRun], fraction: float) -> FitProblem:
    """The same problem with the first `fraction` of each run."""
    truncated = []
    for run in runs:
        count = min(max(round(fraction * len(run.time)), MIN_RUN_SAMPLES), len(run.time))
        signals = {name: values[:count] for name, values in run.signals.items()}
        truncated.append(dataclasses.replace(run, time=run.time[:count], signals=signals, lines=run.lines[:count]))
    return dataclasses.replace(problem, runs=tuple(truncated))


def _scan(stage: FitProblem, around: np.ndarray, scanned: int, steps_per_sample: int) -> np.ndarray:
    """The best points (STARTS_KEPT, n) of a scan of the last `scanned` unknowns, the others fixed as in `around`."""
    if scanned == 1:
        grid = np.linspace(-SCAN_HALF_WIDTH, SCAN_HALF_WIDTH, SCAN_POINTS_1D)[:, None]
    else:
        grid = spread_points(scanned, SCAN_POINTS, SCAN_HALF_WIDTH)
    low, high = np.array([u.bounds() for u in stage.unknowns[-scanned:]]).T
    rows = np.tile(around, (len(grid), 1))
    rows[:, -scanned:] = np.clip(grid, low, high)
    model = stage.model()
    run_indices = tuple(range(len(model.runs)))
    points = [EvaluationPoint(row, run_indices) for row in rows]
    squares = [
        sum(
            _chi_square(normalised_residuals(stage.campaign, run, predicted[r]), run)
            for r, run in enumerate(model.runs)
        )
        for predicted in model.predict(points, steps_per_sample, with_sensitivities=False)
    ]
    return rows[np.argsort(squares)[:STARTS_KEPT]]


def _excess_of_fit(whole: EvaluatedFit, stage: FitProblem) -> float:
    """The excess of χ² of a whole-run fit over the runs of a stage, in standard deviations."""
    return _excess_sigmas(sum(_chi_square(whole.residuals[run.name], run) for run in stage.runs), stage)


def _chi_square(residuals: Mapping[str, np.ndarray], run: BenchRun) -> float:
    """χ² of residuals over the samples of `run`; infinite where the model failed."""
    with np.errstate(over="ignore"):
        rows = [residuals[n][: len(v)][np.isfinite(v)] for n, v in run.signals.items()]
        total = sum(float(np.sum(np.square(row))) for row in rows)
    return total if np.isfinite(total) else np.inf


def _excess_sigmas(chi_square: float, stage: FitProblem) -> float:
    """The excess of χ² over its expectation under noise alone, in standard deviations of χ²."""
    samples = sum(run.valid_samples for run in stage.runs)
    return (chi_square - samples) / np.sqrt(2.0 * max(samples, 1))


def fit_across_minima(found: EvaluatedFit, steps_per_sample: int) -> EvaluatedFit:
    """Continue a fit with derivatives from an ensemble of points, then, if ½χ² has clearly fallen, with ordinary ones.

    Args:
        found: the fit.
        steps_per_sample: time steps per sample.

    Returns:
        The new fit; `found` itself if the new one is not clearly better.
    """
    problem, costs = found.fit.problem, [found.cost]
    least_fall = max(MIN_FALL, MIN_FALL_SHARE * found.excess)

    def keep_on(step: int, cost: float) -> bool:
        costs.append(cost)
        return step < COMPARED_STEPS or costs[-1 - COMPARED_STEPS] - cost > least_fall

    end = minimise_by_ensemble(problem, found.fit.x, steps_per_sample, MAX_ENSEMBLE_STEPS, keep_on)
    if end is None or not end.model.cost[0] < found.cost - least_fall:
        return found
    try:
        again = fit_coarse(problem, end.x, steps_per_sample, MAX_ENSEMBLE_STEPS)
    except FitError:
        return found
    return again if again.log_evidence > found.log_evidence + least_fall else found
