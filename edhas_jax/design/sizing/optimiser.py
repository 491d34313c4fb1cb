"""Many starts at once: projected Adam on an augmented Lagrangian, then SLSQP, all in one batch."""

import dataclasses
import queue
import threading
from collections.abc import Callable

import jax
import numpy as np
import optax
import pandas as pd
from scipy.optimize import minimize

from edhas_jax.design.sizing.problem import Judged, Problem

RATE, LAST_RATE = 0.06, 0.004  # Adam's step, as a share of a dimension's range, at the start and at the end
PENALTY = 20.0
EVERY = 5  # iterations between updates of the multipliers
MET = 2e-3  # a limit that is exceeded by less than this share counts as met


@dataclasses.dataclass(frozen=True)
class Ends:
    """Where the starts ended: shares (n, d), the best that each visited, and the way there.

    `objective` and `violation` (n,) belong to `shares`; `path` has a row per iteration and start. `stopped`: the user
    has interrupted the search, and these are the best designs until then.
    """

    shares: np.ndarray
    objective: np.ndarray
    violation: np.ndarray
    path: pd.DataFrame
    stopped: bool = False

    @property
    def best(self) -> int:
        """The feasible end with the largest objective, or the one that violates least."""
        feasible = self.violation <= MET
        if feasible.any():
            return int(np.argmax(np.where(feasible, self.objective, -np.inf)))
        return int(np.argmin(self.violation))


def descend(
    problem: Problem,
    starts: np.ndarray,
    iterations: int,
    weights: np.ndarray | None = None,
    on_iteration: Callable[[int, float], None] | None = None,
) -> Ends:
    """Follow every start for so many iterations, all in one batch; `on_iteration(number, best objective)`.

    L = −J + Σ (max(0, λ + ρ g)² − λ²) / (2ρ),   λ ← max(0, λ + ρ g) every few iterations

    Designs that fail go half way back to the last one that did not, or to the best of all.
    """
    z = np.clip(starts, 0.0, 1.0)
    schedule = optax.cosine_decay_schedule(RATE, iterations, LAST_RATE / RATE)
    adam = optax.adam(schedule)
    state, update = adam.init(z), jax.jit(adam.update)
    multipliers = None
    best = Ends(z.copy(), np.full(len(z), -np.inf), np.full(len(z), np.inf), pd.DataFrame())
    last_good, rows = np.full_like(z, np.nan), []
    for number in range(iterations):
        try:
            judged = problem.judge(z, weights)
        except KeyboardInterrupt:
            if not rows:
                raise
            return dataclasses.replace(best, path=pd.concat(rows, ignore_index=True), stopped=True)
        if multipliers is None:
            multipliers = np.zeros_like(judged.excess)
        good = np.isfinite(judged.objective)
        best = _better(best, z, judged)
        rows.append(_row(problem, number, z, judged))
        if on_iteration is not None:
            on_iteration(number, float(best.objective[best.best]))
        last_good[good] = z[good]
        pressure = np.maximum(0.0, multipliers + PENALTY * np.nan_to_num(judged.excess))
        if number % EVERY == EVERY - 1:
            multipliers = np.where(good[:, None], np.minimum(pressure, 1e3), multipliers)
        slope = -judged.slope + (pressure[:, :, None] * judged.excess_slope).sum(axis=1)
        with jax.numpy_dtype_promotion("standard"):  # optax mixes whole and real numbers
            step, state = update(np.nan_to_num(slope), state)
        moved = np.clip(z + np.asarray(step), 0.0, 1.0)
        refuge = np.where(np.isfinite(last_good), last_good, best.shares[best.best])
        z = np.where(good[:, None], moved, 0.5 * (z + refuge))
    best = _better(best, z, problem.judge(z, weights))
    return dataclasses.replace(best, path=pd.concat(rows, ignore_index=True))


