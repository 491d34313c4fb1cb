"""Starting points of a fit, around the prior mean."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import qmc

from edhas_jax.measurements.unknown_parameters import UnknownParameter

START_STD = 0.7  # spread of the random starts around the prior mean, in prior standard deviations


def sample_starts(unknowns: Sequence[UnknownParameter], count: int, seed: int) -> np.ndarray:
    """Draw starting points in coordinates, shape (count, n).

    The first is the prior mean. The others are normal around it, with `START_STD` and clipped at two standard
    deviations; an unknown without a prior but with a finite span is drawn uniformly from that span.
    """
    rng = np.random.default_rng(seed)
    rows = np.zeros((count, len(unknowns)))
    for k, u in enumerate(unknowns):
        low, high = u.bounds()
        if u.has_prior or not np.isfinite(high - low):
            rows[1:, k] = np.clip(START_STD * rng.standard_normal(count - 1), -2.0, 2.0)
        else:
            rows[1:, k] = rng.uniform(low, high, count - 1)
        rows[:, k] = np.clip(rows[:, k], low, high)
    return rows


def spread_points(unknowns: int, count: int, half_width: float) -> np.ndarray:
    """Points of a scrambled Sobol sequence with a fixed seed, around the prior means, as coordinates (count, unknowns).

    Args:
        unknowns: number of unknowns.
        count: number of points, a power of 2.
        half_width: of the cube that they fill, in prior standard deviations.
    """
    return half_width * (2.0 * qmc.Sobol(unknowns, seed=0).random(count) - 1.0)
