"""What the paper does not print, set once so that our pump shows the paper's simulated figures.

Least squares over `published_numbers.FREE` within their ranges: the distance of every aim from the paper's simulation,
in units of the deviation that counts as one, and a weak pull to the middle of the range, which makes the problem
well-posed. The 15 mm step and the leakage take no part: they are predicted.
"""

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.diagnosis.calibration.least_squares import QuadraticModel, levenberg_marquardt
from edhas_jax.machine.parameters import get_parameter
from edhas_jax.machine.rigs import PumpBench
from studies.paper.published_numbers import AIMS, FREE, complete
from studies.paper.readings import LPM, cycle_of, tracking

PULL = 2.0  # residual of a quantity that stands a whole range from the middle of it
FLOW_FREQUENCIES = (10.0, 20.0, 28.0, 30.0, 32.0)
NAMES = tuple(o.name for o in FREE)
LOW, SPAN = np.array([o.low for o in FREE]), np.log([o.high / o.low for o in FREE])
STARTS = np.array([[0.5] * len(FREE), *(np.random.default_rng(k).random(len(FREE)) for k in (1, 2, 3))])


@dataclasses.dataclass(frozen=True)
class Calibrated:
    """Where the least squares ended.

    `chosen` the free quantities (SI), `aims` what is reached, `moves` (aims, quantities) the change of an aim in units
    of its deviation as a quantity goes through its range, `errors` the standard deviation of a quantity as a share of
    itself, `sums` the sums of squares at which the starts ended.
    """

    chosen: dict[str, float]
    aims: dict[str, float]
    moves: np.ndarray
    errors: dict[str, float]
    sums: np.ndarray
    steps: int


def chosen_at(x) -> dict:
    """The free quantities (SI) at coordinates 0 … 1, logarithmic between the ends of their ranges."""
    return dict(zip(NAMES, LOW * jnp.exp(SPAN * x), strict=True))


@jax.jit
def _along(x):
    """The parameters (SI) at coordinates and their derivatives along each of them, both with a row per coordinate."""
    return jax.vmap(lambda seed: jax.jvp(lambda x: complete(chosen_at(x)), (x,), (seed,)))(jnp.eye(len(x)))


@jax.jit
def _tangent(cycle, slopes, amplitude):
    def read(one):
        return tracking(one, amplitude)

    return jax.vmap(lambda c, s: jax.jvp(read, (c,), (s,)), in_axes=(1, 1))(cycle, slopes)


def aims_at(machine: PumpBench, x: np.ndarray) -> tuple[dict[str, float], np.ndarray]:
    """What is aimed at, at coordinates, and its derivatives, (aims, coordinates)."""
    table, seeds = jax.device_get(_along(x))
    flow, moved = {}, {}
    for f in FLOW_FREQUENCIES:
        cycle, slopes = cycle_of(machine, table, f, seeds)
        flow[f], moved[f] = (LPM * part["outlet_flow"].mean(axis=0) for part in (cycle, slopes))
        if f == FLOW_FREQUENCIES[0]:
            seen, turned = jax.device_get(_tangent(cycle, slopes, float(get_parameter(machine, "amplitude"))))
    ratio = flow[20.0] / (2.0 * flow[10.0])
    tilt = 7.5 * (flow[32.0] - flow[28.0]) / flow[30.0]
    seen |= {"proportion": ratio, "slope": tilt}
    turned |= {
        "proportion": ratio * (moved[20.0] / flow[20.0] - moved[10.0] / flow[10.0]),
        "slope": 7.5 * (moved[32.0] - moved[28.0]) / flow[30.0] - tilt * moved[30.0] / flow[30.0],
    }
    return {n: float(seen[n][0]) for n in AIMS}, np.stack([turned[n] for n in AIMS])


def residuals(machine: PumpBench, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances from the aims in units of their deviations, then the pulls; and their derivatives."""
    reached, slopes = aims_at(machine, x)
    goal, deviation = np.array([AIMS[n] for n in reached]).T
    away = (np.array(list(reached.values())) - goal) / deviation
    return (
        np.concatenate([away, PULL * (x - 0.5)]),
        np.vstack([slopes / deviation[:, None], PULL * np.eye(len(x))]),
    )


def calibrate(machine: PumpBench, on_step: Callable[[int, np.ndarray], None] | None = None) -> Calibrated:
    """Least squares from several starts; `on_step(number, sums of squares)` reports."""

    def evaluate(x, which):
        rows = [residuals(machine, point) for point in x]
        return QuadraticModel(
            np.array([0.5 * r @ r for r, _ in rows]),
            np.stack([j.T @ r for r, j in rows]),
            np.stack([j.T @ j for _, j in rows]),
        )

    told = None if on_step is None else lambda number, cost: on_step(number, 2.0 * cost)
    zero, one = np.zeros(len(FREE)), np.ones(len(FREE))
    found = levenberg_marquardt(evaluate, STARTS, zero, one, tolerance=1e-3, max_steps=25, on_step=told)
    best = int(np.argmin(found.model.cost))
    x = found.x[best]
    reached, slopes = aims_at(machine, x)
    deviation = np.array([AIMS[n][1] for n in reached])
    # a Gaussian with the curvature of the sum of squares: the deviations count as standard deviations
    spread = np.sqrt(np.diag(np.linalg.inv(found.model.curvature[best]))) * SPAN
    return Calibrated(
        {n: float(v) for n, v in chosen_at(x).items()}, reached, slopes / deviation[:, None],
        dict(zip(NAMES, spread.tolist(), strict=True)), 2.0 * found.model.cost, int(found.steps.sum()),
    )  # fmt: skip
