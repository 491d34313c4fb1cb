"""Where something is missing that no effect of the library explains: how much each part of the machine accounts for.

A law that is not in the library is mostly like some combination of those that act at the same place. With E the matrix
of all signatures of a part, at every point of their grids and each of unit length, what no known parameter imitates,

    share = |P r|²/|r|²,   P the projector on the span of E,

is the part of the misfit r that a combination of them takes up. Suspects that were tried and brought nothing are left
out, as a signature that fits is no explanation where the model with it does not. A trial may bring more than signatures
promise, as these are linear in their sizes: the larger of both counts. Sensors count by what was accepted alone: lag,
delay, gain and offset are all that is thought of, while combinations of them follow almost any misfit of one signal.
"""

from collections.abc import Iterable, Sequence

from edhas_jax.judged import Judged
from edhas_jax.screening import Screen
from edhas_jax.suspects import SENSOR, Suspect
from edhas_jax.trial import Trial

SHARPNESS = 3.0  # exponent from shares to probabilities: chosen on cases with a struck effect


def shares(
    null: Judged, suspects: Iterable[Suspect], trials: Sequence[Trial], accepted: Sequence[Trial]
) -> dict[str, float]:
    """The share of what a calibrated model leaves over that each part of the machine accounts for, the largest first.

    `trials` are those of the first search, which began with the same model; `accepted` is what it and later ones took.
    """
    screen = Screen(null.fit, ())
    whole = float(screen.residual @ screen.residual)
    refuted = {t.suspect for t in trials if not t.gain > 0.0}
    of_part: dict[str, list[Suspect]] = {}
    for suspect in suspects:
        if suspect.where != SENSOR and suspect not in refuted:
            of_part.setdefault(suspect.where, []).append(suspect)
    out = {part: screen.taken_up_by(there) / whole for part, there in of_part.items()}
    kept = {t.suspect for t in accepted}
    for trial in trials:
        part = trial.suspect.where
        if trial.gain > 0.0 and (part != SENSOR or trial.suspect in kept):
            out[part] = max(out.get(part, 0.0), min(2.0 * trial.gain / whole, 1.0))
    return dict(sorted(out.items(), key=lambda item: -item[1]))


def probabilities(shares: dict[str, float]) -> dict[str, float]:
    """The probability of each part of the machine to be where something is missing."""
    weights = {part: share**SHARPNESS for part, share in shares.items()}
    total = sum(weights.values())
    return {part: weight / total for part, weight in weights.items()} if total > 0.0 else {}
