"""The sum of squares that a fit minimises: unknowns, runs, noise, deviations of the bench, and the prior."""

import dataclasses
import functools
from collections.abc import Mapping, Sequence

import numpy as np

from edhas_jax.inference.fit.least_squares import QuadraticModel, stacked_models
from edhas_jax.inference.fit.parameter_order import LinearConstraints, order_constraints
from edhas_jax.inference.likelihood.bench_deviations import BenchDeviations, bench_deviations
from edhas_jax.inference.likelihood.run_equations import RunEquations, marginalised, run_columns, run_equations
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import BenchRun, Campaign, Use
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.measurement_model import EvaluationPoint, MeasurementModel, PredictedSignals
from edhas_jax.measurements.unknown_parameters import UnknownParameter, uncertain_unknowns

SolverError = Mapping[str, Mapping[str, np.ndarray]]
TimeError = tuple[float, ...]  # coefficients [s] of Legendre polynomials over the record of a run


CALIBRATION_BOUND = 3.0  # bound of a fitted coordinate, in standard deviations of its prior


class FitError(ValueError):
    """A fit is impossible: nothing to fit, no data, or a model that fails everywhere."""


@dataclasses.dataclass(frozen=True)
class FitProblem:
    """An estimation problem: unknown parameters of a machine and its sensors, and the runs that determine them.

    Attributes:
        campaign: measured runs, channels and their noise.
        machine: the machine at the prior means.
        unknowns: parameters to estimate, with their priors.
        instruments: measurement chains between the machine's signals and the recorded ones.
        runs: runs to fit; by default those that the campaign declares with `use: fit`.
        bench: deviations of the bench that are marginalised; none by default.
        solver_error: by run and signal, what a finer time step adds to the signals (samples,), SI; it is added to
            every prediction. None where predictions are taken as they are.
        time_errors: what was added to the time stamps of the campaign's runs, by run.
    """

    campaign: Campaign
    machine: Rig
    unknowns: tuple[UnknownParameter, ...]
    instruments: Instruments = Instruments()
    runs: tuple[BenchRun, ...] | None = None
    bench: BenchDeviations = BenchDeviations()
    solver_error: SolverError | None = None
    time_errors: Mapping[str, TimeError] = dataclasses.field(default_factory=dict)

    @property
    def is_irregular(self) -> bool:
        """Whether the signals depend irregularly on the unknowns, see `unpredictable_part`."""
        return bool(self.campaign.unpredictable)

    @property
    def fitted_runs(self) -> tuple[BenchRun, ...]:
        """The runs that are fitted; none where none of the campaign is to be."""
        return self.campaign.runs_for(Use.FIT) if self.runs is None else self.runs

    def model(self) -> MeasurementModel:
        """The model that predicts the signals of the runs.

        Raises:
            FitError: there is no run or no unknown.
        """
        return self._model

    @functools.cached_property
    def _model(self) -> MeasurementModel:
        if not self.fitted_runs:
            raise FitError(f"{self.campaign.folder}: no run has `use: fit`")
        if not self.unknowns:
            raise FitError(f"{self.campaign.folder}: nothing is named under `uncertain`, so there is nothing to fit")
        return MeasurementModel(self.campaign, self.machine, self.unknowns, self.fitted_runs, self.instruments)

    def corrected(self, run: BenchRun, predicted: PredictedSignals) -> PredictedSignals:
        """The `predicted` signals of a `run` with the solver's error removed, where it is known."""
        if self.solver_error is None or run.name not in self.solver_error:
            return predicted
        error = self.solver_error[run.name]
        values = {n: v + error[n][: len(v)] if n in error else v for n, v in predicted.values.items()}
        return PredictedSignals(values, predicted.sensitivities)

    def predict(
        self, points: np.ndarray, steps_per_sample: int, with_sensitivities: bool
    ) -> list[tuple[PredictedSignals, ...]]:
        """The signals of the fitted runs at points (k, n), the solver's error removed where it is known.

        Args:
            points: coordinates of the unknowns.
            steps_per_sample: time steps per sample.
            with_sensitivities: whether to compute the derivatives with respect to the coordinates as well.

        Returns:
            For each point the signals of every run, in the order of the runs.
        """
        model = self.model()
        every = tuple(range(len(model.runs)))
        cases = [EvaluationPoint(row, every) for row in points]
        found = model.predict(cases, steps_per_sample, with_sensitivities)
        return [tuple(self.corrected(run, of[r]) for r, run in enumerate(model.runs)) for of in found]

    def equations(self, outcomes: Sequence[PredictedSignals]) -> list[RunEquations]:
        """The normal equations of every fitted run at a point, from the signals (corrected) and sensitivities there."""
        out = []
        for run, outcome in zip(self.fitted_runs, outcomes, strict=True):
            columns, own = run_columns(self.campaign, run, outcome, self.unknowns, self.bench)
            out.append(run_equations(columns, own))
        return out

    def constraints(self) -> LinearConstraints:
        """The orders that the laws of the machine prescribe among its unknown parameters."""
        return order_constraints(self.machine, self.unknowns)


