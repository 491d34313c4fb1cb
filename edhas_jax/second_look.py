"""A second look at a suspect that is confirmed and yet leaves much over: first without the runs that fit worst."""

import dataclasses

import numpy as np

from edhas_jax.campaign import Use
from edhas_jax.fit import FitError
from edhas_jax.judged import Judged, search
from edhas_jax.misfit import level
from edhas_jax.trial import Trial, again

WORST = 2.0  # times the median of the runs' residuals, from which on a run is left out


def second_look(before: Judged, trial: Trial, per_sample: int, most_steps: int) -> Trial:
    """The trial with the fit that the tame runs lead to, or as it was where that is no better.

    Runs at the edge of resonance or cavitation make a cost full of pits. The fit that falls into one leaves such runs
    worst explained; without them it finds the valley, and with all of them the bottom.
    """
    found = trial.judged
    problem = found.fit.problem
    runs = problem.campaign.runs_for(Use.FIT)
    levels = np.array([level(found.residuals[run.name].values()) for run in runs])
    tame = tuple(run for run, of in zip(runs, levels, strict=True) if of <= WORST * np.median(levels))
    if len(tame) == len(runs):
        return trial
    try:
        part = search(dataclasses.replace(problem, runs=tame), found.fit.x, per_sample, most_steps)
        whole = search(problem, part.fit.x, per_sample, most_steps)
    except FitError:
        return trial
    return again(before, trial, whole) if whole.evidence > found.evidence else trial
