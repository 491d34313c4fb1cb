"""Multistart optimisers on batches: projected Adam on an augmented Lagrangian, and SLSQP."""

import dataclasses
import queue
import threading
from collections.abc import Callable

import jax
import numpy as np
import optax
import pandas as pd
from scipy.optimize import minimize

from edhas_jax.core import runtime
from edhas_jax.design.sizing.problem import DesignEvaluation, SizingProblem

INITIAL_STEP, FINAL_STEP = 0.06, 0.004  # learning rates of Adam, as shares of the range of a variable
PENALTY_FACTOR = 20.0  # ρ of the augmented Lagrangian
MULTIPLIER_INTERVAL = 5  # iterations between updates of the multipliers
MAX_MULTIPLIER = 1e3
FEASIBILITY_TOLERANCE = 2e-3  # largest relative violation of a constraint that counts as feasible
SLSQP_TOLERANCE = 1e-5  # change of J
FAILED_OBJECTIVE = 1e3  # what SLSQP minimises at a design that fails, so that its line search turns back


@dataclasses.dataclass(frozen=True)
class SearchResult:
    """The best design that each of n starts has visited.

    Attributes:
        fractions: its d variables as fractions of their ranges, shape (n, d).
        objective: its J, shape (n,).
        violation: its largest relative constraint violation, shape (n,).
        path: a row per iteration and start with variables (SI), objective and violation.
        stopped: whether the user has interrupted the search.
    """

    fractions: np.ndarray
    objective: np.ndarray
    violation: np.ndarray
    path: pd.DataFrame
    stopped: bool = False

    def of(self, starts) -> "SearchResult":
        """The best designs of some starts."""
        kept = {n: getattr(self, n)[starts] for n in ("fractions", "objective", "violation")}
        return dataclasses.replace(self, **kept)

    @property
    def best(self) -> int:
        """The start with the largest feasible objective, or with the smallest violation if none is feasible."""
        feasible = self.violation <= FEASIBILITY_TOLERANCE
        if feasible.any():
            return int(np.argmax(np.where(feasible, self.objective, -np.inf)))
        return int(np.argmin(self.violation))


class _Search:
    """A search while it runs: the best design of each start, and the path.

    Args:
        problem: evaluates the designs.
        starts: fractions of the ranges, shape (n, d).
        weights: weights of the goals of each start, shape (n, k); None: those of the task.
    """

    def __init__(self, problem: SizingProblem, starts: np.ndarray, weights: np.ndarray | None):
        n = len(starts)
        self.best = SearchResult(np.array(starts), np.full(n, -np.inf), np.full(n, np.inf), pd.DataFrame())
        self._problem, self._weights, self._rows = problem, weights, []

    def visit(self, z: np.ndarray, starts: np.ndarray, is_step: bool = True) -> DesignEvaluation | None:
        """Evaluate a design of each of some starts, as a step of the path or not; None after an interruption.

        The better of two designs is feasible rather than infeasible, then that of the better objective or violation.

        Raises:
            KeyboardInterrupt: the user has interrupted it before the first step was done.
        """
        try:
            found = self._problem.evaluate(z, None if self._weights is None else self._weights[starts])
        except KeyboardInterrupt:
            if not self._rows:
                raise
            self.best = dataclasses.replace(self.best, stopped=True)
            return None
        before, violation = self.best.of(starts), found.violation
        feasible, was_feasible = violation <= FEASIBILITY_TOLERANCE, before.violation <= FEASIBILITY_TOLERANCE
        better = np.where(feasible & was_feasible, found.objective > before.objective, violation < before.violation)
        better = (better | (feasible & ~was_feasible)) & np.isfinite(found.objective)
        for kept, new in ((self.best.fractions, z), (self.best.objective, found.objective),
                          (self.best.violation, violation)):  # fmt: skip
            kept[starts[better]] = new[better]
        if is_step:
            self._rows.append(pd.DataFrame({
                "iteration": len(self._rows), "start": starts, **self._problem.designs(z),
                "objective": found.objective, "violation": violation,
            }))  # fmt: skip
        return found

    @property
    def result(self) -> SearchResult:
        """The best designs so far, with the path to them."""
        return dataclasses.replace(self.best, path=pd.concat(self._rows, ignore_index=True))


