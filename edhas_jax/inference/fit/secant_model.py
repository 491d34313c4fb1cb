"""Sums of squares along a search whose derivatives follow from earlier points by Broyden's method.

Derivatives with respect to n unknowns cost many times what the signals alone cost. From a point x with the
sensitivities S, a step d to a point where the signals have changed by Δy gives new sensitivities

    S + (Δy − S d) dᵀ/(dᵀd)

which are right along the step and unchanged across it. d holds the steps of the unknowns that act in a run. The sums
of squares there follow from the old products of the columns and two more of them. The columns of the bench deviations
stay as they are until derivatives are computed again.

Source: Broyden, Math. Comp. 19 (1965) 577; for least squares Dennis, Schnabel, Numerical Methods for Unconstrained
Optimization (1983), ch. 8.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from edhas_jax.inference.fit.fit_problem import FitProblem, quadratic_model
from edhas_jax.inference.fit.least_squares import QuadraticModel, stacked_models
from edhas_jax.inference.likelihood.run_equations import run_columns, run_equations
from edhas_jax.inference.likelihood.whitening import whiten
from edhas_jax.measurements.campaign import BenchRun
from edhas_jax.measurements.measurement_model import PredictedSignals

MAX_BYTES = 2**29  # memory for the columns of all starts; if they need more, derivatives are computed at every point


@dataclasses.dataclass
class _RunState:
    """The whitened columns (m, q) of one run, as `run_columns` orders them, the valid rows, and their products."""

    columns: np.ndarray
    valid: dict[str, np.ndarray]
    gram: np.ndarray


@dataclasses.dataclass
class _Step:
    """A step that may become the present point: per run the residual there, the correction w, and the new products."""

    x: np.ndarray
    residuals: list[np.ndarray]
    corrections: list[np.ndarray]
    directions: list[np.ndarray]
    grams: list[np.ndarray]


@dataclasses.dataclass
class _Start:
    """Where one start of the search is."""

    x: np.ndarray
    runs: list[_RunState]
    outcomes: tuple[PredictedSignals, ...] | None  # with derivatives; None once derivatives are updated ones
    step: _Step | None = None


class SecantModel:
    """The sum of squares of a fit problem, with computed or with updated derivatives.

    Args:
        problem: the unknowns and the runs.
        steps_per_sample: time steps per sample.
        known: signals and sensitivities, by run, at the single point that is evaluated first; predicted by default.
    """

    def __init__(self, problem: FitProblem, steps_per_sample: int, known: Sequence[PredictedSignals] | None = None):
        self._problem, self._steps_per_sample, self._known = problem, steps_per_sample, known
        self._runs: Sequence[BenchRun] = problem.model().runs
        self._own, self._count = len(problem.bench.of_runs), len(problem.unknowns)
        self._starts: dict[int, _Start] = {}

    def fits_in_memory(self, starts: int) -> bool:
        """Whether the columns of that many starts need less memory than `MAX_BYTES`."""
        samples = sum(len(v) for run in self._runs for v in run.signals.values())
        columns = self._own + self._count + self._problem.bench.count + 1
        return 8 * samples * columns * starts < MAX_BYTES

    def evaluate(self, x: np.ndarray, starts: np.ndarray) -> QuadraticModel:
        """The sums of squares at points (k, n), which become the present ones of the starts (k,), with derivatives."""
        known, self._known = self._known, None
        if known is None:
            outcomes = self._problem.predict(x, self._steps_per_sample, with_sensitivities=True)
        else:
            outcomes = [tuple(known)]
        found = []
        for start, point, predicted in zip(starts, x, outcomes, strict=True):
            with np.errstate(over="ignore", invalid="ignore"):  # the search rejects such a point
                runs = [self._run_state(run, outcome) for run, outcome in zip(self._runs, predicted, strict=True)]
                self._starts[int(start)] = _Start(np.array(point), runs, predicted)
                found.append(self._quadratic(point, [state.gram for state in runs], runs))
        return stacked_models(found)

    def update(self, x: np.ndarray, starts: np.ndarray, present: np.ndarray) -> QuadraticModel:
        """The sums of squares at points (k, n), with derivatives updated from the `present` points (k, n).

        The present point of a start is one of the last two that `evaluate` or `update` has seen for it.
        """
        found, outcomes = [], self._problem.predict(x, self._steps_per_sample, with_sensitivities=False)
        for start, point, at, predicted in zip(starts, x, present, outcomes, strict=True):
            state = self._starts[int(start)]
            if state.step is not None and np.array_equal(state.step.x, at):
                self._go_to_step(state)
            with np.errstate(over="ignore", invalid="ignore"):
                state.step = self._step(state, point, predicted)
                found.append(self._quadratic(point, state.step.grams, state.runs))
        return stacked_models(found)

    def outcomes_at(self, start: int, x: np.ndarray) -> tuple[PredictedSignals, ...] | None:
        """The signals with computed derivatives, by run, where the start has them at that point; else None."""
        state = self._starts.get(start)
        return None if state is None or not np.array_equal(state.x, x) else state.outcomes

    def _run_state(self, run: BenchRun, outcome: PredictedSignals) -> _RunState:
        problem = self._problem
        columns, _ = run_columns(problem.campaign, run, outcome, problem.unknowns, problem.bench)
        valid = {n: np.isfinite(rows) for n, rows in self._residuals(run, outcome).items()}
        return _RunState(columns, valid, columns.T @ columns)

    def _residuals(self, run: BenchRun, outcome: PredictedSignals) -> dict[str, np.ndarray]:
        channels = self._problem.campaign.channels
        return {n: whiten(measured - outcome.values[n], channels[n]) for n, measured in run.signals.items()}

    def _step(self, state: _Start, x: np.ndarray, predicted: Sequence[PredictedSignals]) -> _Step:
        moved = x - state.x
        unknowns = slice(self._own, self._own + self._count)
        residuals, corrections, directions, grams = [], [], [], []
        for r, (run, outcome, known) in enumerate(zip(self._runs, predicted, state.runs, strict=True)):
            acting = moved * self._problem.model().acting(r)
            direction = acting / max(float(acting @ acting), np.finfo(float).tiny)
            rows = self._residuals(run, outcome)
            residual = np.concatenate([rows[n][valid] for n, valid in known.valid.items()])
            change = residual - known.columns[:, -1]
            correction = -change - known.columns[:, unknowns] @ moved
            added = np.stack([correction, change], axis=1)
            place = np.zeros((known.columns.shape[1], 2))
            place[unknowns, 0], place[-1, 1] = direction, 1.0
            cross = (known.columns.T @ added) @ place.T
            grams.append(known.gram + cross + cross.T + place @ (added.T @ added) @ place.T)
            residuals.append(residual)
            corrections.append(correction)
            directions.append(direction)
        return _Step(np.array(x), residuals, corrections, directions, grams)

    def _go_to_step(self, state: _Start) -> None:
        step, unknowns = state.step, slice(self._own, self._own + self._count)
        parts = zip(state.runs, step.residuals, step.corrections, step.directions, step.grams, strict=True)
        for known, residual, correction, direction, gram in parts:
            known.columns[:, unknowns] += correction[:, None] * direction
            known.columns[:, -1], known.gram = residual, gram
        state.x, state.outcomes, state.step = step.x, None, None

    def _quadratic(self, x: np.ndarray, grams: Sequence[np.ndarray], runs: Sequence[_RunState]) -> QuadraticModel:
        equations = [run_equations(of.columns, self._own, gram) for gram, of in zip(grams, runs, strict=True)]
        return quadratic_model(self._problem, x, equations)
