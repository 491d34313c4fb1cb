"""Tunes the gains of a controller by gradient descent with the same objective, optimiser and budget for each.

    J = mean of  ln(rms error) + 0.2 ln(rms current) + 10 max(0, peak voltage / (0.9 U_max) − 1)²  over sines
           and of  ln(rms error)  over steps

Runs with sines are simulated to their periodic state. One per cent of error weighs as much as five per cent of current,
and a tenth of the supply voltage is kept in reserve. The steps are included because a loop tuned with sines alone may
oscillate or be unstable at rest. Candidates are drawn at random around the default gains; Adam improves the best few in
the logarithms of the gains, all in one batch. A start that becomes unstable, where the derivatives are meaningless,
returns to its last stable gains and continues with a smaller step.
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
from edhas_jax.simulation.batch_trajectories import simulate_batch

OBJECTIVE_METRICS = ("tracking_error", "rms_current", "peak_voltage")
VOLTAGE_SHARE = 0.9  # of the supply voltage, above which the peak voltage is penalised
CURRENT_WEIGHT = 0.2
CANDIDATE_FACTOR = 5.0  # candidates are drawn within this factor of the default gains
MAX_SLOPE = 10.0  # derivatives of J are clipped here; larger ones occur only at the limit of stability
INSTABILITY_MARGIN = 0.3  # rise of J above its best value that counts as loss of stability
STEP_RUN_STEP, STEPS_PER_SAMPLE, STEP_RUN_SAMPLES = 2e-5, 5, 800  # time step [s] and samples of the runs with steps


class TuningTask(NamedTuple):
    """What a controller is tuned for.

    Attributes:
        sine_machine: the machine with a sine as set point.
        sine_runs: parameters of its runs in SI, by name, shape (sine runs,).
        step_machine: the machine with steps.
        step_runs: parameters of its runs in SI, by name, shape (step runs,).
    """

    sine_machine: Rig
    sine_runs: Mapping[str, np.ndarray]
    step_machine: Rig
    step_runs: Mapping[str, np.ndarray]


@dataclasses.dataclass(frozen=True)
class Budget:
    """Effort of the tuning.

    Attributes:
        candidates: gains drawn at random.
        starts: best candidates that are improved.
        iterations: steps of the optimiser.
        steps_per_cycle: time steps per cycle of a sine.
        cycles: cycles to the periodic state, at most.
        learning_rate: largest step in the logarithm of a gain.
    """

    candidates: int = 384
    starts: int = 6
    iterations: int = 40
    steps_per_cycle: int = 2500
    cycles: int = 5
    learning_rate: float = 0.1


class TunedGains(NamedTuple):
    """The best gains (SI), their J, and the lowest J so far at the start and after each iteration."""

    gains: dict[str, float]
    objective: float
    history: np.ndarray


def tune(task: TuningTask, names: tuple[str, ...], budget: Budget, on_iteration: Callable[[float], None]) -> TunedGains:
    """Find the gains `names` of the controller of a task that minimise J.

    Args:
        task: the machines and runs.
        names: parameters of the controller.
        budget: effort of the search.
        on_iteration: called with the finished share after each iteration.
    """
    bounds = np.log([np.clip(find_parameter(task.sine_machine, n)[0].span, 1e-9, 1e12) for n in names])
    defaults = np.log([float(get_parameter(task.sine_machine, n)) for n in names])
    offsets = np.random.default_rng(1).uniform(-1.0, 1.0, (budget.candidates, len(names)))
    offsets = np.log(CANDIDATE_FACTOR) * offsets
    offsets[0] = 0.0  # the defaults themselves
    x = np.clip(defaults + offsets, *bounds.T)
    if budget.candidates > budget.starts:
        x = x[np.argsort(_objective_values(task, names, x, budget))[: budget.starts]]
    adam = optax.scale_by_adam(b2=0.95)
    state, rate = adam.init(x), np.full(len(x), budget.learning_rate)
    values, slopes = objective(task, names, x, budget)
    best, best_x, stable_x, stable_slopes, history = values, x, x, slopes, [values.min()]
    for k in range(budget.iterations):
        with jax.numpy_dtype_promotion("standard"):  # optax mixes integers and floats
            direction, state = adam.update(stable_slopes, state)
        x = np.clip(stable_x - rate[:, None] * np.asarray(direction), *bounds.T)
        values, slopes = objective(task, names, x, budget)
        unstable = ~(values <= best + INSTABILITY_MARGIN)
        rate = np.where(unstable, 0.5 * rate, np.minimum(1.05 * rate, budget.learning_rate))
        stable_x = np.where(unstable[:, None], stable_x, x)
        stable_slopes = np.where(unstable[:, None], stable_slopes, slopes)
        improved = values < best
        best = np.where(improved, values, best)
        best_x = np.where(improved[:, None], x, best_x)
        history.append(best.min())
        on_iteration((k + 1) / budget.iterations)
    gains = np.exp(best_x[int(np.argmin(best))])
    return TunedGains(dict(zip(names, gains.tolist(), strict=True)), float(best.min()), np.array(history))


def objective(task: TuningTask, names: tuple[str, ...], x: np.ndarray, budget: Budget) -> tuple[np.ndarray, np.ndarray]:
    """J and its derivatives with respect to the logarithms of the gains.

    Args:
        task: the machines and runs.
        names: the gains.
        x: logarithms of the gains in SI, shape (starts, gains).
        budget: steps and cycles of the runs with sines.

    Returns:
        J, shape (starts,), inf where a run fails, and its derivatives, shape (starts, gains), clipped to `MAX_SLOPE`.
    """
    columns = _design_columns(names, x, task.sine_runs)
    settings = GradientSettings(budget.steps_per_cycle, 1e-3, budget.cycles)
    got = forward(task.sine_machine, columns, names, OBJECTIVE_METRICS, settings)
    error, current, peak = (got.values[n] for n in OBJECTIVE_METRICS)
    error_slope, current_slope, peak_slope = (got.slopes[n] for n in OBJECTIVE_METRICS)
    limit = _voltage_limit(task.sine_machine)
    excess = np.maximum(peak / limit - 1.0, 0.0)
    slope = error_slope / error[:, None] + CURRENT_WEIGHT * current_slope / current[:, None]
    slope = slope + (20.0 * excess / limit)[:, None] * peak_slope
    slope = slope * np.stack([columns[n] for n in names], axis=1)
    step_terms, step_slopes = _step_terms(task, names, x, derive=True)
    value = np.concatenate([_sine_terms(task, error, current, peak).reshape(len(x), -1), step_terms], axis=1)
    slope = np.concatenate([slope.reshape(len(x), -1, len(names)), step_slopes], axis=1)
    slope = np.nan_to_num(slope.mean(axis=1), nan=0.0, posinf=MAX_SLOPE, neginf=-MAX_SLOPE)
    return value.mean(axis=1), np.clip(slope, -MAX_SLOPE, MAX_SLOPE)


def _objective_values(task: TuningTask, names, x: np.ndarray, budget: Budget) -> np.ndarray:
    """J (candidates,) without derivatives."""
    settings = BatchSettings(step=4e-5, max_cycles=budget.cycles)
    got = run_designs(task.sine_machine, _design_columns(names, x, task.sine_runs), settings)
    sines = _sine_terms(task, *(got[n] for n in OBJECTIVE_METRICS)).reshape(len(x), -1)
    return np.concatenate([sines, _step_terms(task, names, x, derive=False)[0]], axis=1).mean(axis=1)


def _step_terms(task: TuningTask, names, x: np.ndarray, derive: bool) -> tuple[np.ndarray, np.ndarray | None]:
    """ln(rms error) under steps (starts, step runs) and its derivatives (starts, step runs, gains)."""
    columns = _design_columns(names, x, task.step_runs)
    tangents, seeds = len(names) if derive else 1, None
    lanes = {n: np.repeat(v, tangents) for n, v in columns.items()}
    if derive:
        count = len(columns[names[0]])
        seeds = {n: np.tile(np.arange(tangents) == i, count) * lanes[n] for i, n in enumerate(names)}
    signals = ("reference", "piston_position")
    traces = simulate_batch(
        task.step_machine, lanes, seeds, STEP_RUN_STEP, STEPS_PER_SAMPLE, STEP_RUN_SAMPLES, signals
    )
    error = traces.values["piston_position"] - traces.values["reference"]
    square = np.mean(error**2, axis=0)
    value = np.where(np.isfinite(square), 0.5 * np.log(square), np.inf).reshape(len(x), -1, tangents)[:, :, 0]
    if not derive:
        return value, None
    slope = np.mean(error * traces.slopes["piston_position"], axis=0) / square
    return value, slope.reshape(len(x), -1, tangents)


def _design_columns(names, x: np.ndarray, runs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Every set of gains with every run, as columns of a batch, shape (starts × runs,)."""
    count = len(next(iter(runs.values())))
    columns = {n: np.repeat(np.exp(x[:, i]), count) for i, n in enumerate(names)}
    return columns | {n: np.tile(v, len(x)) for n, v in runs.items()}


def _sine_terms(task: TuningTask, error, current, peak) -> np.ndarray:
    """J of single sines; inf where a run failed."""
    excess = np.maximum(peak / _voltage_limit(task.sine_machine) - 1.0, 0.0)
    value = np.log(error) + CURRENT_WEIGHT * np.log(current) + 10.0 * excess**2
    return np.where(np.isfinite(value), value, np.inf)


def _voltage_limit(machine: Rig) -> float:
    """The voltage [V] above which the peak voltage is penalised."""
    return VOLTAGE_SHARE * float(get_parameter(machine, "supply_voltage"))
