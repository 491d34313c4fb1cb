"""Which causes of the fall can be told apart, and by which readings: every model refitted to every cause, pair by pair.

With r the difference of two machines in what is read, in units of its uncertainty, and x the coordinates of what is not
known exactly, the distance of a cause from another one's model is

    d² = min over x of |r(x)|² + |x|²

It is what the χ² of a refit would rise by, in the mean over the noise; the smaller of both directions counts.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.diagnosis.calibration.least_squares import QuadraticModel, levenberg_marquardt
from edhas_jax.diagnosis.search.candidates import limit_to_prior_bound
from edhas_jax.machine.rigs import PumpBench
from edhas_jax.measurements.unknown_parameters import relative_unknown
from edhas_jax.simulation.batch_trajectories import march_lanes
from studies.flow_drop.causes import Sized
from studies.paper.readings import RUN_IN, STEP

POINTS, FINER = 40, 5  # read from a cycle; the mean flow is taken over more of them
MODEL_ERROR = 0.01  # of a signal's range or of a mean flow: no model of a real bench is exact to more
FLOW_FLOOR = 0.01 / 6e4  # m³/s; a flow meter at small flow
NOISE = {  # of the sensors, SI
    "piston_position": 5e-6, "current": 0.02, "outlet_pressure": 1.5e3, "chamber_pressure_a": 5e3,
}  # fmt: skip
MEAN_FLOW = "mean_flow"
READINGS = (MEAN_FLOW, *NOISE)
UNCERTAIN = {  # relative standard deviations; the valves are known to a factor of two, as the paper prints nothing
    "load_orifice_area": 0.03, "air_fraction": 0.4, "oil_viscosity": 0.15, "valve_damping": 0.15, "valve_mass": 0.7,
    "valve_spring_rate": 0.7, "valve_preload": 0.1, "accumulator_pressure": 0.05, "coulomb_friction": 0.25,
    "force_constant": 0.02, "pump_damping": 0.3,
}  # fmt: skip
LATE = "late valves"  # may be in every model
SIZE = 0.7  # logarithmic standard deviation of a cause's size: a factor of two
CLEAR = 5.0  # standard deviations from which two causes are told apart
STEPS = 8  # of a refit


class Run(NamedTuple):
    """Conditions of a run: frequency [Hz] and amplitude [m]."""

    frequency: float
    amplitude: float


CURVE = tuple(Run(f, 3.5e-3) for f in (10.0, 20.0, 27.0, 32.0, 38.0, 45.0))
TO_THE_KNEE = tuple(Run(f, 3.5e-3) for f in (10.0, 15.0, 20.0, 25.0, 30.0))
MENU = tuple(Run(f, a) for f in (10.0, 20.0, 25.0, 30.0, 35.0, 40.0) for a in (2.5e-3, 3.5e-3))


class Rows(NamedTuple):
    """What is read: by reading (lanes, runs, points), and slopes with a last axis of unknowns."""

    values: dict[str, np.ndarray]
    slopes: dict[str, np.ndarray] | None


class Suspected:
    """The machine of a cause at its size, with what is not known of it as unknowns, its size first."""

    def __init__(self, base: PumpBench, sized: Sized):
        self.title, self.machine = sized.cause.title, sized.cause.machine(base)
        name = sized.cause.name
        size = dataclasses.replace(relative_unknown(self.machine, name, SIZE), centre=sized.size)
        known = [relative_unknown(self.machine, n, spread) for n, spread in UNCERTAIN.items() if n != name]
        self.unknowns = [limit_to_prior_bound(u) for u in (size, *known)]

    def read(self, x: np.ndarray, runs: Sequence[Run], derive: bool) -> Rows:
        """What is read at the rows of coordinates `x` (k, n)."""
        many = len(self.unknowns) if derive else 1
        columns = {u.name: np.repeat(u.value(x[:, j]), many) for j, u in enumerate(self.unknowns)}
        seeds = {n: np.zeros(len(x) * many) for n in columns} if derive else None
        if derive:
            for j, u in enumerate(self.unknowns):
                seeds[u.name][j::many] = u.derivative(x[:, j])
        found = [_cycle(self.machine, columns, seeds, run) for run in runs]
        values = {n: np.stack([v[n][:, ::many].T for v, _ in found], axis=1) for n in READINGS}
        if not derive:
            return Rows(values, None)
        apart = [{n: np.moveaxis(s[n].reshape(-1, len(x), many), 0, 1) for n in READINGS} for _, s in found]
        return Rows(values, {n: np.stack([s[n] for s in apart], axis=1) for n in READINGS})

    def as_sized(self, runs: Sequence[Run], derive: bool) -> Rows:
        """What is read with everything as it was sized."""
        return self.read(np.zeros((1, len(self.unknowns))), runs, derive)


def _cycle(machine: PumpBench, columns, seeds, run: Run) -> tuple[dict, dict | None]:
    """Readings of one settled cycle and their derivatives along the seeds, (points, lanes)."""
    samples = POINTS * FINER
    interval = 1.0 / (run.frequency * samples)
    per_sample = math.ceil(interval / STEP)
    conditions = {n: np.full(len(next(iter(columns.values()))), v) for n, v in run._asdict().items()}
    length = (math.ceil(RUN_IN * run.frequency) + 1) * samples
    watch = ("outlet_flow", *NOISE)
    found = march_lanes(machine, columns | conditions, seeds, interval / per_sample, per_sample, length, watch)
    return tuple(part and _readings({n: v[-samples:] for n, v in part.items()}) for part in found)


def _readings(cycle: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {MEAN_FLOW: cycle["outlet_flow"].mean(axis=0, keepdims=True)} | {n: cycle[n][::FINER] for n in NOISE}


class Goal(NamedTuple):
    """What a cause reads (runs, points), and the standard deviation of every reading: its sensor's and any model's."""

    values: dict[str, np.ndarray]
    deviations: dict[str, np.ndarray]


def goal_of(truth: Rows) -> Goal:
    """What lane 0 reads as what a model has to reach."""
    values = {n: v[0] for n, v in truth.values.items()}
    deviations = {MEAN_FLOW: np.hypot(FLOW_FLOOR, MODEL_ERROR * np.abs(values[MEAN_FLOW]))}
    for n, noise in NOISE.items():
        deviations[n] = np.hypot(noise, MODEL_ERROR * np.ptp(values[n], axis=-1, keepdims=True))
    return Goal(values, deviations)


@dataclasses.dataclass(frozen=True)
class Parting:
    """Distances by what is read beside the mean flow (or "mean_flow" alone), each (causes, models).

    NaN where cause and model are the same, and where the model has the cause too: late valves.
    """

    titles: tuple[str, ...]
    distances: dict[str, np.ndarray]

    def pairs(self, reading: str) -> dict[tuple[str, str], float]:
        """The smaller distance of both directions, by pair."""
        d = self.distances[reading]
        every = itertools.combinations(range(len(self.titles)), 2)
        return {(self.titles[a], self.titles[b]): float(np.nanmin((d[a, b], d[b, a]))) for a, b in every}

    def parted(self, reading: str) -> int:
        """How many pairs it tells apart."""
        return sum(d > CLEAR for d in self.pairs(reading).values())


def part(
    suspects: Sequence[Suspected], runs: Sequence[Run] = CURVE, say: Callable[[str], None] = lambda sentence: None
) -> Parting:
    """Refit the model of every suspect to the mean flow of every other one, and ask what one more signal would add.

    All distances are those of least squares that are linear around that refit, in which no change of a parameter is too
    large: what they part is parted.
    """
    goals = [goal_of(s.as_sized(runs, derive=False)) for s in suspects]
    count = len(suspects)
    distances = {name: np.full((count, count), np.nan) for name in READINGS}
    for b, model in enumerate(suspects):
        others = [a for a in range(count) if _apart(suspects[a], model)]
        if not others:
            continue
        say(f"refitting the mean flow with {model.title}")
        x = _refitted(model, [goals[a] for a in others], runs)
        found = model.read(x, runs, derive=True)
        for name in READINGS:
            for k, a in enumerate(others):
                readings = dict.fromkeys((MEAN_FLOW, name))
                distances[name][a, b] = _left(*_whitened(found, k, goals[a], readings), x[k])
    return Parting(tuple(s.title for s in suspects), distances)


def _apart(cause: Suspected, model: Suspected) -> bool:
    """Whether a model lacks a cause: as the valves are free, they may be late in every model."""
    return cause is not model and cause.title != LATE


def _whitened(found: Rows, k: int, goal: Goal, readings) -> tuple[np.ndarray, np.ndarray]:
    """Difference (n,) of lane `k` from a goal and its slopes (n, unknowns), in units of uncertainty."""
    r = [((found.values[n][k] - goal.values[n]) / goal.deviations[n]).ravel() for n in readings]
    j = [found.slopes[n][k] / goal.deviations[n][..., None] for n in readings]
    return np.concatenate(r), np.concatenate([s.reshape(-1, s.shape[-1]) for s in j])


def _left(r: np.ndarray, j: np.ndarray, x: np.ndarray) -> float:
    """√ min over δ of |r + J δ|² + |x + δ|²."""
    tall, right = np.vstack([j, np.eye(len(x))]), np.concatenate([r, x])
    return float(np.linalg.norm(right - tall @ np.linalg.lstsq(tall, right, rcond=None)[0]))


def _refitted(model: Suspected, goals: Sequence[Goal], runs: Sequence[Run]) -> np.ndarray:
    """Coordinates of a model that come nearest to the mean flow of each goal, (goals, unknowns)."""

    def evaluate(x, which):
        found = model.read(x, runs, derive=True)
        rows = [_whitened(found, k, goals[goal], (MEAN_FLOW,)) for k, goal in enumerate(which)]
        return QuadraticModel(
            np.array([0.5 * (r @ r + at @ at) for (r, _), at in zip(rows, x, strict=True)]),
            np.stack([j.T @ r + at for (r, j), at in zip(rows, x, strict=True)]),
            np.stack([j.T @ j + np.eye(x.shape[1]) for _, j in rows]),
        )

    low, high = np.array([u.bounds() for u in model.unknowns]).T
    return levenberg_marquardt(evaluate, np.zeros((len(goals), len(low))), low, high, tolerance=0.1, max_steps=STEPS).x


class Settling(NamedTuple):
    """A single run and one signal of it that part every pair: the distance of the pair that is nearest."""

    run: Run
    reading: str
    distance: float


def settling(suspects: Sequence[Suspected], runs: Sequence[Run] = MENU) -> list[Settling]:
    """Every run and signal by the smallest distance that it leaves between two suspects, the best first.

    Distances are linear around the machines as they were sized; what is uncertain may move with its prior.
    """
    rows = [s.as_sized(runs, derive=True) for s in suspects]
    goals = [goal_of(r) for r in rows]
    every = itertools.permutations(range(len(suspects)), 2)
    pairs = [(a, b) for a, b in every if _apart(suspects[a], suspects[b])]
    still = [np.zeros(len(s.unknowns)) for s in suspects]
    out = []
    for (m, run), name in itertools.product(enumerate(runs), READINGS):
        one = [Rows(*({name: v[name][:, m : m + 1]} for v in r)) for r in rows]
        wanted = [Goal(*({name: v[name][m : m + 1]} for v in g)) for g in goals]
        apart = min(_left(*_whitened(one[b], 0, wanted[a], (name,)), still[b]) for a, b in pairs)
        out.append(Settling(run, name, apart))
    return sorted(out, key=lambda s: -s.distance)
