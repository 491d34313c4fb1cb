"""Size a machine: the best design within its bounds and limits, or a front of them."""

import dataclasses
import time
from collections.abc import Callable

import numpy as np
import pandas as pd

from edhas_jax.config.machine_config import ConfigError
from edhas_jax.core.units import format_quantity
from edhas_jax.design.batch.design_table import resolve_parameter
from edhas_jax.design.sizing.config import Sizing
from edhas_jax.design.sizing.optimiser import MET, Ends, descend, polish
from edhas_jax.design.sizing.problem import Judged, Problem
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.metrics import METRICS

COARSE, FINE = 1024, 4096  # steps per cycle of the search and of the last polishing
SEARCHED = 15  # iterations of SLSQP for every start
POLISHED = 3  # best ends that are polished at the fine step
ALIKE = 0.01  # ends within this share of the best count as having found it
ACTIVE = 5e-3  # a limit closer than this share is active


class SizingError(ConfigError):
    """There is no design to be found; the text says why and shows the nearest one."""


@dataclasses.dataclass(frozen=True)
class Sized:
    """A sized machine.

    `design` (SI) by free dimension; `metrics` a row per case (operating point, corner of the tolerances) with the
    columns of the point; `active` the limits and bounds that hold the design back; `objective` is J, the weighted mean
    logarithm; `violation` the largest share by which a limit is exceeded.
    """

    machine: Rig
    design: dict[str, float]
    objective: float
    violation: float
    metrics: pd.DataFrame
    active: tuple[str, ...]
    convergence: str
    weights: tuple[float, ...]


@dataclasses.dataclass(frozen=True)
class SizingResult:
    """The machines of a task: one, or a front by weights; `path` has every start at every iteration.

    `alike` is the share of starts whose end is within 1 % of the best, `machine_seconds` the time simulated, each
    direction of a derivative counted as a run, `seconds` the time that took.
    """

    machines: tuple[Sized, ...]
    start: Sized
    path: pd.DataFrame
    alike: float
    machine_seconds: float
    seconds: float


def size(task: Sizing, on_iteration: Callable[[str, float], None] | None = None) -> SizingResult:
    """Find the best design of a task; `on_iteration(what, share)` is called as it goes.

    Raises:
        SizingError: a goal depends on no free dimension, limits cannot be met together, or no start gives finite
            derivatives; with the nearest design found.
    """
    began = time.perf_counter()

    def report(what: str, share: float) -> None:
        if on_iteration is not None:
            on_iteration(what, share)

    report("compiling", 0.0)
    coarse, fine = Problem(task, COARSE), Problem(task, FINE)
    goals = np.array(list(task.weights.values()))
    weightings = [goals]
    if task.front:
        shares = np.linspace(0.02, 0.98, task.front)
        weightings = [2.0 * goals * np.array([1.0 - s, s]) for s in shares]
    first = coarse.judge(coarse.start()[None])
    starts = _starts(task, coarse)
    _check(task, coarse, coarse.judge(starts))
    every = np.concatenate([starts] * len(weightings))
    weights = np.repeat(weightings, len(starts), axis=0)
    count = len(every)
    ends = descend(
        coarse, every, task.iterations, weights,
        lambda n, best: report(f"descent of {count} starts, J = {best:.4f}", n / task.iterations),
    )  # fmt: skip
    found, path = ends, ends.path
    if not ends.stopped:
        found = polish(
            coarse, ends.shares, SEARCHED, weights,
            lambda n: report(f"search from {count} ends, round {n}", n / (n + SEARCHED)),
        )  # fmt: skip
        found.path["iteration"] += task.iterations
        path = pd.concat([ends.path, found.path], ignore_index=True)
    machines, alike = [], []
    for k, weighting in enumerate(weightings):
        report("polishing", k / len(weightings))
        own = _part(found, k, len(starts))
        alike.append(np.mean((own.violation <= MET) & (own.objective >= own.objective[own.best] - ALIKE)))
        machines.append(_polished(task, fine, own, weighting))
    _check_met(task, fine, machines)
    start = _sized(task, coarse, coarse.start(), first, "the start", goals)
    seconds = coarse.machine_seconds + fine.machine_seconds
    return SizingResult(tuple(machines), start, path, float(np.mean(alike)), seconds, time.perf_counter() - began)


def _starts(task: Sizing, problem: Problem) -> np.ndarray:
    """The machine as it stands, and a Sobol sequence over the bounds."""
    from scipy.stats import qmc

    engine = qmc.Sobol(len(task.free), scramble=True, seed=np.random.default_rng(task.seed))
    rest = engine.random_base2(max(0, int(np.ceil(np.log2(max(task.starts - 1, 1))))))[: task.starts - 1]
    return np.concatenate([problem.start()[None], rest])


