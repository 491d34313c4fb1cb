"""Maximum a posteriori estimation of unknown parameters from all runs of a campaign, with several starts."""

import dataclasses
import functools
import math
from collections.abc import Callable

import numpy as np

from edhas_jax.core import structs
from edhas_jax.core.runtime import single_threaded_algebra
from edhas_jax.core.units import estimate_text, format_quantity
from edhas_jax.inference.fit.fit_problem import FitError, FitProblem, gauss_newton_model, quadratic_model_at
from edhas_jax.inference.fit.least_squares import QuadraticModel, levenberg_marquardt
from edhas_jax.inference.fit.starts import sample_starts
from edhas_jax.inference.likelihood.bench_deviations import DeviationKind
from edhas_jax.inference.likelihood.symmetric_matrices import regularised_inverse
from edhas_jax.machine.parameters import get_parameter, set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import BenchRun, Campaign
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.measurement_model import EvaluationPoint, MeasurementModel, PredictedSignals
from edhas_jax.measurements.residuals import Z_95, normalised_residuals
from edhas_jax.measurements.time_resolution import TimeResolution, choose_time_resolution
from edhas_jax.measurements.unknown_parameters import ShapeCoefficient, own_unknowns

CORRECTION_REFINEMENT = 4  # steps of the final corrections per fine step
MAX_CORRECTIONS = 2
LIMIT_TOLERANCE = 1e-6  # distance of a coordinate from its bound, by rounding, that counts as at the bound
ROUGH_COST_TOLERANCE = 1.0  # difference of ½χ² that the rough search neither resolves nor merges starts below


@dataclasses.dataclass(frozen=True)
class FitStep:
    """Where the search of a fit stands after a step.

    Attributes:
        search: "rough search" or "fine search".
        number: of the step in this search, from 1.
        cost: lowest ½χ² of residuals and prior so far.
        residual_over_noise: root mean square of the residuals over noise that it corresponds to.
        values: the unknowns there by name, SI.
    """

    search: str
    number: int
    cost: float
    residual_over_noise: float
    values: dict[str, float]

    def __str__(self) -> str:
        return f"{self.search}, step {self.number}: residual over noise {self.residual_over_noise:.3f}"


