"""Which causes of the flow drop are distinguishable, and by which readings: each model is refitted to each cause.

With r the difference of two machines in their readings, divided by the uncertainty of these, and x the coordinates of
the uncertain parameters, the distance of a cause from the model of another one is

    d² = min over x of |r(x)|² + |x|²

This is the expected increase of the χ² of a refit; the distance of a pair is the smaller one of both directions.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.inference.fit.fit_problem import limit_to_prior_bound
from edhas_jax.inference.fit.least_squares import QuadraticModel, levenberg_marquardt
from edhas_jax.machine.rigs import PumpBench
from edhas_jax.measurements.campaign import Spread
from edhas_jax.measurements.unknown_parameters import unknown_around
from edhas_jax.simulation.batch_trajectories import simulate_batch
from studies.flow_drop.causes import SizedCause
from studies.paper.readings import RUN_IN, STEP

POINTS_PER_CYCLE, SUBSAMPLES = 40, 5  # points of a cycle that are read; samples per point for the mean flow
MODEL_ERROR = 0.01  # of a signal's range or of a mean flow: assumed error of any model of a real bench
FLOW_NOISE = 0.01 / 6e4  # m³/s; uncertainty of a flow meter at small flow
SENSOR_NOISE = {  # of the sensors, SI
    "piston_position": 5e-6, "current": 0.02, "outlet_pressure": 1.5e3, "chamber_pressure_a": 5e3,
}  # fmt: skip
MEAN_FLOW = "mean_flow"
READINGS = (MEAN_FLOW, *SENSOR_NOISE)
UNCERTAIN = {  # relative standard deviations; the valves are known to a factor of two, as the paper prints nothing
    "load_orifice_area": 0.03, "air_fraction": 0.4, "oil_viscosity": 0.15, "valve_damping": 0.15, "valve_mass": 0.7,
    "valve_spring_rate": 0.7, "valve_preload": 0.1, "accumulator_pressure": 0.05, "coulomb_friction": 0.25,
    "force_constant": 0.02, "pump_damping": 0.3,
}  # fmt: skip
LATE_VALVES = "late valves"  # possible in every model, as the valves are uncertain in all
SIZE_SPREAD = 0.7  # logarithmic standard deviation of a cause's size: a factor of two
MIN_DISTANCE = 5.0  # standard deviations; at larger distances two causes are distinguishable
MAX_REFIT_STEPS = 8


class Run(NamedTuple):
    """Conditions of a run: frequency [Hz] and amplitude [m]."""

    frequency: float
    amplitude: float


RUNS_TO_45_HZ = tuple(Run(f, 3.5e-3) for f in (10.0, 20.0, 27.0, 32.0, 38.0, 45.0))
RUNS_TO_30_HZ = tuple(Run(f, 3.5e-3) for f in (10.0, 15.0, 20.0, 25.0, 30.0))
CANDIDATE_RUNS = tuple(Run(f, a) for f in (10.0, 20.0, 25.0, 30.0, 35.0, 40.0) for a in (2.5e-3, 3.5e-3))


class Readings(NamedTuple):
    """The readings by name, (lanes, runs, points), and their derivatives, with a last axis of unknowns."""

    values: dict[str, np.ndarray]
    slopes: dict[str, np.ndarray] | None


class CauseModel:
    """The machine of a cause with its uncertain parameters as unknowns, the size of the cause first."""

    def __init__(self, base: PumpBench, sized: SizedCause):
        self.title, self.machine = sized.cause.title, sized.cause.machine(base)
        name = sized.cause.name
        size = dataclasses.replace(unknown_around(self.machine, name, Spread(SIZE_SPREAD)), centre=sized.size)
        known = [unknown_around(self.machine, n, Spread(spread)) for n, spread in UNCERTAIN.items() if n != name]
        self.unknowns = [limit_to_prior_bound(u) for u in (size, *known)]

    def read(self, x: np.ndarray, runs: Sequence[Run], derive: bool) -> Readings:
        """The readings at the coordinates `x` (lanes, unknowns), with their derivatives if `derive`."""
        many = len(self.unknowns) if derive else 1
        columns = {u.name: np.repeat(u.value(x[:, j]), many) for j, u in enumerate(self.unknowns)}
        seeds = {n: np.zeros(len(x) * many) for n in columns} if derive else None
        if derive:
            for j, u in enumerate(self.unknowns):
                seeds[u.name][j::many] = u.derivative(x[:, j])
        found = [_cycle(self.machine, columns, seeds, run) for run in runs]
        values = {n: np.stack([v[n][:, ::many].T for v, _ in found], axis=1) for n in READINGS}
        if not derive:
            return Readings(values, None)
        by_lane = [{n: np.moveaxis(s[n].reshape(-1, len(x), many), 0, 1) for n in READINGS} for _, s in found]
        return Readings(values, {n: np.stack([s[n] for s in by_lane], axis=1) for n in READINGS})

    def at_size(self, runs: Sequence[Run], derive: bool) -> Readings:
        """The readings at the size of the cause and the nominal values of the other unknowns."""
        return self.read(np.zeros((1, len(self.unknowns))), runs, derive)


def _cycle(machine: PumpBench, columns, seeds, run: Run) -> tuple[dict, dict | None]:
    """Readings of one settled cycle and their derivatives along the seeds, (points, lanes)."""
    samples = POINTS_PER_CYCLE * SUBSAMPLES
    interval = 1.0 / (run.frequency * samples)
    per_sample = math.ceil(interval / STEP)
    conditions = {n: np.full(len(next(iter(columns.values()))), v) for n, v in run._asdict().items()}
    length = (math.ceil(RUN_IN * run.frequency) + 1) * samples
    watch = ("outlet_flow", *SENSOR_NOISE)
    found = simulate_batch(machine, columns | conditions, seeds, interval / per_sample, per_sample, length, watch)
    return tuple(part and _readings({n: v[-samples:] for n, v in part.items()}) for part in found)


def _readings(cycle: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    flow = cycle["outlet_flow"].mean(axis=0, keepdims=True)
    return {MEAN_FLOW: flow} | {n: cycle[n][::SUBSAMPLES] for n in SENSOR_NOISE}


class Target(NamedTuple):
    """The readings of a cause (runs, points), and their standard deviations: sensor noise and model error."""

    values: dict[str, np.ndarray]
    deviations: dict[str, np.ndarray]


def target_of(truth: Readings) -> Target:
    """The readings of lane 0 as the target of a refit."""
    values = {n: v[0] for n, v in truth.values.items()}
    deviations = {MEAN_FLOW: np.hypot(FLOW_NOISE, MODEL_ERROR * np.abs(values[MEAN_FLOW]))}
    for n, noise in SENSOR_NOISE.items():
        deviations[n] = np.hypot(noise, MODEL_ERROR * np.ptp(values[n], axis=-1, keepdims=True))
    return Target(values, deviations)


@dataclasses.dataclass(frozen=True)
class Discrimination:
    """Distances by the reading that is used beside the mean flow ("mean_flow": alone), each (causes, models).

    NaN where cause and model are the same, and where the model contains the cause as well: late valves.
    """

    titles: tuple[str, ...]
    distances: dict[str, np.ndarray]

    def pairs(self, reading: str) -> dict[tuple[str, str], float]:
        """The smaller distance of both directions, by pair."""
        d = self.distances[reading]
        every = itertools.combinations(range(len(self.titles)), 2)
        return {(self.titles[a], self.titles[b]): float(np.nanmin((d[a, b], d[b, a]))) for a, b in every}

    def distinguishable_pairs(self, reading: str) -> int:
        """The number of pairs that are distinguishable."""
        return sum(d > MIN_DISTANCE for d in self.pairs(reading).values())


def discriminate(
    suspects: Sequence[CauseModel],
    runs: Sequence[Run] = RUNS_TO_45_HZ,
    on_progress: Callable[[str], None] = lambda message: None,
) -> Discrimination:
    """Refit the model of each cause to the mean flow of each other one, and evaluate the gain by one more signal.

    All distances are those of a least-squares problem linearised around that refit, in which parameters may change
    without limit: they tend to be too small rather than too large.
    """
    targets = [target_of(s.at_size(runs, derive=False)) for s in suspects]
    count = len(suspects)
    distances = {name: np.full((count, count), np.nan) for name in READINGS}
    for b, model in enumerate(suspects):
        others = [a for a in range(count) if _is_alternative(suspects[a], model)]
        if not others:
            continue
        on_progress(f"refitting the mean flow with {model.title}")
        x = _refit(model, [targets[a] for a in others], runs)
        found = model.read(x, runs, derive=True)
        for name in READINGS:
            for k, a in enumerate(others):
                readings = dict.fromkeys((MEAN_FLOW, name))
                distances[name][a, b] = _distance(*_normalised_residuals(found, k, targets[a], readings), x[k])
    return Discrimination(tuple(s.title for s in suspects), distances)


def _is_alternative(cause: CauseModel, model: CauseModel) -> bool:
    """Whether a model does not contain a cause; late valves are contained in every model."""
    return cause is not model and cause.title != LATE_VALVES


def _normalised_residuals(found: Readings, k: int, target: Target, readings) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (n,) of lane `k` and their derivatives (n, unknowns), divided by the standard deviations."""
    r = [((found.values[n][k] - target.values[n]) / target.deviations[n]).ravel() for n in readings]
    j = [found.slopes[n][k] / target.deviations[n][..., None] for n in readings]
    return np.concatenate(r), np.concatenate([s.reshape(-1, s.shape[-1]) for s in j])


