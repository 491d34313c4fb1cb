"""A fit of growing stretches: of the beginning of all runs first, then of more and more of them.

What a wrong value does adds up along a run, and where a motion resonates, cavitates or sticks it does so fast: far from
the solution the misfit of whole runs is full of pits, while that of their beginnings is smooth. Each stretch leads to
where the next one is smooth too.

Source: progressive fitting of trajectories, e.g. Voss, Timmer, Kurths, Int. J. Bifurcation Chaos 14 (2004) 1905.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import qmc

from edhas_jax.diagnosis.calibration.fit import FitError, FitProblem
from edhas_jax.diagnosis.search.evaluated_fit import Judged, minima, search
from edhas_jax.measurements.campaign import BenchRun
from edhas_jax.measurements.measurement_model import EvaluationPoint
from edhas_jax.measurements.residuals import normalised_residuals
from edhas_jax.measurements.time_resolution import choose_time_resolution

STRETCHES = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2)  # shares of each run
SCANNED, RESOLVED = 1, 3  # the stretches on which sizes are scanned, and that the step has to serve
SHORTEST = 20  # samples
SIZES, LINE, WIDE = 64, 25, 3.0  # scanned values of a suspect's parameters, of a single one, and their spread
KEPT = 3  # ends of a stretch that the next one starts from
SMALLER = 0.5  # share of what a fit of whole runs leaves over at their beginnings: one that leaves more sits in a pit
SEEN = 10.0  # times the scatter of χ², from which on what is left over says something


def grown(
    problem: FitProblem, starts: np.ndarray, own: int, per_sample: int, most_steps: int, whole: Judged | None = None
) -> Judged | None:
    """The fit that growing stretches lead to from the `starts` (k, n); None where they fail, or that is no better.

    Before that the last `own` unknowns are scanned around the last start, as a derivative says little of the size at
    which a valve sticks. `whole` is a fit of the whole runs, to be done better. It is taken for good if the beginnings
    of the runs are not fitted clearly better alone, which is found out at little expense.
    """
    runs, starts = problem.model().runs, np.atleast_2d(starts)
    parts = [_beginnings(problem, runs, share) for share in STRETCHES]
    lefts = [np.inf if whole is None else _left_over(whole, part) for part in parts]
    if lefts[-1] < SEEN:
        return None
    at = np.concatenate([starts, _scanned(parts[SCANNED], starts[-1], own, per_sample)])
    per_sample = max(per_sample, choose_time_resolution(parts[RESOLVED].model(), at[len(starts)]).coarse)
    prior = np.array([float(u.has_prior) for u in problem.unknowns])
    for part, left in zip(parts, lefts, strict=True):
        found = minima(part, at, per_sample, most_steps)
        at = found.x[np.argsort(found.model.cost)[:KEPT]]
        best = 2.0 * found.model.cost.min() - prior @ np.square(at[0])
        if not np.isfinite(best) or (left > SEEN and _beyond(best, part) > SMALLER * left):
            return None
    try:
        end = search(problem, at[0], per_sample, most_steps)
    except FitError:
        return None
    return end if whole is None or end.evidence > whole.evidence else None


def _beginnings(problem: FitProblem, runs: Sequence[BenchRun], share: float) -> FitProblem:
    """The same problem with the first `share` of each run."""
    part = []
    for run in runs:
        count = min(max(round(share * len(run.time)), SHORTEST), len(run.time))
        signals = {name: values[:count] for name, values in run.signals.items()}
        part.append(dataclasses.replace(run, time=run.time[:count], signals=signals, lines=run.lines[:count]))
    return dataclasses.replace(problem, runs=tuple(part))


def _scanned(part: FitProblem, around: np.ndarray, own: int, per_sample: int) -> np.ndarray:
    """The `KEPT` best of many values of the last `own` unknowns (KEPT, n), the others being as they are `around`."""
    line = np.linspace(-WIDE, WIDE, LINE)[:, None]
    sizes = line if own == 1 else WIDE * (2.0 * qmc.Sobol(own, seed=0).random(SIZES) - 1.0)
    low, high = np.array([u.bounds() for u in part.unknowns[-own:]]).T
    rows = np.tile(around, (len(sizes), 1))
    rows[:, -own:] = np.clip(sizes, low, high)
    model = part.model()
    every = tuple(range(len(model.runs)))
    found = model.predict([EvaluationPoint(row, every) for row in rows], per_sample, with_sensitivities=False)
    squares = [
        sum(_squares(normalised_residuals(part.campaign, run, outcomes[r]), run) for r, run in enumerate(model.runs))
        for outcomes in found
    ]
    return rows[np.argsort(squares)[:KEPT]]


def _left_over(whole: Judged, part: FitProblem) -> float:
    """What a fit of whole runs leaves over at the beginnings of its runs, as `_beyond` tells it."""
    return _beyond(sum(_squares(whole.residuals[run.name], run) for run in part.runs), part)


def _squares(residuals: Mapping[str, np.ndarray], run: BenchRun) -> float:
    """χ² of the residuals of a run, as long as this one is; infinite where the model failed."""
    with np.errstate(over="ignore"):
        rows = [residuals[n][: len(v)][np.isfinite(v)] for n, v in run.signals.items()]
        total = sum(float(np.sum(np.square(row))) for row in rows)
    return total if np.isfinite(total) else np.inf


def _beyond(square: float, part: FitProblem) -> float:
    """How far a χ² lies above what noise gives, in units of the scatter of that."""
    samples = sum(int(np.isfinite(v).sum()) for run in part.runs for v in run.signals.values())
    return (square - samples) / np.sqrt(2.0 * max(samples, 1))
