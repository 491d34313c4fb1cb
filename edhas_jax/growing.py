"""A fit of growing stretches: of the beginning of all runs first, then of more and more of them.

What a wrong value does adds up along a run, and where a motion resonates or cavitates it does so fast: far from the
solution the misfit of whole runs is full of pits, while that of their beginnings is smooth. Each stretch leads to where
the next one is smooth too.

Source: progressive fitting of trajectories, e.g. Voss, Timmer, Kurths, Int. J. Bifurcation Chaos 14 (2004) 1905.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from edhas_jax.campaign import BenchRun
from edhas_jax.fit import Fit, FitError, Problem
from edhas_jax.judged import Judged, descend, search

STRETCHES = (1 / 16, 1 / 8, 1 / 4, 1 / 2)  # shares of each run
SHORTEST = 20  # samples
SMALLER = 0.5  # share of what a fit of whole runs leaves over at their beginnings: one that leaves more sits in a pit
SEEN = 10.0  # times the scatter of χ², from which on what is left over says something


def grown(
    problem: Problem, starts: np.ndarray, per_sample: int, most_steps: int, whole: Judged | None = None
) -> Judged | None:
    """The fit that growing stretches lead to from the `starts` (k, n); None where they fail, or that is no better.

    `whole` is a fit of the whole runs, to be done better. It is taken for good if the beginnings of the runs are not
    fitted clearly better alone, which is found out at little expense.
    """
    runs, at = problem.model().runs, np.atleast_2d(starts)
    parts = [_beginnings(runs, share) for share in STRETCHES]
    lefts = [np.inf if whole is None else _left_over(whole.fit, part) for part in parts]
    if lefts[-1] < SEEN:
        return None
    try:
        for part, left in zip(parts, lefts, strict=True):
            fitted = descend(dataclasses.replace(problem, runs=part), at, per_sample, most_steps)
            if left > SEEN and _left_over(fitted, part) > SMALLER * left:
                return None
            at = fitted.x
        found = search(problem, at, per_sample, most_steps)
    except FitError:
        return None
    return found if whole is None or found.evidence > whole.evidence else None


def _beginnings(runs: Sequence[BenchRun], share: float) -> tuple[BenchRun, ...]:
    """The first `share` of each run."""
    out = []
    for run in runs:
        count = min(max(round(share * len(run.time)), SHORTEST), len(run.time))
        signals = {name: values[:count] for name, values in run.signals.items()}
        out.append(dataclasses.replace(run, time=run.time[:count], signals=signals))
    return tuple(out)


def _left_over(fitted: Fit, part: Sequence[BenchRun]) -> float:
    """How far χ² of a fit lies above what noise gives, in the beginnings of its runs; in units of its scatter."""
    rows = [
        values[: len(run.time)]
        for run, signals in zip(part, fitted.residuals.values(), strict=True)
        for values in signals.values()
    ]
    samples = sum(int(np.isfinite(v).sum()) for v in rows)
    return (sum(float(np.nansum(v * v)) for v in rows) - samples) / np.sqrt(2.0 * max(samples, 1))