def _distance(r: np.ndarray, j: np.ndarray, x: np.ndarray) -> float:
    """√ min over δ of |r + J δ|² + |x + δ|²."""
    matrix, right_side = np.vstack([j, np.eye(len(x))]), np.concatenate([r, x])
    return float(np.linalg.norm(right_side - matrix @ np.linalg.lstsq(matrix, right_side, rcond=None)[0]))


def _refit(model: CauseModel, targets: Sequence[Target], runs: Sequence[Run]) -> np.ndarray:
    """Coordinates of a model that best fit the mean flow of each target, (targets, unknowns)."""

    def evaluate(x, which):
        found = model.read(x, runs, derive=True)
        rows = [_normalised_residuals(found, k, targets[target], (MEAN_FLOW,)) for k, target in enumerate(which)]
        return QuadraticModel(
            np.array([0.5 * (r @ r + at @ at) for (r, _), at in zip(rows, x, strict=True)]),
            np.stack([j.T @ r + at for (r, j), at in zip(rows, x, strict=True)]),
            np.stack([j.T @ j + np.eye(x.shape[1]) for _, j in rows]),
        )

    low, high = np.array([u.bounds() for u in model.unknowns]).T
    start = np.zeros((len(targets), len(low)))
    return levenberg_marquardt(evaluate, start, low, high, tolerance=0.1, max_steps=MAX_REFIT_STEPS).x


