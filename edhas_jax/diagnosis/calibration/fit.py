"""The calibration of a model with measurements: maximum a posteriori, all runs at once, from several starts."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from edhas_jax.core import structs
from edhas_jax.diagnosis.calibration.least_squares import Quadratic, inverse, minimise
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import BenchRun, Campaign, Use
from edhas_jax.measurements.measurement_chain import Instruments
from edhas_jax.measurements.predicted_signals import Case, Model, Outcome, whitened
from edhas_jax.measurements.prior import Unknown
from edhas_jax.measurements.step_selection import Resolution, choose_resolution

SPREAD_OF_STARTS = 0.7  # of the other starts around the centre, in prior standard deviations
EXACT = 4  # steps of the last corrections for one of the fine step
CORRECTIONS = 2
NEAR = 1.0  # difference in ½χ² below which the search tells neither starts nor steps apart


class FitError(ValueError):
    """A fit is not possible."""


@dataclasses.dataclass(frozen=True)
class Problem:
    """What is to be found from what: `machine` with `unknowns`, seen through `instruments`, from the runs given.

    Without `runs`, those that the campaign has for fitting.
    """

    campaign: Campaign
    machine: Rig
    unknowns: tuple[Unknown, ...]
    instruments: Instruments = Instruments()
    runs: tuple[BenchRun, ...] | None = None

    def model(self) -> Model:
        """The model whose coordinates are sought."""
        runs = self.campaign.runs_for(Use.FIT) if self.runs is None else self.runs
        if not runs:
            raise FitError(f"{self.campaign.folder}: no run has `use: fit`")
        if not self.unknowns:
            raise FitError(f"{self.campaign.folder}: nothing is named under `uncertain`, so there is nothing to fit")
        return Model(self.campaign, self.machine, self.unknowns, runs, self.instruments)


@dataclasses.dataclass(frozen=True)
class Fit:
    """The most probable values of the unknowns of a problem, and how sure they are.

    `x` and `covariance` are in the unknowns' coordinates (prior: standard normal). `uncorrected` is where the search
    ended, and `cost` ½χ² of residuals and prior there, both at the fine step; `x` is freed of the error of that step.
    `outcomes` by run of the problem: signals at `x`, and their derivatives by the coordinates. `costs` of all starts at
    the rough step.
    """

    problem: Problem
    x: np.ndarray
    uncorrected: np.ndarray
    covariance: np.ndarray
    cost: float
    outcomes: tuple[Outcome, ...]
    resolution: Resolution
    converged: bool
    costs: np.ndarray

    @property
    def std(self) -> np.ndarray:
        """Standard errors in coordinates: 1 where the measurements say nothing beyond the prior."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> np.ndarray:
        """Correlations of the estimates (n, n)."""
        return self.covariance / np.outer(self.std, self.std)

    @property
    def values(self) -> dict[str, float]:
        """The unknowns by name, SI."""
        return {u.name: float(u.value(x)) for u, x in zip(self.problem.unknowns, self.x, strict=True)}

    @property
    def errors(self) -> dict[str, float]:
        """The standard errors by name, SI."""
        rows = zip(self.problem.unknowns, self.x, self.std, strict=True)
        return {u.name: float(u.slope(x) * std) for u, x, std in rows}

    def interval(self, name: str, sigmas: float = 1.96) -> tuple[float, float]:
        """The interval (SI) of `sigmas` standard errors around an unknown, even in its coordinate."""
        k = [u.name for u in self.problem.unknowns].index(name)
        u, half = self.problem.unknowns[k], sigmas * self.std[k]
        return float(u.value(self.x[k] - half)), float(u.value(self.x[k] + half))

    @property
    def machine(self) -> Rig:
        """The calibrated machine, before any run's conditions are set."""
        own = {n: v for n, v in self.values.items() if self.problem.instruments.find(n) is None}
        return set_parameters(self.problem.machine, own)

    @property
    def instruments(self) -> Instruments:
        """The calibrated measurement chains."""
        chains = {signal: list(chain) for signal, chain in self.problem.instruments.chains.items()}
        for name, value in self.values.items():
            owner = self.problem.instruments.find(name)
            if owner:
                signal, place, field = owner
                chains[signal][place] = structs.replace(chains[signal][place], **{field: value})
        return Instruments({signal: tuple(chain) for signal, chain in chains.items()})

    @property
    def residuals(self) -> dict[str, dict[str, np.ndarray]]:
        """(measured − model)/noise by run and signal."""
        runs = self.problem.model().runs
        return {
            run.name: whitened(self.problem.campaign, run, out) for run, out in zip(runs, self.outcomes, strict=True)
        }


