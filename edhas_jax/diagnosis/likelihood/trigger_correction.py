"""Correction of records that start earlier or later than the run: their time axis is shifted.

As a column of the fit the shift is linear, which is right for a small part of a sample interval only.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from edhas_jax.diagnosis.calibration.fit_problem import FitProblem, quadratic_model
from edhas_jax.diagnosis.calibration.symmetric_matrices import regularised_inverse
from edhas_jax.diagnosis.likelihood.bench_deviations import BenchDeviations, DeviationKind
from edhas_jax.diagnosis.likelihood.bench_estimate import BenchEstimate
from edhas_jax.measurements.campaign import BenchRun, Campaign
from edhas_jax.measurements.measurement_model import PredictedSignals

SIGNIFICANT = 3.0  # standard deviations of an estimated shift from which it is corrected
MIN_GAIN = 10.0  # nats from which a common shift is clearly better than none


def trigger_shifts(estimate: BenchEstimate, bench: BenchDeviations) -> dict[str, float]:
    """The time [s] by which the record of each run starts late, by run; 0 where it is not significant."""
    found = {}
    for row in estimate.deviations(bench):
        if row.deviation.kind is DeviationKind.TRIGGER:
            significant = abs(row.value) > SIGNIFICANT * row.std
            found[row.run] = row.value * row.deviation.std if significant else 0.0
    return found


def with_shifted_time(campaign: Campaign, shifts: Mapping[str, float]) -> Campaign:
    """The campaign with times added to the time stamps of its runs; samples before the start of a run are left out.

    Args:
        campaign: the measurements.
        shifts: time [s] to add, by run.
    """
    runs = tuple(_shifted(run, shifts.get(run.name, 0.0)) for run in campaign.runs)
    return dataclasses.replace(campaign, runs=runs)


def _shifted(run: BenchRun, shift: float) -> BenchRun:
    time = run.time + shift
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
    costs = {
        shift: cost_with_shifts(problem, x, outcomes, dict.fromkeys((run.name for run in problem.model().runs), shift))
        for shift in (0.0, *grid)
    }
    best = min(costs, key=costs.__getitem__)
    return best if costs[0.0] - costs[best] > max(MIN_GAIN, min_gain) else 0.0


def cost_with_shifts(
    problem: FitProblem, x: np.ndarray, outcomes: Sequence[PredictedSignals], shifts: Mapping[str, float]
) -> float:  # fmt: skip
    """½χ² after a linear step of the unknowns, if records start late.

    Args:
        problem: the fit problem.
        x: coordinates of its unknowns (n,) at the fit.
        outcomes: signals and sensitivities of its runs there.
        shifts: time [s] by which the record of each run starts late, by run.
    """
    shifted = []
    for run, outcome in zip(problem.model().runs, outcomes, strict=True):
        if not (shift := shifts.get(run.name, 0.0)):
            shifted.append(outcome)
            continue
        at = np.clip(run.time + shift, run.time[0], run.time[-1])
        values = {n: CubicSpline(run.time, v)(at) for n, v in outcome.values.items()}
        slopes = {n: CubicSpline(run.time, v)(at) for n, v in outcome.sensitivities.items()}
        shifted.append(PredictedSignals(values, slopes))
    model = quadratic_model(problem, x, problem.equations(shifted))
    gradient = model.gradient[0]
    return float(model.cost[0] - 0.5 * gradient @ regularised_inverse(model.curvature[0]) @ gradient)