@dataclasses.dataclass(frozen=True)
class Fit:
    """Maximum a posteriori estimate of n unknowns with its covariance.

    Coordinates are those of the unknowns' priors: a prior is a standard normal distribution.

    Attributes:
        problem: what was estimated.
        x: estimate in coordinates, shape (n,), corrected for the discretisation error of the fine step.
        uncorrected: end of the search at the fine step in coordinates, shape (n,).
        covariance: posterior covariance in coordinates, shape (n, n).
        cost: ½χ² of residuals and prior at `uncorrected`, at the fine step.
        outcomes: by run of the problem, the signals at `x` and their derivatives with respect to the coordinates.
        resolution: the rough and the fine number of steps per sample.
        converged: whether the search at the fine step has converged.
        costs: final ½χ² of every start at the rough step; empty without a rough search.
        stopped: whether the search was interrupted: the estimate is the best point until then, at the step of the
            search that was interrupted.
    """

    problem: FitProblem
    x: np.ndarray
    uncorrected: np.ndarray
    covariance: np.ndarray
    cost: float
    outcomes: tuple[PredictedSignals, ...]
    resolution: TimeResolution
    converged: bool
    costs: np.ndarray
    stopped: bool = False

    @property
    def steps_of_changes(self) -> int:
        """Time steps per sample for small changes of the signals: half of the rough ones, as far as the machine allows.

        A change has about the relative error of the signals; half of the steps make it four times as large: enough.
        """
        return max(self.resolution.coarse // 2, self.problem.model().min_steps_per_sample())

    @property
    def std(self) -> np.ndarray:
        """Standard errors in coordinates, shape (n,): 1 for an unknown that the measurements do not inform."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> np.ndarray:
        """Correlations of the estimates, shape (n, n)."""
        return self.covariance / np.outer(self.std, self.std)

    @property
    def values(self) -> dict[str, float]:
        """The estimates by name, SI."""
        return {u.name: float(u.value(x)) for u, x in zip(self.problem.unknowns, self.x, strict=True)}

    @property
    def standard_errors(self) -> dict[str, float]:
        """The standard errors by name, SI, linearised at the estimate; NaN for an estimate at a limit."""
        rows = zip(self.problem.unknowns, self.x, self.std, strict=True)
        errors = {u.name: float(abs(u.derivative(x)) * std) for u, x, std in rows}
        return errors | dict.fromkeys(self.at_limit, math.nan)

    @property
    def at_limit(self) -> dict[str, str]:
        """The estimates that lie at a limit: "lower" or "upper", by name.

        The limit is that of the range in which they were sought, or another parameter that a law prescribes to be at
        least as large, or at most. The measurements want a value beyond it, so that the linearised standard error says
        nothing.
        """
        found = {}
        for u, x, value in zip(self.problem.unknowns, self.x, self.values.values(), strict=True):
            low, high = u.bounds()
            if min(x - low, high - x) <= LIMIT_TOLERANCE * min(high - low, 1.0):
                ends = [float(u.value(bound)) for bound in (low, high)]
                found[u.name] = "lower" if abs(value - min(ends)) < abs(value - max(ends)) else "upper"
        for row in self._orders_reached():
            for k in np.flatnonzero(row):
                found.setdefault(self.problem.unknowns[k].name, "lower" if row[k] > 0.0 else "upper")
        return found

    @property
    def at_order(self) -> list[tuple[str, str]]:
        """The pairs of estimates that are equal because a law prescribes that the first is at least the second."""
        names = [u.name for u in self.problem.unknowns]
        rows = [row for row in self._orders_reached() if np.count_nonzero(row) == 2]
        return [(names[int(np.argmax(row))], names[int(np.argmin(row))]) for row in rows]

    def _orders_reached(self) -> list[np.ndarray]:
        """The rows of the constraints, see `LinearConstraints`, at whose limits the estimate lies."""
        constraints = self.problem.constraints()
        widths = [min(high - low, 1.0) for low, high in (u.bounds() for u in self.problem.unknowns)]
        tolerance = LIMIT_TOLERANCE * np.max(np.abs(constraints.rows) * widths, axis=1, initial=0.0)
        reached = constraints.rows @ self.x - constraints.limits <= tolerance
        return list(constraints.rows[reached])

    def text(self, name: str, unit: str = "") -> str:
        """An estimate with its standard error, or with the limit at which it lies.

        Args:
            name: the unknown.
            unit: SI unit; that of the unknown by default.
        """
        unit = unit or next(u.unit for u in self.problem.unknowns if u.name == name)
        return estimate_text(self.values[name], self.standard_errors[name], unit, self.at_limit.get(name))

    def interval(self, name: str, sigmas: float = Z_95) -> tuple[float, float]:
        """Confidence interval (SI) of an unknown: `sigmas` standard errors to either side, within its span.

        NaN for an estimate at a limit.
        """
        if name in self.at_limit:
            return math.nan, math.nan
        k = [u.name for u in self.problem.unknowns].index(name)
        u, half = self.problem.unknowns[k], sigmas * self.std[k]
        low, high = sorted(float(np.clip(u.value(x), *u.span)) for x in (self.x[k] - half, self.x[k] + half))
        return low, high

    def interval_text(self, name: str) -> str:
        """The 95 % interval of an unknown as text, or the limit at which its estimate lies."""
        if name in self.at_limit:
            return f"at its {self.at_limit[name]} limit"
        (unit,) = (u.unit for u in self.problem.unknowns if u.name == name)
        return " … ".join(format_quantity(value, unit) for value in self.interval(name))

    @property
    def machine(self) -> Rig:
        """The machine with the estimated parameters, without the conditions of any run."""
        machine, values, parameters = self.problem.machine, self.values, {}
        for u in (u for u in self.problem.unknowns if not u.run and self.problem.instruments.find(u.name) is None):
            if isinstance(u, ShapeCoefficient):
                present = {n: parameters.get(n, float(get_parameter(machine, n))) for n in u.parameters}
                parameters |= u.added_to(present, values[u.name])
            else:
                parameters[u.name] = values[u.name]
        return set_parameters(machine, parameters)

    @property
    def campaign(self) -> Campaign:
        """The campaign with the estimates of what each run has of its own as conditions of that run."""
        campaign = self.problem.campaign
        runs = self._with_own_values(campaign.runs)
        return campaign if runs is campaign.runs else dataclasses.replace(campaign, runs=runs)

    @property
    def runs(self) -> tuple[BenchRun, ...]:
        """The fitted runs, each with the estimates of what it has of its own among its conditions."""
        return self._with_own_values(self.problem.model().runs)

    def _with_own_values(self, runs: tuple[BenchRun, ...]) -> tuple[BenchRun, ...]:
        if not any(run.uncertain for run in runs):
            return runs
        own: dict[str, dict[str, float]] = {}
        for fit in (self, self.of_other_runs):
            for u in (u for u in (() if fit is None else fit.problem.unknowns) if u.run):
                own.setdefault(u.run, {})[u.parameter] = fit.values[u.name]
        return tuple(dataclasses.replace(r, conditions=r.conditions | own.get(r.whole, {})) for r in runs)

    @functools.cached_property
    def of_other_runs(self) -> "Fit | None":
        """What each run that was not fitted has of its own, estimated from its samples; None where that is nothing.

        All other unknowns are held at this fit.
        """
        fitted = {run.whole for run in self.problem.model().runs}
        runs = tuple(run for run in self.problem.campaign.runs if run.whole not in fitted and run.uncertain)
        unknowns = own_unknowns(self.problem.campaign, runs)
        if not unknowns:
            return None
        of_runs = tuple(d for d in self.problem.bench.of_runs if d.kind is not DeviationKind.SETTING)
        problem = dataclasses.replace(
            self.problem, machine=self.machine, instruments=self.instruments, unknowns=unknowns, runs=runs,
            bench=dataclasses.replace(self.problem.bench, of_runs=of_runs),
        )  # fmt: skip
        steps, low_high = self.resolution.fine, np.array([u.bounds() for u in unknowns]).T
        found = levenberg_marquardt(_evaluator(problem, steps), np.zeros((1, len(unknowns))), *low_high)
        (outcomes,) = problem.predict(found.x, steps, with_sensitivities=True)
        covariance = regularised_inverse(found.model.curvature[0])
        cost, converged = float(found.model.cost[0]), bool(found.converged[0])
        return Fit(
            problem, found.x[0], found.x[0], covariance, cost, outcomes, self.resolution, converged, np.zeros(0)
        )  # fmt: skip

    @property
    def instruments(self) -> Instruments:
        """The measurement chains with the estimated parameters."""
        chains = {signal: list(chain) for signal, chain in self.problem.instruments.chains.items()}
        for name, value in self.values.items():
            owner = self.problem.instruments.find(name)
            if owner:
                signal, place, field = owner
                chains[signal][place] = structs.replace(chains[signal][place], **{field: value})
        return Instruments({signal: tuple(chain) for signal, chain in chains.items()})

    @property
    def residuals(self) -> dict[str, dict[str, np.ndarray]]:
        """(measured − model)/noise by run and signal, shape (samples,) each."""
        runs = self.problem.model().runs
        return {
            run.name: normalised_residuals(self.problem.campaign, run, out)
            for run, out in zip(runs, self.outcomes, strict=True)
        }


@single_threaded_algebra
def fit(
    problem: FitProblem,
    starts: int | np.ndarray = 4,
    seed: int = 0,
    resolution: TimeResolution | None = None,
    max_steps: int = 30,
    search: bool = True,
    on_progress: Callable[[str], None] | None = None,
    on_step: Callable[[FitStep], None] | None = None,
    keeps_best: bool = False,
) -> Fit:
    """Minimise ½Σ((measured − model)/noise)² + ½Σx² over the coordinates x of the unknowns.

    All starts are optimised with a rough integration step, and the best is continued with a fine step whose
    discretisation error is about a tenth of the noise. Over tens of thousands of samples even that error would bias
    the estimate, so the last Gauss-Newton corrections predict the signals with steps `CORRECTION_REFINEMENT` times
    finer.

    Args:
        problem: the unknowns and the runs.
        starts: number of starts (the first is the prior mean, the others are drawn around it), or their
            coordinates, shape (k, n).
        seed: seed of the random starts.
        resolution: rough and fine steps per sample; chosen from the discretisation error by default.
        max_steps: largest number of steps of either search.
        search: False skips the rough search: the first start begins at the fine step.
        on_progress: called with a sentence on the progress.
        on_step: called after every step of a search.
        keeps_best: whether KeyboardInterrupt ends the search with its best point, `stopped`; otherwise it passes.

    Returns:
        The estimate with its covariance.

    Raises:
        FitError: no run to fit, no unknown, no start, or a model that fails from every start.
    """
    report = on_progress or (lambda sentence: None)
    campaign = checked_campaign(problem.campaign)
    problem = dataclasses.replace(problem, campaign=campaign, runs=campaign.matching(problem.runs))
    model = problem.model()
    if isinstance(starts, int) and starts < 1:
        raise FitError(f"at least 1 starting point is needed, not {starts}")
    points = sample_starts(problem.unknowns, starts, seed) if isinstance(starts, int) else np.atleast_2d(starts)
    if resolution is None:
        report("choosing the integration step")
        resolution = choose_time_resolution(model, points[0])
    low, high = np.array([u.bounds() for u in problem.unknowns]).T
    constraints = problem.constraints()

    best = _BestPoint(problem)

    def report_step(search: str) -> Callable[[int, np.ndarray], None]:
        def say(number: int, cost: np.ndarray) -> None:
            step = best.step(search, number)
            report(str(step))
            if on_step is not None:
                on_step(step)

        return say

    costs = np.zeros(0)
    try:
        if search and (len(points) > 1 or resolution.coarse != resolution.fine):
            rough = levenberg_marquardt(
                best.evaluator(resolution.coarse), points, low, high,
                tolerance=ROUGH_COST_TOLERANCE, max_steps=max_steps, merge=ROUGH_COST_TOLERANCE,
                on_step=report_step("rough search"), constraints=constraints,
            )  # fmt: skip
            costs = rough.model.cost
            points = rough.x[[np.argmin(costs)]]
        fine = levenberg_marquardt(
            best.evaluator(resolution.fine), points, low, high, max_steps=max_steps,
            on_step=report_step("fine search"), constraints=constraints,
        )  # fmt: skip
        if not np.isfinite(fine.model.cost[0]):
            raise FitError(
                "the model fails (it is not finite, or leaves its physical range) at every point of the search"
            )
        report("correcting the discretisation error of the estimate")
        covariance = regularised_inverse(fine.model.curvature[0])
        x, outcomes = _correct_discretisation(
            problem, fine.x[0], covariance, resolution.fine, lambda x: constraints.project(x, low, high)
        )
    except KeyboardInterrupt:
        if best.x is None or not keeps_best:
            raise
        report("stopped: the best point so far")
        return best.fit(resolution, costs)
    cost, converged = float(fine.model.cost[0]), bool(fine.converged[0])
    return Fit(problem, x, fine.x[0], covariance, cost, outcomes, resolution, converged, costs)


class _BestPoint:
    """The best point that was evaluated at the present time step, so that an interruption loses nothing.

    Args:
        problem: the unknowns and the runs.

    Attributes:
        x: the point in coordinates (n,); None before one has a finite cost.
    """

    def __init__(self, problem: FitProblem):
        self._problem, self._per_sample = problem, 0
        self.x: np.ndarray | None = None
        self._cost, self._curvature = np.inf, np.zeros(0)

    def evaluator(self, per_sample: int) -> Callable[[np.ndarray, np.ndarray], QuadraticModel]:
        """Evaluates points at a time step. The first evaluation replaces the point of an earlier time step."""
        evaluate, is_new = _evaluator(self._problem, per_sample), True

        def noted(x: np.ndarray, starts: np.ndarray) -> QuadraticModel:
            nonlocal is_new
            found = evaluate(x, starts)
            k = int(np.argmin(np.where(np.isfinite(found.cost), found.cost, np.inf)))
            if np.isfinite(found.cost[k]) and (is_new or found.cost[k] < self._cost):
                self.x, self._cost, self._curvature = np.array(x[k]), float(found.cost[k]), found.curvature[k]
                self._per_sample, is_new = per_sample, False
            return found

        return noted

    def step(self, search: str, number: int) -> FitStep:
        """The point as a step of a search."""
        unknowns = self._problem.unknowns
        values = {} if self.x is None else {u.name: float(u.value(x)) for u, x in zip(unknowns, self.x, strict=True)}
        return FitStep(search, number, self._cost, _rms_over_noise(self._problem.model(), self._cost), values)

    def fit(self, resolution: TimeResolution, costs: np.ndarray) -> Fit:
        """The point as the estimate of a search that was stopped."""
        (outcomes,) = self._problem.predict(self.x[None], self._per_sample, with_sensitivities=True)
        covariance = regularised_inverse(self._curvature)
        return Fit(
            self._problem, self.x, self.x, covariance, self._cost, outcomes, resolution, False, costs, stopped=True
        )  # fmt: skip


def _correct_discretisation(
    problem: FitProblem, x: np.ndarray, covariance, per_sample: int, move_inside: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, tuple[PredictedSignals, ...]]:
    """Gauss-Newton steps with signals from finer steps and unchanged derivatives; the estimate and its signals.

    A step that does not lower the cost is rejected: the residuals of a wrong model are not discretisation errors.
    """
    model = problem.model()
    all_runs = tuple(range(len(model.runs)))
    slopes = model.predict_all_runs(x, per_sample, with_sensitivities=True)

    def evaluate(x):
        exact = model.predict_all_runs(x, CORRECTION_REFINEMENT * per_sample)
        outcomes = tuple(PredictedSignals(exact[r].values, slopes[r].sensitivities) for r in all_runs)
        return outcomes, quadratic_model_at(problem, x, dict(enumerate(outcomes)))

    outcomes, quadratic = evaluate(x)
    for _ in range(MAX_CORRECTIONS):
        if not np.isfinite(quadratic.cost[0]):
            break
        x_new = move_inside(x - covariance @ quadratic.gradient[0])
        outcomes_new, quadratic_new = evaluate(x_new)
        if not quadratic_new.cost[0] < quadratic.cost[0]:
            break
        x, outcomes, quadratic = x_new, outcomes_new, quadratic_new
    return x, outcomes


def _evaluator(problem: FitProblem, per_sample: int) -> Callable[[np.ndarray, np.ndarray], QuadraticModel]:
    all_runs = tuple(range(len(problem.model().runs)))
    return lambda x, starts: gauss_newton_model(problem, [EvaluationPoint(row, all_runs) for row in x], per_sample)


def _rms_over_noise(model: MeasurementModel, cost: float) -> float:
    """The root mean square of the residuals over noise that a cost corresponds to, the prior's share neglected."""
    count = sum(run.valid_samples for run in model.runs)
    return float(np.sqrt(2.0 * cost / count))
