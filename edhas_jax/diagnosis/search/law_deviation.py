"""Columns for a deviation of accepted laws from those of the library: what a mechanism explains with another law.

An effect of a bench seldom follows the law of the library to the letter. The difference acts at the same slot, over the
variable that the law follows. A piecewise linear function of it is therefore added, linearly, with a prior of a share
of the law's own magnitude. Whatever these columns reproduce is no reason to add another effect.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.report.nonparametric_term import deviation_columns
from edhas_jax.diagnosis.search.candidates import Candidate

DEVIATION_SHARE = 0.5  # prior standard deviation of the deviation at a node, over the largest magnitude of the law
NODE_COST = 2.0  # nats that each value of a deviation costs


def law_deviation_columns(fit: Fit, accepted: Sequence[Candidate]) -> list[dict[str, np.ndarray]]:
    """The change of the signals by a deviation of each accepted law, by fitted run and signal (samples, k) in SI.

    Args:
        fit: a fit that contains the accepted candidates.
        accepted: these candidates; sensor faults have no law that could deviate.
    """
    runs = fit.problem.model().runs
    parts = [
        found
        for candidate in accepted
        if candidate.signal is None and (found := deviation_columns(fit, candidate, DEVIATION_SHARE)) is not None
    ]
    return [
        {
            n: np.concatenate([np.zeros((len(run.time), 0)), *(part[r][n] for part in parts)], axis=1)
            for n in run.signals
        }
        for r, run in enumerate(runs)
    ]


def deviation_cost(columns: Sequence[Mapping[str, np.ndarray]] | None) -> float:
    """What the values of some deviations cost in log-evidence [nats]; 0 for None."""
    return NODE_COST * max((rows.shape[1] for run in columns or () for rows in run.values()), default=0)
