"""Correction of the time stamps of records that start early or late, or whose clock is wrong.

The error of a run's time is a sum of Legendre polynomials over its record: the start of the record (degree 0), the rate
of the clock (degree 1), and changes of the rate. The columns of the fit are linear in the time error, which is accurate
only for errors of a small part of a sample interval; corrected time stamps have no such limit.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.polynomial import legendre
from scipy.interpolate import CubicSpline

from edhas_jax.inference.fit.fit_problem import FitProblem, TimeError, quadratic_model
from edhas_jax.inference.likelihood.bench_deviations import BenchDeviations, DeviationKind, record_position
from edhas_jax.inference.likelihood.bench_estimate import BenchEstimate, EstimatedDeviation
from edhas_jax.inference.likelihood.symmetric_matrices import regularised_inverse
from edhas_jax.measurements.campaign import BenchRun, Campaign
from edhas_jax.measurements.measurement_model import PredictedSignals

SIGNIFICANT = 3.0  # standard deviations of an estimated coefficient from which the time of a run is corrected
MIN_GAIN = 10.0  # nats of ½χ² by which corrected time stamps have to be better than others
TIME_KINDS = DeviationKind.TRIGGER, DeviationKind.CLOCK


def estimated_time_errors(estimate: BenchEstimate, bench: BenchDeviations) -> dict[str, TimeError]:
    """The time error of each run as Legendre coefficients [s], by run.

    The start of the record counts where it is significant, and the clock where any of its coefficients is; otherwise
    their coefficients are 0.
    """
    of_runs: dict[str, list[EstimatedDeviation]] = {}
    for row in estimate.deviations(bench):
        if row.deviation.kind in TIME_KINDS:
            of_runs.setdefault(row.run, []).append(row)
    found = {}
    for run, rows in of_runs.items():
        significant = {row.deviation.kind for row in rows if abs(row.value) > SIGNIFICANT * row.std}
        coefficients = [0.0] * (1 + max(row.deviation.degree for row in rows))
        for row in rows:
            if row.deviation.kind in significant:
                coefficients[row.deviation.degree] = row.value * row.deviation.std
        found[run] = tuple(coefficients)
    return found


def with_time_errors(problem: FitProblem, estimate: BenchEstimate) -> list[EstimatedDeviation]:
    """The estimated deviations of a bench; for trigger and clock the sum of correction and remaining estimate.

    The clock of a run is one deviation, whose value is the largest time error within the run.
    """
    found, clocks = [], {}
    for row in estimate.deviations(problem.bench):
        deviation, corrected = row.deviation, problem.time_errors.get(row.run, ())
        if deviation.kind in TIME_KINDS and deviation.degree < len(corrected):
            row = row._replace(value=row.value + corrected[deviation.degree] / deviation.std)
        (clocks.setdefault(row.run, []) if deviation.kind is DeviationKind.CLOCK else found).append(row)
    for run in problem.campaign.runs:
        if rows := clocks.get(run.name):
            sizes = legendre.legval(record_position(run), np.array([0.0, *(row.value for row in rows)]))
            largest = float(sizes[np.argmax(np.abs(sizes))])
            found.append(rows[0]._replace(value=largest, std=max(row.std for row in rows)))
    return found


def time_error(run: BenchRun, coefficients: TimeError) -> np.ndarray:
    """The error (samples,) [s] of the time stamps of a run."""
    return legendre.legval(record_position(run), np.array(coefficients or (0.0,)))


def largest_time_error(campaign: Campaign, errors: Mapping[str, TimeError]) -> float:
    """The largest size [s] of the time errors of the runs of a campaign."""
    return max((float(np.abs(time_error(run, errors.get(run.name, ()))).max()) for run in campaign.runs), default=0.0)


def added(errors: Mapping[str, TimeError], further: Mapping[str, TimeError]) -> dict[str, TimeError]:
    """The sums of time errors, by run."""
    return {
        run: tuple(legendre.legadd(errors.get(run, ()) or (0.0,), further.get(run, ()) or (0.0,)).tolist())
        for run in {**errors, **further}
    }


def with_corrected_time(campaign: Campaign, errors: Mapping[str, TimeError]) -> Campaign:
    """The campaign with time errors added to its time stamps; samples then before the start of a run become NaN.

    Args:
        campaign: the measurements.
        errors: coefficients [s] of the time error, by run.
    """
    runs = tuple(_corrected(run, errors.get(run.name, ())) for run in campaign.runs)
    return dataclasses.replace(campaign, runs=runs)


def _corrected(run: BenchRun, coefficients: TimeError) -> BenchRun:
    time = run.time + time_error(run, coefficients)
    signals = {n: np.where(time >= 0.0, values, np.nan) for n, values in run.signals.items()}
    return dataclasses.replace(run, time=time, signals=signals)


def best_common_shift(
    problem: FitProblem, x: np.ndarray, outcomes: Sequence[PredictedSignals], grid: Sequence[float],
    min_gain: float = 0.0,
) -> float:  # fmt: skip
    """The time [s] by which all records start late, among those of a grid; 0 where none is clearly better.

    The predicted signals are interpolated at the shifted times, and the unknowns adjusted linearly: no simulation is
    needed.

    Args:
        problem: the fit problem.
        x: coordinates of its unknowns (n,) at the fit.
        outcomes: signals and sensitivities of its runs there.
        grid: shifts [s] to compare with 0.
        min_gain: fall of ½χ² that counts as clear, at least `MIN_GAIN`.
    """
    names = [run.name for run in problem.model().runs]
    costs = {
        shift: cost_with_time_errors(problem, x, outcomes, dict.fromkeys(names, (shift,))) for shift in (0.0, *grid)
    }
    best = min(costs, key=costs.__getitem__)
    return best if costs[0.0] - costs[best] > max(MIN_GAIN, min_gain) else 0.0


def cost_with_time_errors(
    problem: FitProblem, x: np.ndarray, outcomes: Sequence[PredictedSignals], errors: Mapping[str, TimeError]
) -> float:  # fmt: skip
    """½χ² after a linear step of the unknowns, with time errors added to the time stamps.

    Args:
        problem: the fit problem.
        x: coordinates of its unknowns (n,) at the fit.
        outcomes: signals and sensitivities of its runs there.
        errors: coefficients [s] of the time error, by run.
    """
    corrected = []
    for run, outcome in zip(problem.model().runs, outcomes, strict=True):
        if not any(errors.get(run.name, ())):
            corrected.append(outcome)
            continue
        at = np.clip(run.time + time_error(run, errors[run.name]), run.time[0], run.time[-1])
        values = {n: CubicSpline(run.time, v)(at) for n, v in outcome.values.items()}
        slopes = {n: CubicSpline(run.time, v)(at) for n, v in outcome.sensitivities.items()}
        corrected.append(PredictedSignals(values, slopes))
    model = quadratic_model(problem, x, problem.equations(corrected))
    gradient = model.gradient[0]
    return float(model.cost[0] - 0.5 * gradient @ regularised_inverse(model.curvature[0]) @ gradient)
