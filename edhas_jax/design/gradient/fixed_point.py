"""Derivatives of the periodic state as a fixed point: what forward and reverse mode have in common.

A derivative is that of the periodic state. With Φ the derivative of the state after a cycle by that before it, B that
by the parameters, and m and p those of a metric by state and parameters,

    d(metric)/d(parameters) = p + m (1 + Φ + Φ² + …) B

Designs first run without derivatives until they are periodic. Then the same cycle is run repeatedly: in forward mode it
carries the partial sum times B, in reverse mode m times the partial sum, until the next term is below the tolerance.

Source: Griewank & Walther, Evaluating Derivatives, 2008, chapter 15, on the derivatives of a fixed point.
"""

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from edhas_jax.compiler.engines import many_lanes
from edhas_jax.design.batch.batch import BatchSettings
from edhas_jax.design.batch.periodic_solver import BatchState, metrics_with_status, run_to_periodic
from edhas_jax.machine.rigs import Rig


@dataclasses.dataclass(frozen=True)
class GradientSettings:
    """How derivatives are computed.

    Every design takes equally many steps per cycle, whatever its frequency: then the frequency scales the step, and its
    derivative is exact as well. The error of a derivative falls with the first power of the step (docs/gradients.md).

    Attributes:
        steps_per_cycle: time steps in a cycle.
        tolerance: relative change of flow, power and stroke over two cycles in a row below which a design is periodic;
            and change of an elasticity (of 1 or of itself, whichever is larger) below which terms are no longer added.
        max_cycles: most cycles of a design, and most terms.
        run: step, samples and duration of the runs of a rig of one's own, which has no periodic state.
    """

    steps_per_cycle: int = 16384
    tolerance: float = 2e-4
    max_cycles: int = 24
    run: BatchSettings = BatchSettings()


class Derivatives(NamedTuple):
    """Metrics of designs and their derivatives, all in SI.

    Attributes:
        values: metrics by name, (designs,).
        slopes: derivatives by metric, (designs, parameters).
        status: (designs,) as in a batch.
        cycles: (designs,) run until each was periodic.
        terms: terms of the series.
    """

    values: dict[str, np.ndarray]
    slopes: dict[str, np.ndarray]
    status: np.ndarray
    cycles: np.ndarray
    terms: int


def periodic_state(machine: Rig, columns: Mapping[str, np.ndarray], settings: GradientSettings) -> BatchState:
    """The designs of `columns` (SI), each run to its periodic state."""
    options = settings.steps_per_cycle, np.asarray(settings.tolerance), settings.max_cycles, True
    on_gpu = many_lanes(len(next(iter(columns.values()))), float)
    return run_to_periodic(machine, columns, *options, many_lanes=on_gpu)


def status_of(machine: Rig, columns: Mapping[str, np.ndarray], state: BatchState, settings, converged) -> np.ndarray:
    """The status (designs,) as in a batch; designs whose derivatives have not `converged` count as not periodic."""
    steady = (state.metrics["residual"] <= settings.tolerance) & converged
    return np.asarray(metrics_with_status(machine, columns, state.metrics, steady)["status"], float)


def series_converged(values, slopes, terms, scales, tolerance: float) -> np.ndarray:
    """True where the last term of the series is below the tolerance for every metric, or a slope is not finite.

    Args:
        values: metrics by name. All arrays have the shape of `scales` or are broadcast to it.
        slopes: derivatives of the metrics, summed up to the last term.
        terms: that last term.
        scales: size of the parameter of each lane.
        tolerance: change of an elasticity, of 1 or of itself, whichever is larger.
    """
    still = np.ones(np.shape(scales), bool)
    for name, value in values.items():
        share = scales / (np.abs(value) + np.finfo(float).tiny)
        still &= np.abs(terms[name]) * share <= tolerance * np.maximum(1.0, np.abs(slopes[name]) * share)
    return still | ~np.all([np.isfinite(slopes[n]) for n in values], axis=0)
