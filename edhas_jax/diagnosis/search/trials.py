"""A second look at a suspect that is confirmed and yet leaves much over: first without the runs that fit worst."""


import dataclasses
from collections.abc import Sequence

import numpy as np

from edhas_jax.diagnosis.calibration.fit import FitError
from edhas_jax.diagnosis.search.candidates import Suspect
from edhas_jax.diagnosis.search.evaluated_fit import Judged, search
from edhas_jax.diagnosis.search.screening import Score
from edhas_jax.diagnosis.search.trial import Trial, again, try_suspect
from edhas_jax.measurements.campaign import Use
from edhas_jax.measurements.residuals import rms_over_noise
from edhas_jax.measurements.time_resolution import TimeResolution

WORST = 2.0  # times the median of the runs' residuals, from which on a run is left out


def second_look(before: Judged, trial: Trial, per_sample: int, most_steps: int) -> Trial:
    """The trial with the fit that the tame runs lead to, or as it was where that is no better.

    Runs at the edge of resonance or cavitation make a cost full of pits. The fit that falls into one leaves such runs
    worst explained; without them it finds the valley, and with all of them the bottom.
    """
    found = trial.judged
    problem = found.fit.problem
    runs = problem.campaign.runs_for(Use.FIT)
    levels = np.array([rms_over_noise(found.residuals[run.name].values()) for run in runs])
    tame = tuple(run for run, of in zip(runs, levels, strict=True) if of <= WORST * np.median(levels))
    if len(tame) == len(runs):
        return trial
    try:
        part = search(dataclasses.replace(problem, runs=tame), found.fit.x, per_sample, most_steps)
        whole = search(problem, part.fit.x, per_sample, most_steps)
    except FitError:
        return trial
    return again(before, trial, whole) if whole.evidence > found.evidence else trial



PROMISE = 25.0  # fall of χ² below which a suspect is not worth a trial: chance gives as much to the best of forty
MOST_TRIALS = 5
RIVAL = 0.1  # share of the best gain, or of what was promised if that is less, that a rival must promise to be tried
TRIAL_STEPS = 12


def tournament(
    before: Judged, accepted: Sequence[Suspect], scores: Sequence[Score], resolution: TimeResolution, say,
    reached: float = 0.0,
) -> list[Trial]:  # fmt: skip
    """Trials of the suspects that promise most, until the rest promise too little beside what was reached."""
    trials: list[Trial] = []
    for score in scores[:MOST_TRIALS]:
        if score.fall < PROMISE or 0.5 * score.fall < RIVAL * reached:
            break
        say(f"trying {score.suspect.name}, which promises a fall of χ² by {score.fall:.0f}")
        # beside one that explains nearly all, no other needs to be led out of a pit
        grow = not any(t.judged is not None and t.judged.near_noise for t in trials)
        trials.append(try_suspect(before, accepted, score, resolution, TRIAL_STEPS, before.near_noise, grow))
        reached = max(reached, best_reached(trials, scores))
    return trials


def best_reached(trials: Sequence[Trial], scores: Sequence[Score]) -> float:
    """The best gain of some trials, at most what the best of their kind has promised.

    An effect may bring far more than its signature promises, and then its rivals may too.
    """
    return min(max((t.gain for t in trials), default=0.0), 0.5 * scores[0].fall) if scores else 0.0
