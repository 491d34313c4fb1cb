"""What forward and reverse mode have in common: settings, the periodic state they begin with, what comes out.

A derivative is that of the periodic state. With Φ the derivative of the state after a cycle by that before it, B that
by the parameters, and m and p those of a metric by state and parameters,

    d(metric)/d(parameters) = p + m (1 + Φ + Φ² + …) B

Designs first run without derivatives until they are periodic. Then the same cycle is gone through again and again, in
forward mode with the sum times B, in reverse mode back with m times the sum, until no further term counts.

Source: Griewank & Walther, Evaluating Derivatives, 2008, chapter 15, on the derivatives of a fixed point.
"""

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from edhas_jax.design.batch.cycle import Lanes
from edhas_jax.design.batch.cycles import run_cycles, told
from edhas_jax.machine.rigs import Rig


@dataclasses.dataclass(frozen=True)
class GradientSettings:
    """How derivatives are computed.

    Every design takes `steps_per_cycle` equal steps per cycle, whatever its frequency: then the frequency scales the
    step, and its derivative is exact as well. The error of a derivative falls with the first power of the step
    (docs/gradients.md). Designs run until flow, power and stroke have changed by less than `tolerance` over two cycles
    in a row; terms are added until they change no elasticity by more than `tolerance` (of 1 or of itself, whichever is
    larger). Neither takes more than `max_cycles`.
    """

    steps_per_cycle: int = 16384
    tolerance: float = 2e-4
    max_cycles: int = 24


class Derivatives(NamedTuple):
    """Metrics of designs and their derivatives, all in SI.

    `values` and `slopes` by metric: (designs,) and (designs, parameters); `status` (designs,) as in a batch. `cycles`
    (designs,) were run until each was periodic, `terms` is how often the last was gone through with derivatives.
    """

    values: dict[str, np.ndarray]
    slopes: dict[str, np.ndarray]
    status: np.ndarray
    cycles: np.ndarray
    terms: int


def periodic(machine: Rig, columns: Mapping[str, np.ndarray], settings: GradientSettings) -> Lanes:
    """The designs of `columns` (SI) after as many cycles as each takes to become periodic."""
    how = settings.steps_per_cycle, np.asarray(settings.tolerance), settings.max_cycles, True
    return run_cycles(machine, columns, *how)


def status(machine: Rig, columns: Mapping[str, np.ndarray], lanes: Lanes, settings, still) -> np.ndarray:
    """What became of each design, as in a batch; those whose derivatives are not `still` are not periodic."""
    steady = (lanes.kept["residual"] <= settings.tolerance) & still
    return np.asarray(told(machine, columns, lanes.kept, steady)["status"], float)


def filled(columns: dict[str, np.ndarray], lanes: int) -> list[tuple[np.ndarray, dict[str, np.ndarray]]]:
    """Blocks of exactly `lanes` designs: their rows, and their columns, the last block filled up with repetitions."""
    count = len(next(iter(columns.values())))
    blocks = []
    for first in range(0, count, lanes):
        rows = np.arange(first, min(first + lanes, count))
        blocks.append((rows, {n: np.resize(column[rows], lanes) for n, column in columns.items()}))
    return blocks


def settled(values, slopes, terms, scales, tolerance: float) -> np.ndarray:
    """Whether the last `terms` of the slopes no longer count, lane by lane, for all metrics; so where no term can help.

    Those are lanes with a slope that is not finite. `values`, `slopes` and `terms` by metric; `scales`: the size of the
    parameter of each lane. All have the shape of `scales`, or are broadcast to it.
    """
    still = np.ones(np.shape(scales), bool)
    for name, value in values.items():
        share = scales / (np.abs(value) + np.finfo(float).tiny)
        still &= np.abs(terms[name]) * share <= tolerance * np.maximum(1.0, np.abs(slopes[name]) * share)
    return still | ~np.all([np.isfinite(slopes[n]) for n in values], axis=0)
