"""Which suspects are worth a trial: those that promise most, until the rest promise too little."""

from collections.abc import Sequence

from edhas_jax.judged import Judged
from edhas_jax.resolution import Resolution
from edhas_jax.screening import Score
from edhas_jax.suspects import Suspect
from edhas_jax.trial import Trial, try_suspect

PROMISE = 25.0  # fall of χ² below which a suspect is not worth a trial: chance gives as much to the best of forty
MOST_TRIALS = 5
RIVAL = 0.1  # share of the best gain, or of what was promised if that is less, that a rival must promise to be tried
TRIAL_STEPS = 12


def tournament(
    before: Judged, accepted: Sequence[Suspect], scores: Sequence[Score], resolution: Resolution, say,
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