def augmented_lagrangian_descent(
    problem: SizingProblem,
    starts: np.ndarray,
    iterations: int,
    weights: np.ndarray | None = None,
    on_iteration: Callable[[int, float], None] | None = None,
) -> SearchResult:
    """Minimise the augmented Lagrangian from every start by projected Adam, all starts in one batch.

        L = −J + Σ (max(0, λ + ρ g)² − λ²) / (2ρ),   λ ← max(0, λ + ρ g) every `MULTIPLIER_INTERVAL` iterations

    A design that fails is replaced by the mean of it and its start's last valid design, or the best of all starts.

    Args:
        problem: evaluates the designs.
        starts: fractions of the ranges, shape (n, d).
        iterations: number of iterations.
        weights: weights of the goals of each start, shape (n, k); by default those of the task.
        on_iteration: called with the number of the iteration and the best objective.

    Returns:
        The best design of each start; after an interruption by the user, until then.
    """
    z = np.clip(starts, 0.0, 1.0)
    schedule = optax.cosine_decay_schedule(INITIAL_STEP, iterations, FINAL_STEP / INITIAL_STEP)
    adam = optax.adam(schedule)
    state, update = runtime.jit(adam.init)(z), runtime.jit(adam.update)
    multipliers, search, all_starts = 0.0, _Search(problem, z, weights), np.arange(len(z))
    last_valid = np.full_like(z, np.nan)
    for number in range(iterations):
        evaluation = search.visit(z, all_starts)
        if evaluation is None:
            return search.result
        valid, best = np.isfinite(evaluation.objective), search.best
        if on_iteration is not None:
            on_iteration(number, float(best.objective[best.best]))
        last_valid[valid] = z[valid]
        updated = np.maximum(0.0, multipliers + PENALTY_FACTOR * np.nan_to_num(evaluation.constraints))
        if number % MULTIPLIER_INTERVAL == MULTIPLIER_INTERVAL - 1:
            multipliers = np.where(valid[:, None], np.minimum(updated, MAX_MULTIPLIER), multipliers)
        gradient = -evaluation.gradient + (updated[:, :, None] * evaluation.constraint_gradients).sum(axis=1)
        with jax.numpy_dtype_promotion("standard"):  # optax mixes whole and real numbers
            step, state = update(np.nan_to_num(gradient), state)
        moved = np.clip(z + np.asarray(step), 0.0, 1.0)
        fallback = np.where(np.isfinite(last_valid), last_valid, best.fractions[best.best])
        z = np.where(valid[:, None], moved, 0.5 * (z + fallback))
    search.visit(z, all_starts, is_step=False)
    return search.result


def slsqp_multistart(
    problem: SizingProblem,
    starts: np.ndarray,
    iterations: int,
    weights: np.ndarray | None = None,
    on_round: Callable[[int], None] | None = None,
) -> SearchResult:
    """Run SLSQP from every start side by side: the designs requested by all searches are evaluated in one batch.

    Args:
        problem: evaluates the designs.
        starts: fractions of the ranges, shape (n, d).
        iterations: largest number of iterations of each search.
        weights: weights of the goals of each start, shape (n, k); by default those of the task.
        on_round: called with the number of batches so far.

    Returns:
        The best design of each start; after an interruption by the user, until then.
    """
    requests: queue.Queue = queue.Queue()
    answers = [queue.Queue() for _ in starts]
    for i, z in enumerate(starts):
        arguments = i, z, iterations, requests, answers[i]
        threading.Thread(target=_run_slsqp, args=arguments, daemon=True).start()
    search, rounds, searching = _Search(problem, starts, weights), 0, len(starts)
    while pending := [(i, z) for i, z in (requests.get() for _ in range(searching)) if z is not None]:
        searching, rounds = len(pending), rounds + 1
        index, z = map(np.array, zip(*pending, strict=True))
        evaluation = search.visit(z, index)
        if evaluation is None:
            break
        for k, i in enumerate(index):
            answers[i].put((-evaluation.objective[k], -evaluation.gradient[k], -evaluation.constraints[k],
                            -evaluation.constraint_gradients[k]))  # fmt: skip
        if on_round is not None:
            on_round(rounds)
    return search.result


def _run_slsqp(number: int, start: np.ndarray, iterations: int, requests: queue.Queue, answers: queue.Queue) -> None:
    """One SLSQP search; it requests (number, fractions) for every design, and puts (number, None) at its end."""
    last: list = [None, None]

    def evaluate(z):
        z = np.clip(z, 0.0, 1.0)
        if last[0] is None or not np.array_equal(z, last[0]):
            requests.put((number, z))
            last[:] = z, answers.get()
        return last[1]

    minimize(
        lambda z: float(np.nan_to_num(evaluate(z)[0], nan=FAILED_OBJECTIVE)), start, method="SLSQP",
        jac=lambda z: np.nan_to_num(evaluate(z)[1]), bounds=[(0.0, 1.0)] * len(start),
        constraints={"type": "ineq", "fun": lambda z: np.nan_to_num(evaluate(z)[2], nan=-1.0),
                     "jac": lambda z: np.nan_to_num(evaluate(z)[3])},
        options={"maxiter": iterations, "ftol": SLSQP_TOLERANCE},
    )  # fmt: skip
    requests.put((number, None))
