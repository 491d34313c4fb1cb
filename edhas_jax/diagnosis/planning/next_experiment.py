"""The next experiment: the feasible run on which models that explain the measurements alike differ most."""

import dataclasses
import itertools
import math
from typing import Any

import numpy as np

from edhas_jax.diagnosis.planning.candidate_runs import feasible_runs, texts
from edhas_jax.diagnosis.search.result import Diagnosis, Round, Verdict
from edhas_jax.diagnosis.search.trial import Trial
from edhas_jax.measurements.campaign import BenchRun, Campaign
from edhas_jax.measurements.predicted_signals import Case, Model

MOST_RIVALS = 3
CLOSER = 4  # runs that are looked at with everything fitted anew, of those that differ most as the models stand
CLEAR = 5.0  # sigmas from which a run decides


@dataclasses.dataclass(frozen=True)
class Experiment:
    """A run that parts `rivals`: its `conditions` as text with units, and how far apart they will be.

    `separation` is the distance of the two rivals that are nearest to each other, in standard deviations of the noise
    over the whole run, once everything uncertain has been fitted anew; `signal` is the one on which they differ most.
    """

    rivals: tuple[str, ...]
    conditions: dict[str, str]
    separation: float
    signal: str
    sentence: str

    def as_json(self) -> dict[str, Any]:
        """The experiment as plain data."""
        return dataclasses.asdict(self)


def next_experiment(diagnosis: Diagnosis) -> Experiment | None:
    """The run of the menu that parts the suspects of a group, or the accepted one from its best rival.

    With Δ the difference of two fitted models in units of noise, J the slopes of the one by its unknowns and Σ their
    covariance from the runs that were made, what no new fit of that model can follow is

        d² = Δᵀ (I + J Σ Jᵀ)⁻¹ Δ

    taken from both sides, the smaller one counts. None where there is no rival, or no run can be varied.

    Source: Atkinson, Fedorov, Biometrika 62 (1975) 57, with parameters that are fitted anew.
    """
    rivals = _rivals(diagnosis)
    if len(rivals) < 2:
        return None
    campaign = diagnosis.campaign
    steps = rivals[0].judged.fit.resolution.rough
    menu = feasible_runs(campaign, rivals[0].judged.fit.machine, steps)
    if not menu:
        return None
    pairs = list(itertools.combinations(range(len(rivals)), 2))
    plain = [_whitened(campaign, trial, menu, steps) for trial in rivals]
    apart = np.array([min(_distance(plain[a][r], plain[b][r]) for a, b in pairs) for r in range(len(menu))])
    chosen = np.argsort(-np.nan_to_num(apart, nan=-1.0))[:CLOSER]
    runs = tuple(menu[r] for r in chosen)
    slopes = [_slopes(campaign, trial, runs, steps) for trial in rivals]
    best = None
    for k, r in enumerate(chosen):
        found = []
        for a, b in pairs:
            difference = np.concatenate([plain[a][r][n] - plain[b][r][n] for n in plain[a][r]])
            kept = min(_unfollowed(difference, slopes[c][k], rivals[c].judged.fit.covariance) for c in (a, b))
            found.append((kept, (a, b)))
        separation, (a, b) = min(found)
        if best is None or separation > best[0]:
            best = separation, r, max(plain[a][r], key=lambda n: np.linalg.norm(plain[a][r][n] - plain[b][r][n]))
    separation, r, signal = best
    if not math.isfinite(separation):
        return None
    names = tuple(trial.suspect.name for trial in rivals)
    conditions = texts(campaign, menu[r].conditions)
    decided = diagnosis.verdict is Verdict.MISSING_EFFECT
    sentence = _sentence(names, conditions, separation, signal, decided)
    return Experiment(names, conditions, separation, signal, sentence)


def _rivals(diagnosis: Diagnosis) -> list[Trial]:
    """The trials that a new run should part, the likeliest first."""
    if diagnosis.verdict is Verdict.UNKNOWN_EFFECT:
        return [t for t in diagnosis.forms if t.judged is not None][:2]
    groups = [r for r in diagnosis.rounds if len(r.group()) > 1]
    if groups:
        trials = {t.suspect: t for t in groups[0].trials if t.judged is not None}
        return [trials[s] for s in groups[0].group() if s in trials][:MOST_RIVALS]
    close = [(second.gain - first.gain, first, second) for r in diagnosis.rounds for first, second in _leaders(r)]
    return list(max(close, key=lambda row: row[0])[1:]) if close else []


def _leaders(r: Round) -> list[tuple[Trial, Trial]]:
    """The accepted suspect of a round and the best of the others."""
    others = [t for t in r.trials if t is not r.accepted and t.judged is not None]
    return [(r.accepted, max(others, key=lambda t: t.gain))] if r.accepted is not None and others else []


def _whitened(campaign: Campaign, trial: Trial, runs: tuple[BenchRun, ...], steps: int) -> list[dict[str, np.ndarray]]:
    """What the sensors would read on the machine of a trial, by run and signal, in units of noise."""
    fit = trial.judged.fit
    model = Model(campaign, fit.machine, (), runs, fit.instruments)
    found = model.outcomes([Case(np.zeros(0), tuple(range(len(runs))))], steps, derive=False)[0]
    return [{n: v / campaign.channels[n].noise for n, v in found[r].values.items()} for r in range(len(runs))]


def _slopes(campaign: Campaign, trial: Trial, runs: tuple[BenchRun, ...], steps: int) -> list[np.ndarray]:
    """Derivatives (n, unknowns) of the same by the coordinates of the trial's unknowns, by run."""
    fit = trial.judged.fit
    model = Model(campaign, fit.problem.machine, fit.problem.unknowns, runs, fit.problem.instruments)
    found = model.outcomes([Case(fit.x, tuple(range(len(runs))))], steps, derive=True)[0]
    return [
        np.concatenate([v / campaign.channels[n].noise for n, v in found[r].slopes.items()]) for r in range(len(runs))
    ]


def _distance(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> float:
    return float(np.sqrt(sum(np.sum(np.square(v - other[n])) for n, v in one.items())))


def _unfollowed(difference: np.ndarray, slopes: np.ndarray, covariance: np.ndarray) -> float:
    """√(Δᵀ (I + J Σ Jᵀ)⁻¹ Δ), by Woodbury's identity."""
    along = slopes.T @ difference
    square = difference @ difference - along @ np.linalg.solve(np.linalg.inv(covariance) + slopes.T @ slopes, along)
    return math.sqrt(max(float(square), 0.0)) if np.isfinite(square) else -math.inf


def _sentence(
    names: tuple[str, ...], conditions: dict[str, str], separation: float, signal: str, decided: bool
) -> str:  # fmt: skip
    run = "A run with " + ", ".join(f"{n.replace('_', ' ')} {text}" for n, text in conditions.items())
    apart = f"they will be {separation:.0f} σ apart, most in {signal.replace('_', ' ')}"
    if decided:
        return f"{run} would confirm {names[0]} most clearly against its best rival, {names[1]}: {apart}."
    worth = "decides between" if separation >= CLEAR else "parts best, but not surely,"
    return f"{run} {worth} {', '.join(names[:-1])} and {names[-1]}: {apart}."