def _part(ends: Ends, k: int, count: int) -> Ends:
    at = slice(k * count, (k + 1) * count)
    return dataclasses.replace(ends, shares=ends.shares[at], objective=ends.objective[at], violation=ends.violation[at])


def _polished(task: Sizing, problem: Problem, ends: Ends, weighting) -> Sized:
    """The best ends, polished at the fine step; the best of what that leaves."""
    feasible = ends.violation <= MET
    order = np.lexsort((-ends.objective, np.where(feasible, 0.0, ends.violation)))[:POLISHED]
    weights = np.tile(weighting, (len(order), 1))
    if ends.stopped or not feasible.any():
        z = ends.shares[ends.best]
        told = "interrupted: the best design until then, not polished" if ends.stopped else "no start meets the limits"
        return _sized(task, problem, z, problem.judge(z[None], weights[:1]), told, weighting)
    last = polish(problem, ends.shares[order], SEARCHED, weights)
    z = last.shares[last.best]
    gain = last.objective[last.best] - ends.objective[order[0]]
    told = f"{len(order)} ends polished in {last.path['iteration'].max() + 1} rounds of SLSQP, ΔJ = {gain:+.1e}"
    return _sized(task, problem, z, problem.judge(z[None], weights[:1]), told, weighting)


def _sized(task: Sizing, problem: Problem, z, judged: Judged, told: str, weighting) -> Sized:
    design = {n: float(v[0]) for n, v in problem.values(z[None]).items()}
    rows = []
    for k, (point, corner) in enumerate(problem.cases):
        made = {} if corner is None else {f"{t.name} at": s for t, s in zip(task.tolerances, corner, strict=True)}
        rows.append({**point, **made, **{m: v[0, k] for m, v in judged.values.items()}})
    active = [f"{a.name} at its {'lower' if s <= 1e-4 else 'upper'} bound"
              for a, s in zip(task.free, z, strict=True) if not 1e-4 < s < 1 - 1e-4]  # fmt: skip
    excess = judged.excess[0].reshape(len(problem.limits), -1)
    active += [str(limit) for limit, e in zip(problem.limits, excess, strict=True) if e.max() > -ACTIVE]
    return Sized(
        set_parameters(task.machine, design), design, float(judged.objective[0]), float(judged.violation[0]),
        pd.DataFrame(rows), tuple(active), told, tuple(float(w) for w in weighting),
    )  # fmt: skip


def _check(task: Sizing, problem: Problem, judged: Judged) -> None:
    """Refuse what no search can help."""
    finite = np.isfinite(judged.objective)
    if not finite.any():
        raise SizingError(
            "none of the starts gives finite metrics and derivatives: they stall, cavitate or leave the model's range; "
            "move the bounds"
        )
    if not finite[0]:
        raise SizingError("at the start the objective or a derivative is not finite; the nearest design where all are: "
                          + _told(problem, _nearest(problem, finite)))  # fmt: skip
    for k, metric in enumerate(task.weights):
        if np.abs(judged.goal_slopes[finite, k]).max() < 1e-9:
            names = ", ".join(problem.names)
            raise SizingError(f"objective.{metric}: does not depend on any free dimension ({names}); "
                              "free one that acts on it, or leave it out")  # fmt: skip


def _nearest(problem: Problem, finite: np.ndarray) -> np.ndarray:
    starts = _starts(problem.task, problem)
    return starts[finite][np.argmin(np.abs(starts[finite] - starts[0]).sum(axis=1))]


def _check_met(task: Sizing, problem: Problem, machines: list[Sized]) -> None:
    if any(m.violation <= MET for m in machines):
        return
    best = min(machines, key=lambda m: m.violation)
    broken = []
    for limit in problem.limits:
        values = best.metrics[limit.metric]
        worst = values.max() if limit.upper else values.min()
        if (worst - limit.value) * (1 if limit.upper else -1) > MET * abs(limit.value):
            broken.append(f"{limit} ({format_quantity(worst, METRICS[limit.metric][0])})")
    z = np.array([[best.design[n] for n in problem.names]])
    told = ", ".join(f"{n} {format_quantity(v, resolve_parameter(task.machine, n)[0].unit)}"
                     for n, v in zip(problem.names, z[0], strict=True))  # fmt: skip
    raise SizingError(f"the limits cannot be met together: {'; '.join(broken)} at the nearest design found: {told}")


def _told(problem: Problem, z: np.ndarray) -> str:
    values = problem.values(z[None])
    return ", ".join(f"{n} {format_quantity(v[0], resolve_parameter(problem.task.machine, n)[0].unit)}"
                     for n, v in values.items())  # fmt: skip