def polish(
    problem: Problem,
    starts: np.ndarray,
    iterations: int,
    weights: np.ndarray | None = None,
    on_round: Callable[[int], None] | None = None,
) -> Ends:
    """SLSQP from every start. The searches go on side by side: what they ask for at a time is judged in one batch.

    `on_round(number)` is called after each batch. What counts is the best design that a search has visited.
    """
    asked: queue.Queue = queue.Queue()
    answers = [queue.Queue() for _ in starts]
    threads = [
        threading.Thread(target=_search, args=(i, z, iterations, asked, answers[i]), daemon=True)
        for i, z in enumerate(starts)
    ]
    for thread in threads:
        thread.start()
    nowhere = np.full(len(starts), -np.inf), np.full(len(starts), np.inf)
    best, rows = Ends(np.array(starts), *nowhere, pd.DataFrame()), []
    searching = len(starts)
    while searching:
        wanted = [asked.get() for _ in range(searching)]
        who = [(i, z) for i, z in wanted if z is not None]
        searching = len(who)
        if not who:
            break
        at, z = np.array([i for i, _ in who]), np.stack([z for _, z in who])
        try:
            judged = problem.judge(z, None if weights is None else weights[at])
        except KeyboardInterrupt:
            if not rows:
                raise
            return dataclasses.replace(best, path=pd.concat(rows, ignore_index=True), stopped=True)
        part = Ends(best.shares[at], best.objective[at], best.violation[at], best.path)
        part = _better(part, z, judged)
        for array, own in ((best.shares, part.shares), (best.objective, part.objective),
                           (best.violation, part.violation)):  # fmt: skip
            array[at] = own
        rows.append(_row(problem, len(rows), z, judged, at))
        for k, (i, _) in enumerate(who):
            answers[i].put((-judged.objective[k], -judged.slope[k], -judged.excess[k], -judged.excess_slope[k]))
        if on_round is not None:
            on_round(len(rows))
    return dataclasses.replace(best, path=pd.concat(rows, ignore_index=True))


def _search(number: int, start: np.ndarray, iterations: int, asked: queue.Queue, answers: queue.Queue) -> None:
    """One SLSQP search; it puts (number, shares) for every design it wants to know, and (number, None) at its end."""
    last: list = [None, None]

    def known(z):
        z = np.clip(z, 0.0, 1.0)
        if last[0] is None or not np.array_equal(z, last[0]):
            asked.put((number, z))
            last[:] = z, answers.get()
        return last[1]

    # what fails has no derivatives: it is told to be bad, so that the line search comes back
    minimize(
        lambda z: float(np.nan_to_num(known(z)[0], nan=1e3)), start, method="SLSQP",
        jac=lambda z: np.nan_to_num(known(z)[1]), bounds=[(0.0, 1.0)] * len(start),
        constraints={"type": "ineq", "fun": lambda z: np.nan_to_num(known(z)[2], nan=-1.0),
                     "jac": lambda z: np.nan_to_num(known(z)[3])},
        options={"maxiter": iterations, "ftol": 1e-5},
    )  # fmt: skip
    asked.put((number, None))


def _better(best: Ends, z: np.ndarray, judged: Judged) -> Ends:
    """The best of every start: feasible before infeasible, then by objective or by violation."""
    violation = judged.violation
    now, before = violation <= MET, best.violation <= MET
    better = np.where(now & before, judged.objective > best.objective, violation < best.violation)
    better = (better | (now & ~before)) & np.isfinite(judged.objective)
    return Ends(
        np.where(better[:, None], z, best.shares), np.where(better, judged.objective, best.objective),
        np.where(better, violation, best.violation), best.path,
    )  # fmt: skip


def _row(problem: Problem, number: int, z: np.ndarray, judged: Judged, starts=None) -> pd.DataFrame:
    return pd.DataFrame({
        "iteration": number, "start": np.arange(len(z)) if starts is None else starts, **problem.values(z),
        "objective": judged.objective, "violation": judged.violation,
    })  # fmt: skip
