"""What the bench did: the estimated deviations of triggers, settings and sensors, and the residuals without them."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.inference.likelihood.bench_deviations import BenchDeviations, Deviation, DeviationKind, deviation_columns
from edhas_jax.inference.likelihood.run_equations import RunEquations, bounded, run_columns
from edhas_jax.inference.likelihood.symmetric_matrices import regularised_inverse
from edhas_jax.measurements.campaign import BenchRun, Campaign
from edhas_jax.measurements.measurement_model import PredictedSignals
from edhas_jax.measurements.residuals import normalised_residuals
from edhas_jax.measurements.unknown_parameters import UnknownParameter

# relative sizes of a deviation of a bench: a filter passes between all and nothing of what changes fast, the columns of
# a setting hold for small changes of its logarithm, and a sensor that is off by more is broken
POSSIBLE_SIZES = {
    DeviationKind.FILTER: (0.0, 1.0), DeviationKind.SETTING: (-0.3, 0.3), DeviationKind.GAIN: (-0.5, 0.5),
}  # fmt: skip
POSSIBLE_ERRORS = 3.0  # standard errors by which an estimate may be outside


class EstimatedDeviation(NamedTuple):
    """One deviation with its estimate, both in units of its accuracy `deviation.std`.

    Args:
        deviation: what deviates.
        run: the run, or empty for a sensor.
        value: estimate over the accuracy.
        std: posterior standard deviation over the accuracy.
    """

    deviation: Deviation
    run: str
    value: float
    std: float

    @property
    def is_possible(self) -> bool:
        """Whether a bench can do that: else the linear columns stand in for something that the model lacks."""
        low, high = POSSIBLE_SIZES.get(self.deviation.kind, (-math.inf, math.inf))
        size, margin = self.value * self.deviation.std, POSSIBLE_ERRORS * self.std * self.deviation.std
        return low - margin <= size <= high + margin


@dataclasses.dataclass(frozen=True)
class BenchEstimate:
    """The estimated deviations of a bench, in units of their prior standard deviations.

    Args:
        of_sensors: estimate and standard deviation (sensors' deviations, 2).
        of_runs: the same (deviations of a run, 2), by run.
    """

    of_sensors: np.ndarray
    of_runs: Mapping[str, np.ndarray]

    @property
    def has_deviations(self) -> bool:
        """Whether anything of the bench may deviate."""
        return self.of_sensors.size > 0 or any(values.size > 0 for values in self.of_runs.values())

    def deviations(self, bench: BenchDeviations) -> list[EstimatedDeviation]:
        """All deviations with their estimates, those of the sensors first.

        Args:
            bench: the deviations that were estimated.
        """
        rows = [("", bench.of_sensors, self.of_sensors)]
        rows += [(run, bench.of_runs, values) for run, values in self.of_runs.items()]
        return [
            EstimatedDeviation(deviation, run, float(value / deviation.tightening), float(std / deviation.tightening))
            for run, deviations, values in rows
            for deviation, (value, std) in zip(deviations, values, strict=True)
        ]


def estimate_bench(
    campaign: Campaign, fitted: Sequence[BenchRun], others: Sequence[BenchRun],
    predicted: Mapping[str, PredictedSignals], unknowns: Sequence[UnknownParameter], bench: BenchDeviations,
    equations: Sequence[RunEquations],
) -> tuple[BenchEstimate, dict[str, dict[str, np.ndarray]]]:  # fmt: skip
    """Estimate the deviations of a bench at a fit, and remove them from the residuals.

    The deviations of sensors are estimated from the fitted runs, those of a run from that run itself.

    Args:
        campaign: noise of the signals.
        fitted: the fitted runs.
        others: all other runs.
        predicted: signals and sensitivities at the fit by run.
        unknowns: unknowns of these sensitivities.
        bench: the deviations.
        equations: normal equations of the fitted runs.

    Returns:
        The estimates, and (measured − model − deviations)/noise by run and signal (samples,).
    """
    common, spread = _common_estimate(equations, len(unknowns), bench.count)
    own_estimates = {}
    residuals = {}
    for run in (*fitted, *others):
        outcome = bounded(run, predicted[run.name])
        columns, own = run_columns(campaign, run, outcome, unknowns, bench)
        shift = columns[:, own + len(unknowns) : -1] @ common
        with np.errstate(over="ignore", invalid="ignore"):
            covariance = regularised_inverse(np.eye(own) + columns[:, :own].T @ columns[:, :own])
            values = covariance @ (columns[:, :own].T @ (columns[:, -1] - shift))
        values = np.nan_to_num(values)
        own_estimates[run.name] = np.column_stack([values, np.sqrt(np.diag(covariance))])
        model = {}
        for name in run.signals:
            local = deviation_columns(bench.of_runs, run, name, outcome, unknowns) @ values
            of_sensors = deviation_columns(bench.of_sensors, run, name, outcome, unknowns) @ common
            model[name] = outcome.values[name] + local + of_sensors
        residuals[run.name] = normalised_residuals(campaign, run, PredictedSignals(model, None))
    return BenchEstimate(np.column_stack([common, spread]), own_estimates), residuals


def _common_estimate(equations: Sequence[RunEquations], unknowns: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Estimates (count,) of the sensors' deviations at the fit, and their standard deviations; in prior units."""
    total = np.sum([e.gram for e in equations], axis=0)
    place = slice(unknowns, unknowns + count)
    covariance = regularised_inverse(np.eye(count) + total[place, place])
    values = covariance @ total[place, -1]
    return np.nan_to_num(values), np.sqrt(np.nan_to_num(np.diag(covariance)))
