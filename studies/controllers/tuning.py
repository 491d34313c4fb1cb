"""Gains of a controller by gradient: the same objective, optimiser and budget for each.

    J = mean of  ln(rms error) + 0.2 ln(rms current) + 10 max(0, peak voltage / (0.9 U_max) − 1)²  over sines
           and of  ln(rms error)  over steps

Sines are run to their periodic state. One per cent of error is worth five per cent of current; a tenth of the supply is
kept in reserve. The steps are there because a loop that is tuned with sines alone may ring, or not be stable at rest.
Of settings drawn at random around the defaults, the best few are descended from side by side, by Adam in the logarithms
of the gains. A start that falls over the edge of stability, where derivatives say nothing, goes back to where it was
best and takes smaller steps from there.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax
import numpy as np
import optax

from edhas_jax.design.batch.batch import BatchSettings, run_designs
from edhas_jax.design.gradient.fixed_point import GradientSettings
from edhas_jax.design.gradient.forward import forward
from edhas_jax.machine.parameters import find_parameter, get_parameter
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.batch_trajectories import march_lanes

METRICS = ("tracking_error", "rms_current", "peak_voltage")
RESERVE = 0.9
CURRENT = 0.2  # weight of the current
RANGE = 5.0  # settings are drawn within this factor of the defaults
STEEPEST = 10.0  # derivatives of J by a logarithm are cut here: what is steeper is the edge of stability
WORSE = 0.3  # a start that is so much above its best has fallen over that edge
STEP, PER_SAMPLE, SAMPLES = 2e-5, 5, 800  # of the runs with steps


class Task(NamedTuple):
    """What a controller is tuned for: the machine under sines and under steps, and the parameters (SI) of each run."""

    sines: Rig
    points: Mapping[str, np.ndarray]
    steps: Rig
    variants: Mapping[str, np.ndarray]


@dataclasses.dataclass(frozen=True)
class Budget:
    """How long is sought: settings drawn, starts among them, iterations; steps per cycle and cycles of each run."""

    drawn: int = 384
    starts: int = 6
    iterations: int = 40
    steps_per_cycle: int = 2500
    cycles: int = 5
    rate: float = 0.1


class Tuned(NamedTuple):
    """The best gains (SI), their J, and the lowest J so far after each iteration."""

    gains: dict[str, float]
    objective: float
    history: np.ndarray


def tune(task: Task, names: tuple[str, ...], budget: Budget, on_iteration: Callable[[float], None]) -> Tuned:
    """The best gains `names` of the controller of a task."""
    bounds = np.log([np.clip(find_parameter(task.sines, n)[0].span, 1e-9, 1e12) for n in names])
    begin = np.log([float(get_parameter(task.sines, n)) for n in names])
    wide = np.log(RANGE) * np.random.default_rng(1).uniform(-1.0, 1.0, (budget.drawn, len(names)))
    wide[0] = 0.0  # the defaults themselves
    x = np.clip(begin + wide, *bounds.T)
    if budget.drawn > budget.starts:
        x = x[np.argsort(_drawn(task, names, x, budget))[: budget.starts]]
    adam = optax.scale_by_adam(b2=0.95)
    state, rate = adam.init(x), np.full(len(x), budget.rate)
    values, slopes = objective(task, names, x, budget)
    best, keep, at, downhill, history = values, x, x, slopes, [values.min()]
    for k in range(budget.iterations):
        with jax.numpy_dtype_promotion("standard"):  # optax mixes whole and real numbers
            direction, state = adam.update(downhill, state)
        x = np.clip(at - rate[:, None] * np.asarray(direction), *bounds.T)
        values, slopes = objective(task, names, x, budget)
        fallen = ~(values <= best + WORSE)
        rate = np.where(fallen, 0.5 * rate, np.minimum(1.05 * rate, budget.rate))
        at = np.where(fallen[:, None], at, x)
        downhill = np.where(fallen[:, None], downhill, slopes)
        lower = values < best
        best = np.where(lower, values, best)
        keep = np.where(lower[:, None], x, keep)
        history.append(best.min())
        on_iteration((k + 1) / budget.iterations)
    gains = np.exp(keep[int(np.argmin(best))])
    return Tuned(dict(zip(names, gains.tolist(), strict=True)), float(best.min()), np.array(history))


def objective(task: Task, names: tuple[str, ...], x: np.ndarray, budget: Budget) -> tuple[np.ndarray, np.ndarray]:
    """J (starts,) and its derivatives (starts, gains) by the logarithms `x` (starts, gains); inf where a run fails."""
    columns = _columns(names, x, task.points)
    settings = GradientSettings(budget.steps_per_cycle, 1e-3, budget.cycles)
    got = forward(task.sines, columns, names, METRICS, settings)
    error, current, peak = (got.values[n] for n in METRICS)
    by_error, by_current, by_peak = (got.slopes[n] for n in METRICS)
    reserve = _reserve(task.sines)
    over = np.maximum(peak / reserve - 1.0, 0.0)
    slope = by_error / error[:, None] + CURRENT * by_current / current[:, None]
    slope = slope + (20.0 * over / reserve)[:, None] * by_peak
    slope = slope * np.stack([columns[n] for n in names], axis=1)
    of_steps, slope_of_steps = _steps(task, names, x, derive=True)
    value = np.concatenate([_value(task, error, current, peak).reshape(len(x), -1), of_steps], axis=1)
    slope = np.concatenate([slope.reshape(len(x), -1, len(names)), slope_of_steps], axis=1)
    slope = np.nan_to_num(slope.mean(axis=1), nan=0.0, posinf=STEEPEST, neginf=-STEEPEST)
    return value.mean(axis=1), np.clip(slope, -STEEPEST, STEEPEST)


def _drawn(task: Task, names, x: np.ndarray, budget: Budget) -> np.ndarray:
    """J (settings,) without derivatives."""
    settings = BatchSettings(step=4e-5, max_cycles=budget.cycles)
    got = run_designs(task.sines, _columns(names, x, task.points), settings)
    sines = _value(task, *(got[n] for n in METRICS)).reshape(len(x), -1)
    return np.concatenate([sines, _steps(task, names, x, derive=False)[0]], axis=1).mean(axis=1)


def _steps(task: Task, names, x: np.ndarray, derive: bool) -> tuple[np.ndarray, np.ndarray | None]:
    """ln(rms error) under steps (settings, variants) and its derivatives (settings, variants, gains)."""
    columns = _columns(names, x, task.variants)
    many, seeds = len(names) if derive else 1, None
    lanes = {n: np.repeat(v, many) for n, v in columns.items()}
    if derive:
        count = len(columns[names[0]])
        seeds = {n: np.tile(np.arange(many) == i, count) * lanes[n] for i, n in enumerate(names)}
    traces = march_lanes(task.steps, lanes, seeds, STEP, PER_SAMPLE, SAMPLES, ("reference", "piston_position"))
    off = traces.values["piston_position"] - traces.values["reference"]
    square = np.mean(off**2, axis=0)
    value = np.where(np.isfinite(square), 0.5 * np.log(square), np.inf).reshape(len(x), -1, many)[:, :, 0]
    if not derive:
        return value, None
    slope = np.mean(off * traces.slopes["piston_position"], axis=0) / square
    return value, slope.reshape(len(x), -1, many)


def _columns(names, x: np.ndarray, points: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    count = len(next(iter(points.values())))
    columns = {n: np.repeat(np.exp(x[:, i]), count) for i, n in enumerate(names)}
    return columns | {n: np.tile(v, len(x)) for n, v in points.items()}


def _value(task: Task, error, current, peak) -> np.ndarray:
    """J of single sines; inf where a run failed."""
    over = np.maximum(peak / _reserve(task.sines) - 1.0, 0.0)
    value = np.log(error) + CURRENT * np.log(current) + 10.0 * over**2
    return np.where(np.isfinite(value), value, np.inf)


def _reserve(machine: Rig) -> float:
    return RESERVE * float(get_parameter(machine, "supply_voltage"))
