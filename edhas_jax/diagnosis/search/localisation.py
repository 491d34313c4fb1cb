"""Where something is missing that no effect of the library explains: how much each part of the machine accounts for.

A law that is not in the library is mostly like some combination of those that act at the same place. With E the matrix
of all signatures of a part, at every point of their grids and each of unit length, what no known parameter imitates,

    share = |P r|²/|r|²,   P the projector on the span of E,

is the part of the misfit r that a combination of them takes up. Signatures are linear in their sizes, and may promise
what a fit does not keep, or less than it brings. So, unless a law that was tried explains everything, those of a part
that promise most are fitted: its share is at least what the best of them brings, and far from the noise it is cut to
what they keep of their promises. A sensor counts by what was accepted alone, as combinations of lag, delay, gain and
offset follow almost any misfit of one signal, and only as far as what then remains is its own signal's: a faulty sensor
leaves the others alone.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.diagnosis.search.candidates import SENSOR, Suspect, held_by_belief
from edhas_jax.diagnosis.search.evaluated_fit import Judged
from edhas_jax.diagnosis.search.screening import Score, Screen
from edhas_jax.diagnosis.search.trial import Trial
from edhas_jax.measurements.campaign import Use

SHARPNESS = 3.0  # exponent from shares to probabilities: chosen on cases with a struck effect
LAWS = 2  # of a part that are fitted
EXPLAINED = 1.02  # residual over noise below which a law explains everything
FAINT = 0.1  # share of the largest below which a part's signatures promise too little to fit its laws


class Parts(NamedTuple):
    """The share of what a calibrated model leaves over that each part of the machine accounts for, the largest first.

    `tried` are the laws that were fitted to find out.
    """

    shares: dict[str, float]
    tried: tuple[Trial, ...]


def ask_parts(
    null: Judged, suspects: Iterable[Suspect], trials: Sequence[Trial], accepted: Sequence[Trial],
    attempt: Callable[[Score], Trial],
) -> Parts:  # fmt: skip
    """What each part of the machine accounts for of what the calibrated model `null` leaves over.

    `trials` are those of the first search, which began with the same model; `accepted` is what it and later ones took.
    """
    screen = Screen(null.fit, ())
    whole = float(screen.residual @ screen.residual)
    refuted = {t.suspect for t in trials if not t.gain > 0.0}
    of_part: dict[str, list[Suspect]] = {}
    for suspect in suspects:
        if suspect.where != SENSOR and suspect not in refuted:
            of_part.setdefault(suspect.where, []).append(suspect)
    asked = {part: screen.together(there) for part, there in of_part.items()}
    faint = FAINT * max((span for _, span in asked.values()), default=0.0)
    unclear = not any(map(_explains_all, trials))
    out, fitted = {}, []
    for part, (scores, span) in asked.items():
        found = [t for t in trials if t.suspect.where == part]
        if unclear and span > faint:
            tried = {t.suspect for t in found}
            new = [attempt(score) for score in scores[:LAWS] if score.fall > 0.0 and score.suspect not in tried]
            fitted += new
            found += new
            span *= 1.0 if null.near_noise else _kept(found)
        out[part] = max([span / whole, *(min(2.0 * t.gain / whole, 1.0) for t in found)])
    kept = {t.suspect for t in accepted}
    for trial in trials:
        if trial.suspect in kept and trial.suspect.where == SENSOR:
            share = min(2.0 * trial.gain / whole, 1.0) * _own(trial)
            out[SENSOR] = max(out.get(SENSOR, 0.0), share)
    return Parts(dict(sorted(out.items(), key=lambda item: -item[1])), tuple(fitted))


def _explains_all(trial: Trial) -> bool:
    """Whether nothing is left with a suspect whose values can be believed."""
    fitted = trial.judged
    return fitted is not None and fitted.level(Use.FIT) < EXPLAINED and not held_by_belief(trial.suspect, fitted.fit)


def _kept(trials: Sequence[Trial]) -> float:
    """The share of the best promise of some trials that the best of them has kept, 0 … 1."""
    promised = max((t.score.fall for t in trials), default=0.0)
    return float(np.clip(2.0 * max(t.gain for t in trials) / promised, 0.0, 1.0)) if promised > 0.0 else 0.0


def _own(trial: Trial) -> float:
    """The share of what a sensor's fault leaves over, beyond noise, that is in its own signal; 1 if that is nothing."""
    beyond: dict[str, float] = {}
    for signals in trial.judged.fit.residuals.values():
        for name, values in signals.items():
            beyond[name] = beyond.get(name, 0.0) + float(np.nansum(np.square(values) - 1.0))
    beyond = {name: max(value, 0.0) for name, value in beyond.items()}
    total = sum(beyond.values())
    return beyond[trial.suspect.signal] / total if total > 0.0 else 1.0


def probabilities(shares: dict[str, float]) -> dict[str, float]:
    """The probability of each part of the machine to be where something is missing."""
    weights = {part: share**SHARPNESS for part, share in shares.items()}
    total = sum(weights.values())
    return {part: weight / total for part, weight in weights.items()} if total > 0.0 else {}
