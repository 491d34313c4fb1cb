"""Solve a sizing task: multistart search with a coarse step, then refinement of the best designs with a fine step."""

import dataclasses
import time
from collections.abc import Callable, Mapping

import numpy as np
import pandas as pd

from edhas_jax.config.machine_config import ConfigError
from edhas_jax.core.units import format_quantity
from edhas_jax.design.sizing.config import SizingTask
from edhas_jax.design.sizing.optimiser import (
    FEASIBILITY_TOLERANCE,
    SearchResult,
    augmented_lagrangian_descent,
    slsqp_multistart,
)
from edhas_jax.design.sizing.problem import DesignEvaluation, SizingProblem
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.validity import REASONS, Status

COARSE_STEPS, FINE_STEPS = 1024, 4096  # per cycle, of the search and of the refinement
SLSQP_ITERATIONS = 15  # of the search from every start, and of the refinement
MAX_REFINED = 3  # best designs of the search that are refined
NEAR_BEST = 0.01  # difference of J below which a start counts as having found the best design
ACTIVE_MARGIN = 5e-3  # relative distance from a constraint below which it is active
BOUND_MARGIN = 1e-4  # distance from a bound, as a fraction of the range, below which it is active
MIN_GOAL_GRADIENT = 1e-9  # below which a goal does not depend on any design variable
FRONT_WEIGHTS = (0.02, 0.98)  # share of the second goal at the ends of a Pareto front


class SizingError(ConfigError):
    """A task has no solution; the message says why, and gives the nearest design."""


@dataclasses.dataclass(frozen=True)
class SizedMachine:
    """A design of a sizing task.

    Attributes:
        machine: the machine with these dimensions.
        design: the design variables (SI) by name.
        objective: J, the weighted mean logarithm of the metrics.
        violation: the largest relative constraint violation.
        metrics: a row per case with the columns of its operating point and corner, and its metrics (SI).
        active: the active constraints and bounds as text.
        convergence: how the search ended, as text.
        weights: weights of the metrics of the objective.
        warnings: what the machine does in some cases that it should not, such as to run onto a stop.
    """

    machine: Rig
    design: dict[str, float]
    objective: float
    violation: float
    metrics: pd.DataFrame
    active: tuple[str, ...]
    convergence: str
    weights: tuple[float, ...]
    warnings: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class SizingResult:
    """The solution of a sizing task.

    Attributes:
        machines: one machine, or several along a Pareto front.
        start: the machine of the task.
        path: a row per iteration and start.
        share_near_best: share of the starts that end within `NEAR_BEST` of the best.
        machine_seconds: simulated time, s; each derivative counts as a run.
        seconds: computing time, s.
    """

    machines: tuple[SizedMachine, ...]
    start: SizedMachine
    path: pd.DataFrame
    share_near_best: float
    machine_seconds: float
    seconds: float


def size(task: SizingTask, on_progress: Callable[[str, float], None] | None = None) -> SizingResult:
    """Find the best design of a task, or a Pareto front.

    Args:
        task: variables, objective, constraints.
        on_progress: called with the name of a stage and the share done.

    Returns:
        The best feasible designs, also after an interruption by the user.

    Raises:
        SizingError: a goal depends on no design variable, the constraints cannot be met together, or no start has
            finite derivatives.
    """
    began = time.perf_counter()
    report = on_progress or (lambda what, share: None)
    report("compiling", 0.0)
    coarse, fine = SizingProblem(task, COARSE_STEPS), SizingProblem(task, FINE_STEPS)
    goals = np.array(list(task.weights.values()))
    weightings = [goals]
    if task.front:
        shares = np.linspace(*FRONT_WEIGHTS, task.front)
        weightings = [2.0 * goals * np.array([1.0 - s, s]) for s in shares]
    initial = coarse.evaluate(coarse.initial_fractions()[None])
    starts = _starts(task, coarse)
    _check_solvable(coarse, starts, coarse.evaluate(starts))
    all_starts = np.concatenate([starts] * len(weightings))
    weights = np.repeat(weightings, len(starts), axis=0)
    count = len(all_starts)
    ends = augmented_lagrangian_descent(
        coarse, all_starts, task.iterations, weights,
        lambda n, best: report(f"descent of {count} starts, J = {best:.4f}", n / task.iterations),
    )  # fmt: skip
    found, path = ends, ends.path
    if not ends.stopped:
        found = slsqp_multistart(
            coarse, ends.fractions, SLSQP_ITERATIONS, weights,
            lambda n: report(f"SLSQP from {count} designs, round {n}", n / (n + SLSQP_ITERATIONS)),
        )  # fmt: skip
        found.path["iteration"] += task.iterations
        path = pd.concat([ends.path, found.path], ignore_index=True)
    machines, near_best = [], []
    for k, weighting in enumerate(weightings):
        report("refinement", k / len(weightings))
        part = found.of(slice(k * len(starts), (k + 1) * len(starts)))
        near = part.objective >= part.objective[part.best] - NEAR_BEST
        near_best.append(np.mean((part.violation <= FEASIBILITY_TOLERANCE) & near))
        machines.append(_refine(task, fine, part, weighting))
    _check_feasible(fine, machines)
    start = _sized_machine(task, coarse, coarse.initial_fractions(), initial, "the start", goals)
    seconds = coarse.machine_seconds + fine.machine_seconds
    return SizingResult(tuple(machines), start, path, float(np.mean(near_best)), seconds, time.perf_counter() - began)