class DecisiveRun(NamedTuple):
    """A single run, one signal of it, and the smallest distance between any two causes by them."""

    run: Run
    reading: str
    distance: float


def rank_runs(suspects: Sequence[CauseModel], runs: Sequence[Run] = CANDIDATE_RUNS) -> list[DecisiveRun]:
    """All runs and signals, sorted by the smallest distance between any two causes, the largest first.

    Distances are linearised around the sized machines; uncertain parameters are fitted under their priors.
    """
    rows = [s.at_size(runs, derive=True) for s in suspects]
    targets = [target_of(r) for r in rows]
    every = itertools.permutations(range(len(suspects)), 2)
    pairs = [(a, b) for a, b in every if _is_alternative(suspects[a], suspects[b])]
    nominal = [np.zeros(len(s.unknowns)) for s in suspects]
    out = []
    for (m, run), name in itertools.product(enumerate(runs), READINGS):
        one = [Readings(*({name: v[name][:, m : m + 1]} for v in r)) for r in rows]
        wanted = [Target(*({name: v[name][m : m + 1]} for v in g)) for g in targets]
        smallest = min(_distance(*_normalised_residuals(one[b], 0, wanted[a], (name,)), nominal[b]) for a, b in pairs)
        out.append(DecisiveRun(run, name, smallest))
    return sorted(out, key=lambda s: -s.distance)