def fit(
    problem: Problem,
    starts: int | np.ndarray = 4,
    seed: int = 0,
    resolution: Resolution | None = None,
    most_steps: int = 30,
    search: bool = True,
    on_progress: Callable[[str], None] | None = None,
) -> Fit:
    """Calibrate: minimise ½Σ((measured − model)/noise)² + ½Σx² over the unknowns' coordinates x.

    `starts` is their number (the first is the centre of the prior, the others are drawn around it) or the coordinates
    themselves (k, n). All are followed at a rough step, the best is finished at a step whose error is a tenth of the
    noise; `resolution` gives both where they are known. In tens of thousands of samples even that error would show, so
    the last steps take the signals from a step `EXACT` times finer. Neither search takes more than `most_steps`;
    without `search` the first start is good enough to begin at the fine step. `on_progress` gets a sentence now and
    then.

    Raises:
        FitError: no run to fit, nothing unknown, or a model that fails from every start.
    """
    model = problem.model()
    say = on_progress or (lambda sentence: None)
    first = drawn_starts(problem.unknowns, starts, seed) if isinstance(starts, int) else np.atleast_2d(starts)
    if resolution is None:
        say("looking for the step that serves")
        resolution = choose_resolution(model, first[0])
    low, high = np.array([u.bounds() for u in problem.unknowns]).T

    def report(what):
        return lambda step, cost: say(f"{what}, step {step}: residual over noise {_level(model, cost.min()):.3f}")

    costs = np.zeros(0)
    if search and (len(first) > 1 or resolution.rough != resolution.fine):
        rough = minimise(
            _evaluator(model, resolution.rough), first, low, high,
            tolerance=NEAR, most_steps=most_steps, merge=NEAR,
            on_step=report("searching"),
        )  # fmt: skip
        costs = rough.at.cost
        first = rough.x[[np.argmin(costs)]]
    done = minimise(
        _evaluator(model, resolution.fine), first, low, high, most_steps=most_steps, on_step=report("finishing")
    )
    if not np.isfinite(done.at.cost[0]):
        raise FitError("the model fails (it is not finite, or leaves its physical range) wherever the fit has looked")
    say("freeing the estimate of the solver's error")
    covariance = inverse(done.at.curvature[0])
    x, outcomes = _corrected(model, done.x[0], covariance, resolution.fine, (low, high))
    return Fit(
        problem, x, done.x[0], covariance, float(done.at.cost[0]), outcomes, resolution, bool(done.converged[0]), costs
    )


def _corrected(model: Model, x: np.ndarray, covariance, per_sample: int, bounds) -> tuple[np.ndarray, tuple]:
    """Gauss-Newton steps with signals from a finer step, the derivatives kept; and the signals there.

    A step that does not lower the cost is not taken: a model that does not fit has other errors than the solver's.
    """
    every = tuple(range(len(model.runs)))
    slopes = model.outcomes([Case(x, every)], per_sample, derive=True)[0]

    def at(x):
        exact = model.outcomes([Case(x, every)], EXACT * per_sample, derive=False)[0]
        outcomes = tuple(Outcome(exact[r].values, slopes[r].slopes) for r in every)
        return outcomes, _quadratic(model, x, dict(enumerate(outcomes)))

    outcomes, quadratic = at(x)
    for _ in range(CORRECTIONS):
        if not np.isfinite(quadratic.cost[0]):
            break
        moved = np.clip(x - covariance @ quadratic.gradient[0], *bounds)
        there, after = at(moved)
        if not after.cost[0] < quadratic.cost[0]:
            break
        x, outcomes, quadratic = moved, there, after
    return x, outcomes


def drawn_starts(unknowns: Sequence[Unknown], count: int, seed: int) -> np.ndarray:
    """Coordinates (count, n): the centre of the prior, then draws from it; uniform in the span without a prior."""
    rng = np.random.default_rng(seed)
    rows = np.zeros((count, len(unknowns)))
    for k, u in enumerate(unknowns):
        low, high = u.bounds()
        if u.prior or not np.isfinite(high - low):
            rows[1:, k] = np.clip(SPREAD_OF_STARTS * rng.standard_normal(count - 1), -2.0, 2.0)
        else:
            rows[1:, k] = rng.uniform(low, high, count - 1)
        rows[:, k] = np.clip(rows[:, k], low, high)
    return rows


def _evaluator(model: Model, per_sample: int) -> Callable[[np.ndarray, np.ndarray], Quadratic]:
    every = tuple(range(len(model.runs)))
    return lambda x, which: sums_of_squares(model, [Case(row, every) for row in x], per_sample)


def sums_of_squares(model: Model, cases: Sequence[Case], per_sample: int) -> Quadratic:
    """½χ² of residuals and prior for each case, with its gradient and Gauss-Newton curvature."""
    found = model.outcomes(cases, per_sample, derive=True)
    rows = [_quadratic(model, case.x, outcomes) for case, outcomes in zip(cases, found, strict=True)]
    return Quadratic(*(np.concatenate([getattr(row, part) for row in rows]) for part in Quadratic.__dataclass_fields__))


def _quadratic(model: Model, x: np.ndarray, outcomes: dict[int, Outcome]) -> Quadratic:
    prior = np.array([float(u.prior) for u in model.unknowns])
    cost, gradient, curvature = 0.5 * prior @ np.square(x), prior * x, np.diag(prior)
    for r, outcome in outcomes.items():
        for name, residual in whitened(model.campaign, model.runs[r], outcome).items():
            there = np.isfinite(model.runs[r].signals[name])
            slopes = -outcome.slopes[name][there] / model.campaign.channels[name].noise
            residual = residual[there]
            with np.errstate(over="ignore", invalid="ignore"):  # such a point is rejected
                cost = cost + 0.5 * residual @ residual
                gradient = gradient + slopes.T @ residual
                curvature = curvature + slopes.T @ slopes
    sound = np.isfinite(cost) and np.isfinite(gradient).all()
    return Quadratic(np.array([cost if sound else np.inf]), gradient[None], curvature[None])


def _level(model: Model, cost: float) -> float:
    count = sum(np.isfinite(values).sum() for run in model.runs for values in run.signals.values())
    return float(np.sqrt(2.0 * cost / count))
