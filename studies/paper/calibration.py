"""Calibration of the quantities that the paper does not state, so that our pump has the paper's simulated figures.

Nonlinear least squares over `published_numbers.CALIBRATED_QUANTITIES` within their ranges: the difference of each
figure from the paper's simulation, divided by its tolerated deviation, and a weak Tikhonov regularisation towards the
middle of the ranges, which makes the problem well-posed. The 15 mm step and the leakage are not fitted but predicted.
"""

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.inference.fit.least_squares import QuadraticModel, levenberg_marquardt
from edhas_jax.inference.likelihood.symmetric_matrices import regularised_inverse
from edhas_jax.machine.parameters import get_parameter
from edhas_jax.machine.rigs import PumpBench
from studies.paper.published_numbers import CALIBRATED_QUANTITIES, CALIBRATION_TARGETS, with_derived_parameters
from studies.paper.readings import LPM, settled_cycle, tracking

REGULARISATION_WEIGHT = 2.0  # residual of a quantity whose distance from the middle of its range is the whole range
FLOW_FREQUENCIES = (10.0, 20.0, 28.0, 30.0, 32.0)
NAMES = tuple(o.name for o in CALIBRATED_QUANTITIES)
LOW, SPAN = np.array([o.low for o in CALIBRATED_QUANTITIES]), np.log([o.high / o.low for o in CALIBRATED_QUANTITIES])
STARTS = np.array([[0.5] * len(NAMES), *(np.random.default_rng(k).random(len(NAMES)) for k in (1, 2, 3))])


@dataclasses.dataclass(frozen=True)
class Calibrated:
    """The result of the calibration.

    Attributes:
        chosen: the calibrated quantities, SI.
        reached: the fitted figures of the calibrated machine.
        sensitivities: (figures, quantities) change of a figure, in units of its tolerated deviation, as a quantity
            goes through its range.
        errors: relative standard deviation of each quantity.
        squared_sums: sum of squares at which the iteration from each start ended.
        steps: number of iterations from all starts.
    """

    chosen: dict[str, float]
    reached: dict[str, float]
    sensitivities: np.ndarray
    errors: dict[str, float]
    squared_sums: np.ndarray
    steps: int


def quantities_at(x) -> dict:
    """The calibrated quantities (SI) at coordinates 0 … 1, logarithmic over their ranges."""
    return dict(zip(NAMES, LOW * jnp.exp(SPAN * x), strict=True))


@jax.jit
def _parameters_and_tangents(x):
    """The parameters (SI) at coordinates and their derivatives by each of them, both with one row per coordinate."""

    def parameters(x):
        return with_derived_parameters(quantities_at(x))

    return jax.vmap(lambda seed: jax.jvp(parameters, (x,), (seed,)))(jnp.eye(len(x)))


@jax.jit
def _tracking_and_tangents(cycle, slopes, amplitude):
    """The figures of `tracking` and their derivatives, by column of `cycle` and `slopes`."""
    return jax.vmap(lambda c, s: jax.jvp(lambda x: tracking(x, amplitude), (c,), (s,)), in_axes=(1, 1))(cycle, slopes)


def targets_at(machine: PumpBench, x: np.ndarray) -> tuple[dict[str, float], np.ndarray]:
    """The fitted figures at coordinates `x`, and their derivatives, (figures, coordinates)."""
    table, seeds = jax.device_get(_parameters_and_tangents(x))
    flow, flow_slopes = {}, {}
    for f in FLOW_FREQUENCIES:
        cycle, slopes = settled_cycle(machine, table, f, seeds)
        flow[f], flow_slopes[f] = (LPM * part["outlet_flow"].mean(axis=0) for part in (cycle, slopes))
        if f == FLOW_FREQUENCIES[0]:
            amplitude = float(get_parameter(machine, "amplitude"))
            figures, derivatives = jax.device_get(_tracking_and_tangents(cycle, slopes, amplitude))
    ratio = flow[20.0] / (2.0 * flow[10.0])
    tilt = 7.5 * (flow[32.0] - flow[28.0]) / flow[30.0]
    figures |= {"proportion": ratio, "slope": tilt}
    derivatives |= {
        "proportion": ratio * (flow_slopes[20.0] / flow[20.0] - flow_slopes[10.0] / flow[10.0]),
        "slope": 7.5 * (flow_slopes[32.0] - flow_slopes[28.0]) / flow[30.0] - tilt * flow_slopes[30.0] / flow[30.0],
    }
    values = {n: float(figures[n][0]) for n in CALIBRATION_TARGETS}
    return values, np.stack([derivatives[n] for n in CALIBRATION_TARGETS])


def residuals(machine: PumpBench, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Residuals of the figures, then those of the regularisation; and their derivatives."""
    reached, slopes = targets_at(machine, x)
    target, deviation = np.array([CALIBRATION_TARGETS[n] for n in reached]).T
    differences = (np.array(list(reached.values())) - target) / deviation
    return (
        np.concatenate([differences, REGULARISATION_WEIGHT * (x - 0.5)]),
        np.vstack([slopes / deviation[:, None], REGULARISATION_WEIGHT * np.eye(len(x))]),
    )


def calibrate(machine: PumpBench, on_step: Callable[[int, np.ndarray], None] | None = None) -> Calibrated:
    """Least squares from several starts; `on_step(number, sums of squares)` is called after each iteration."""

    def evaluate(x, which):
        rows = [residuals(machine, point) for point in x]
        return QuadraticModel(
            np.array([0.5 * r @ r for r, _ in rows]),
            np.stack([j.T @ r for r, j in rows]),
            np.stack([j.T @ j for _, j in rows]),
        )

    report = None if on_step is None else lambda number, cost: on_step(number, 2.0 * cost)
    lower, upper = np.zeros(len(NAMES)), np.ones(len(NAMES))
    found = levenberg_marquardt(evaluate, STARTS, lower, upper, tolerance=1e-3, max_steps=25, on_step=report)
    best = int(np.argmin(found.model.cost))
    x = found.x[best]
    reached, slopes = targets_at(machine, x)
    deviation = np.array([CALIBRATION_TARGETS[n][1] for n in reached])
    # Laplace approximation, with the tolerated deviations as standard deviations
    spread = np.sqrt(np.diag(regularised_inverse(found.model.curvature[best]))) * SPAN
    return Calibrated(
        {n: float(v) for n, v in quantities_at(x).items()}, reached, slopes / deviation[:, None],
        dict(zip(NAMES, spread.tolist(), strict=True)), 2.0 * found.model.cost, int(found.steps.sum()),
    )  # fmt: skip