def calibration_problem(campaign: Campaign) -> FitProblem:
    """The fit of the uncertain parameters of a campaign's model, with the deviations of the bench marginalised."""
    unknowns = tuple(map(limit_to_prior_bound, uncertain_unknowns(campaign)))
    return FitProblem(campaign, campaign.machine, unknowns, bench=bench_deviations(campaign, unknowns))


def limit_to_prior_bound(unknown: UnknownParameter) -> UnknownParameter:
    """Restrict an unknown to `CALIBRATION_BOUND` prior standard deviations, so that it cannot imitate an effect."""
    low, high = (float(unknown.value(x)) for x in (-CALIBRATION_BOUND, CALIBRATION_BOUND))
    span = max(unknown.span[0], low), min(unknown.span[1], high)
    return dataclasses.replace(unknown, span=span)


def gauss_newton_model(problem: FitProblem, cases: Sequence[EvaluationPoint], per_sample: int) -> QuadraticModel:
    """½χ² of residuals and prior for each case, with its gradient and Gauss-Newton curvature.

    Residuals are whitened and the deviations of the bench marginalised, see `run_equations`.

    Args:
        problem: the unknowns and the runs.
        cases: k points in coordinates, each with the runs that count.
        per_sample: integration steps per sample.

    Returns:
        The sums of squares of the k cases; the cost is infinite where a signal or a derivative is not finite.
    """
    outcomes = problem.model().predict(cases, per_sample, with_sensitivities=True)
    return stacked_models(
        [quadratic_model_at(problem, case.x, by_run) for case, by_run in zip(cases, outcomes, strict=True)]
    )


def quadratic_model_at(problem: FitProblem, x: np.ndarray, outcomes: dict[int, PredictedSignals]) -> QuadraticModel:
    """The sum of squares of residuals and prior at a point, from the predicted signals there by index of the run."""
    runs = problem.fitted_runs
    selected = dataclasses.replace(problem, runs=tuple(runs[r] for r in outcomes))
    with np.errstate(over="ignore", invalid="ignore"):  # the search rejects such a point
        equations = selected.equations(
            [problem.corrected(runs[r], outcome) for r, outcome in outcomes.items()]
        )  # fmt: skip
        return quadratic_model(problem, x, equations)


def quadratic_model(problem: FitProblem, x: np.ndarray, equations: Sequence[RunEquations]) -> QuadraticModel:
    """The sum of squares of residuals and prior of some runs at a point, from their normal equations there."""
    n, prior = len(problem.unknowns), np.array([float(u.has_prior) for u in problem.unknowns])
    total = sum((e.gram for e in equations), np.zeros((n + problem.bench.count + 1,) * 2))
    if not np.isfinite(total).all():
        return QuadraticModel(np.array([np.inf]), np.zeros((1, n)), np.eye(n)[None])
    products = marginalised(total, slice(n, n + problem.bench.count))
    cost = 0.5 * products[-1, -1] + 0.5 * prior @ np.square(x)
    return QuadraticModel(
        np.array([cost]), (prior * x - products[:-1, -1])[None], (products[:-1, :-1] + np.diag(prior))[None]
    )
