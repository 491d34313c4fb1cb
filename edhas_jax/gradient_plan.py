"""What forward and reverse mode have in common: settings, blocks of designs, what comes out."""

import dataclasses
from typing import NamedTuple

import numpy as np


@dataclasses.dataclass(frozen=True)
class GradientSettings:
    """How derivatives are computed.

    Every design takes `steps_per_cycle` equal steps per cycle, whatever its frequency: then the frequency scales the
    step, and its derivative is exact as well. The error of a derivative falls with the first power of the step
    (docs/gradients.md). Cycles are run until neither value nor elasticity of a metric changes by more than
    `tolerance` from one to the next (of 1 or of itself, whichever is larger), at least `min_cycles` and at most
    `max_cycles`.
    """

    steps_per_cycle: int = 16384
    tolerance: float = 2e-4
    min_cycles: int = 4
    max_cycles: int = 24


class Derivatives(NamedTuple):
    """Metrics of designs and their derivatives, all in SI.

    `values` and `slopes` by metric: (designs,) and (designs, parameters); `status` (designs,) as in a batch.
    """

    values: dict[str, np.ndarray]
    slopes: dict[str, np.ndarray]
    status: np.ndarray
    cycles: int


def filled(columns: dict[str, np.ndarray], lanes: int) -> list[tuple[np.ndarray, dict[str, np.ndarray]]]:
    """Blocks of exactly `lanes` designs: their rows, and their columns, the last block filled up with repetitions."""
    count = len(next(iter(columns.values())))
    blocks = []
    for first in range(0, count, lanes):
        rows = np.arange(first, min(first + lanes, count))
        blocks.append((rows, {n: np.resize(column[rows], lanes) for n, column in columns.items()}))
    return blocks


def settled(values, slopes, before, scales, tolerance: float) -> np.ndarray:
    """Whether values and elasticities (slope × scale / value) of all metrics have stopped changing, lane by lane.

    `values` and `slopes` by metric, and the same of the cycle `before` (None: there is none); `scales`: the size of the
    parameter of each lane. All have the shape of `scales`, or are broadcast to it.
    """
    if before is None:
        return np.zeros(np.shape(scales), bool)
    still = np.ones(np.shape(scales), bool)
    for name, value in values.items():
        size = np.abs(value) + np.finfo(float).tiny
        elasticity = np.abs(slopes[name] * scales / size)
        change = np.abs(slopes[name] - before[1][name]) * scales / size
        still &= (np.abs(value - before[0][name]) <= tolerance * size)
        still &= change <= tolerance * np.maximum(1.0, elasticity)
    return still
