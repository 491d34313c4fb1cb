"""The calibrated model of a diagnosis as plain data and arrays, from which it is restored without any fit.

A fit problem is not stored: it follows from the campaign.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.calibration.unpredictable_part import with_unpredictable_part
from edhas_jax.diagnosis.likelihood.bench_estimate import BenchEstimate
from edhas_jax.diagnosis.likelihood.residual_outliers import without_missing
from edhas_jax.diagnosis.likelihood.time_correction import with_clock_error, with_corrected_time
from edhas_jax.diagnosis.search.candidates import build_problem
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.measurement_model import PredictedSignals
from edhas_jax.measurements.time_resolution import TimeResolution

Plain = dict[str, Any]


class StageEncoder:
    """Turns parts of a diagnosis into plain data; `arrays` collects the arrays that it refers to by name."""

    def __init__(self):
        self.arrays: dict[str, np.ndarray] = {}

    def start(self, start: tuple[EvaluatedFit, TimeResolution]) -> Plain:
        """The calibrated model and the time steps."""
        return {"fit": self.fit(start[0]), "resolution": list(start[1])}

    def fit(self, evaluated: EvaluatedFit) -> Plain:
        """A fit with its residuals."""
        fit = evaluated.fit
        return {
            "x": self._put(fit.x), "uncorrected": self._put(fit.uncorrected), "covariance": self._put(fit.covariance),
            "costs": self._put(fit.costs), "cost": fit.cost, "converged": fit.converged,
            "resolution": list(fit.resolution),
            "outcomes": [[self._table(o.values), self._table(o.sensitivities)] for o in fit.outcomes],
            "residuals": {run: self._table(rows) for run, rows in evaluated.residuals.items()},
            "time_errors": {run: list(of) for run, of in fit.problem.time_errors.items()},
            "clock_error": fit.problem.campaign.accuracy.clock_error,
            "tightening": fit.problem.campaign.tightening, "unpredictable": fit.problem.campaign.unpredictable,
            "sensors": self._put(evaluated.bench.of_sensors), "runs": self._table(evaluated.bench.of_runs),
            "solver_error": (
                None
                if fit.problem.solver_error is None
                else {run: self._table(rows) for run, rows in fit.problem.solver_error.items()}
            ),
        }  # fmt: skip

    def _table(self, rows: Mapping[str, np.ndarray] | None) -> dict[str, str] | None:
        return None if rows is None else {name: self._put(values) for name, values in rows.items()}

    def _put(self, values: np.ndarray) -> str:
        name = f"array_{len(self.arrays)}"
        self.arrays[name] = np.asarray(values, float)
        return name


@dataclasses.dataclass(frozen=True)
class StageDecoder:
    """Restores parts of a diagnosis; the counterpart of `StageEncoder`.

    Attributes:
        campaign: the campaign of the diagnosis.
        arrays: the arrays of the stage by name.
    """

    campaign: Campaign
    arrays: Mapping[str, np.ndarray]

    def start(self, plain: Plain) -> tuple[EvaluatedFit, TimeResolution]:
        """The calibrated model and the time steps."""
        return self.fit(plain["fit"]), TimeResolution(*plain["resolution"])

    def fit(self, plain: Plain) -> EvaluatedFit:
        """A fit of the model without any candidate."""
        error = plain["solver_error"]
        error = None if error is None else {run: self._table(rows) for run, rows in error.items()}
        errors = {run: tuple(of) for run, of in plain["time_errors"].items()}
        residuals = {run: self._table(rows) for run, rows in plain["residuals"].items()}
        campaign = with_clock_error(self.campaign, plain["clock_error"])
        campaign = with_corrected_time(campaign, errors) if errors else campaign
        campaign = without_missing(dataclasses.replace(campaign, tightening=plain["tightening"]), residuals)
        campaign = with_unpredictable_part(campaign, plain["unpredictable"])
        problem = build_problem(campaign, campaign.machine, Instruments(), ())
        problem = dataclasses.replace(problem, solver_error=error, time_errors=errors)
        fitted = Fit(
            problem, self.arrays[plain["x"]], self.arrays[plain["uncorrected"]],
            self.arrays[plain["covariance"]], plain["cost"],
            tuple(PredictedSignals(self._table(values), self._table(slopes)) for values, slopes in plain["outcomes"]),
            TimeResolution(*plain["resolution"]), plain["converged"], self.arrays[plain["costs"]],
        )  # fmt: skip
        bench = BenchEstimate(self.arrays[plain["sensors"]], self._table(plain["runs"]))
        return EvaluatedFit(fitted, residuals, bench)

    def _table(self, names: Mapping[str, str] | None) -> dict[str, np.ndarray] | None:
        return None if names is None else {name: self.arrays[key] for name, key in names.items()}
