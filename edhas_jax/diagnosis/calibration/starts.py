"""Starting points of a fit, drawn around the prior mean."""

from collections.abc import Sequence

import numpy as np

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