def _starts(task: SizingTask, problem: SizingProblem) -> np.ndarray:
    """The fractions of the task's machine and of a Sobol sequence over the bounds, (starts, d)."""
    from scipy.stats import qmc

    engine = qmc.Sobol(len(task.variables), scramble=True, seed=np.random.default_rng(task.seed))
    sequence = engine.random_base2(max(0, int(np.ceil(np.log2(max(task.starts - 1, 1))))))[: task.starts - 1]
    return np.concatenate([problem.initial_fractions()[None], sequence])


def _refine(task: SizingTask, problem: SizingProblem, ends: SearchResult, weighting) -> SizedMachine:
    """Continue the best designs with the fine step; the best of them."""
    feasible = ends.violation <= FEASIBILITY_TOLERANCE
    order = np.lexsort((-ends.objective, np.where(feasible, 0.0, ends.violation)))[:MAX_REFINED]
    weights = np.tile(weighting, (len(order), 1))
    if ends.stopped or not feasible.any():
        z = ends.fractions[ends.best]
        text = "interrupted: the best design so far, not refined" if ends.stopped else "no start meets the constraints"
    else:
        refined = slsqp_multistart(problem, ends.fractions[order], SLSQP_ITERATIONS, weights)
        z = refined.fractions[refined.best]
        gain = refined.objective[refined.best] - ends.objective[order[0]]
        rounds = refined.path["iteration"].max() + 1
        text = f"{len(order)} designs refined in {rounds} rounds of SLSQP, ΔJ = {gain:+.1e}"
    return _sized_machine(task, problem, z, problem.evaluate(z[None], weights[:1]), text, weighting)


def _sized_machine(
    task: SizingTask, problem: SizingProblem, z, evaluation: DesignEvaluation, convergence: str, weighting
) -> SizedMachine:  # fmt: skip
    """The machine at fractions z (d,), with the metrics and constraints of its evaluation."""
    design = {n: float(v[0]) for n, v in problem.designs(z[None]).items()}
    rows = []
    for k, (point, corner) in enumerate(problem.cases):
        ends = {} if corner is None else {f"{t.name} at": s for t, s in zip(task.tolerances, corner, strict=True)}
        rows.append({**point, **ends, **{m: v[0, k] for m, v in evaluation.values.items()}})
    active = [f"{a.name} at its {'lower' if s <= BOUND_MARGIN else 'upper'} bound"
              for a, s in zip(task.variables, z, strict=True) if not BOUND_MARGIN < s < 1 - BOUND_MARGIN]  # fmt: skip
    values = evaluation.constraints[0].reshape(len(problem.constraints), -1)
    active += [str(c) for c, g in zip(problem.constraints, values, strict=True) if g.max() > -ACTIVE_MARGIN]
    return SizedMachine(
        set_parameters(task.machine, design), design, float(evaluation.objective[0]), float(evaluation.violation[0]),
        pd.DataFrame(rows), tuple(active), convergence, tuple(float(w) for w in weighting),
        _warnings(evaluation.status[0]),
    )  # fmt: skip


def _warnings(statuses: np.ndarray) -> tuple[str, ...]:
    """A sentence on each status (cases,) other than OK, with the number of its cases."""
    counts = {Status(int(status)): int(np.sum(statuses == status)) for status in np.unique(statuses)}
    return tuple(
        f"{status}{f' in {count} of {len(statuses)} cases' if len(statuses) > 1 else ''}: {REASONS[status]}"
        for status, count in counts.items() if status is not Status.OK
    )  # fmt: skip


def _check_solvable(problem: SizingProblem, starts: np.ndarray, evaluation: DesignEvaluation) -> None:
    """Raise SizingError unless the starts have finite derivatives, and every goal depends on a design variable."""
    finite = np.isfinite(evaluation.objective)
    if not finite.any():
        raise SizingError(
            "none of the starts gives finite metrics and derivatives: they stall, cavitate or leave the model's range; "
            "move the bounds"
        )
    if not finite[0]:
        nearest = starts[finite][np.argmin(np.abs(starts[finite] - starts[0]).sum(axis=1))]
        nearest = _design_text(problem, {n: v[0] for n, v in problem.designs(nearest[None]).items()})
        raise SizingError("at the start the objective or a derivative is not finite; the nearest design where all "
                          f"are: {nearest}")  # fmt: skip
    for k, metric in enumerate(problem.task.weights):
        if np.abs(evaluation.goal_gradients[finite, k]).max() < MIN_GOAL_GRADIENT:
            names = ", ".join(problem.names)
            raise SizingError(f"objective.{metric}: does not depend on any free dimension ({names}); "
                              "free one that acts on it, or leave it out")  # fmt: skip


def _check_feasible(problem: SizingProblem, machines: list[SizedMachine]) -> None:
    """Raise SizingError unless a machine meets all constraints."""
    if any(m.violation <= FEASIBILITY_TOLERANCE for m in machines):
        return
    best = min(machines, key=lambda m: m.violation)
    violated = []
    for constraint in problem.constraints:
        values = best.metrics[constraint.metric]
        worst = values.max() if constraint.upper else values.min()
        excess = (worst - constraint.value) * (1 if constraint.upper else -1)
        if excess > FEASIBILITY_TOLERANCE * abs(constraint.value):
            violated.append(f"{constraint} ({constraint.text(worst)})")
    design = _design_text(problem, best.design)
    raise SizingError(f"the limits cannot be met together: {'; '.join(violated)} at the nearest design found: {design}")


def _design_text(problem: SizingProblem, design: Mapping[str, float]) -> str:
    """The design variables (SI) as text."""
    return ", ".join(f"{a.name} {format_quantity(design[a.name], a.unit)}" for a in problem.task.variables)
