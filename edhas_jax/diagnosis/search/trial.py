"""The trial of a suspect: everything fitted anew with it in place, and judged on runs that no fit has seen."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from edhas_jax.diagnosis.calibration.fit import FitError
from edhas_jax.diagnosis.search.candidates import Suspect, held_by_belief, problem_of
from edhas_jax.diagnosis.search.evaluated_fit import Judged, refined, search, start_from
from edhas_jax.diagnosis.search.progressive_fit import grown
from edhas_jax.diagnosis.search.screening import Score
from edhas_jax.measurements.time_resolution import TimeResolution

ENOUGH = 0.3  # share of what a suspect promised that a fit from one start must bring, else another start is tried
STAND_IN = 30.0  # evidence that a suspect loses with a value that nobody would believe: it is probably something else
PULLED_BACK = 0.3  # share of the known parameters' excursions that the other start keeps


@dataclasses.dataclass(frozen=True)
class Trial:
    """A suspect with what it promised and what came of it; `judged` is None where no fit was possible.

    `gain` is how much it raises the evidence above that of the model without it, less a penalty where only belief holds
    one of its parameters; `gain_on_new` how much ½χ² falls on runs that no fit has seen.
    """

    suspect: Suspect
    score: Score
    judged: Judged | None
    gain: float
    gain_on_new: float


def try_suspect(
    before: Judged, accepted: Sequence[Suspect], score: Score, resolution: TimeResolution, most_steps: int,
    finish: bool, grow: bool = True,
) -> Trial:  # fmt: skip
    """Fit everything anew with a suspect in place, at the fine step if it is to `finish`.

    From where the fit without it stands, and if that leads nowhere, from a point nearer to what was believed of the
    known parameters, as a wrong model may have led them astray. Where much is left over and it may `grow`, by
    growing stretches too.
    """
    fitted, suspect = before.fit, score.suspect
    problem = problem_of(fitted.problem.campaign, fitted.problem.machine, fitted.problem.instruments, accepted, suspect)
    known = len(problem.unknowns) - len(score.x)
    here = np.concatenate([start_from(problem, fitted.values)[:known], score.x])
    there = np.concatenate([PULLED_BACK * here[:known], score.x])
    best: Judged | None = None
    for start in (here, there):
        try:
            found = search(problem, start, resolution.coarse, most_steps)
            found = refined(found, resolution, most_steps) if finish else found
        except FitError:
            continue
        if best is None or found.evidence > best.evidence:
            best = found
        if before.cost - best.cost > 0.5 * ENOUGH * score.fall:
            break
    if grow and (best is None or not best.near_noise):
        starts = np.array([there] if best is None else [best.fit.x, there])
        best = grown(problem, starts, len(score.x), resolution.coarse, most_steps, best) or best
    failed = Trial(suspect, score, None, -math.inf, -math.inf)
    return failed if best is None else again(before, failed, best)


def again(before: Judged, trial: Trial, judged: Judged) -> Trial:
    """The trial with another fit of its suspect."""
    gains = before.half_chi_square() - judged.half_chi_square()
    gain = judged.evidence - before.evidence - (STAND_IN if held_by_belief(trial.suspect, judged.fit) else 0.0)
    return dataclasses.replace(trial, judged=judged, gain=gain, gain_on_new=float(gains.sum()))
