"""Next experiment after a diagnosis: the feasible run whose predictions by rival models differ most (T-optimality)."""

import dataclasses
import itertools
import math
from typing import Any

import numpy as np

from edhas_jax.core.runtime import single_threaded_algebra
from edhas_jax.diagnosis.planning.candidate_runs import feasible_runs, format_conditions
from edhas_jax.diagnosis.search.result import Diagnosis, Verdict
from edhas_jax.diagnosis.search.set_search import FittedSet
from edhas_jax.inference.likelihood.symmetric_matrices import regularised_inverse, square_root
from edhas_jax.measurements.campaign import BenchRun, Campaign
from edhas_jax.measurements.measurement_model import MeasurementModel

MAX_RIVALS = 3
MAX_LINEARISED_RUNS = 4  # feasible runs, largest difference at fixed parameters first, whose derivatives are computed
DECISIVE_SEPARATION, FAR_SEPARATION = 5.0, 20.0  # standard deviations


@dataclasses.dataclass(frozen=True)
class Experiment:
    """A run that discriminates between rival models.

    Attributes:
        rivals: the sets of effects whose models are rivals, as text.
        conditions: conditions of the run as text with units.
        separation: distance between the predictions of the two nearest rivals in standard deviations, over the whole
            run and after the parameters of either model have been refitted.
        signal: the signal on which these two differ most.
        sentence: the recommendation in words.
    """

    rivals: tuple[str, ...]
    conditions: dict[str, str]
    separation: float
    signal: str
    sentence: str

    def as_json(self) -> dict[str, Any]:
        """The experiment as plain data."""
        return dataclasses.asdict(self)


@single_threaded_algebra
def next_experiment(diagnosis: Diagnosis) -> Experiment | None:
    """Choose the candidate run that best discriminates the rival explanations of a diagnosis.

    With Δ the difference of the predictions of two fitted models in units of noise, J the derivatives of one of them by
    its unknowns and Σ their covariance from the runs that were made, the part of Δ that refitting this model cannot
    follow has the squared length

        d² = Δᵀ (I + J Σ Jᵀ)⁻¹ Δ

    It is computed with either model in the place of J; the smaller value counts, and the smallest over all pairs of
    rivals. Rivals are the sets that the measurements do not distinguish, or the best one and its closest competitor.

    Args:
        diagnosis: the fitted sets of effects.

    Returns:
        The run with the largest separation; None if there is no rival or no feasible run.

    Source: Atkinson, Fedorov, Biometrika 62 (1975) 57, extended by the refitting of the parameters.
    """
    rivals = _rivals(diagnosis)
    if len(rivals) < 2:
        return None
    campaign = diagnosis.campaign
    steps = rivals[0].evaluated.fit.resolution.coarse
    feasible = feasible_runs(campaign, rivals[0].evaluated.fit.machine, steps)
    if not feasible:
        return None
    pairs = list(itertools.combinations(range(len(rivals)), 2))
    predictions = [_predictions(campaign, of, feasible, steps) for of in rivals]
    differences = np.array([
        min(_euclidean_distance(predictions[a][r], predictions[b][r]) for a, b in pairs)
        for r in range(len(feasible))
    ])  # fmt: skip
    chosen = np.argsort(-np.nan_to_num(differences, nan=-1.0))[:MAX_LINEARISED_RUNS]
    runs = tuple(feasible[r] for r in chosen)
    jacobians = [_jacobians(campaign, of, runs, steps) for of in rivals]
    best = None
    for k, r in enumerate(chosen):
        separations = []
        for a, b in pairs:
            difference = np.concatenate([predictions[a][r][n] - predictions[b][r][n] for n in predictions[a][r]])
            distance = min(
                _distance_after_refit(difference, jacobians[c][k], rivals[c].evaluated.fit.covariance) for c in (a, b)
            )
            separations.append((distance, (a, b)))
        separation, (a, b) = min(separations)
        if best is None or separation > best[0]:
            one, other = predictions[a][r], predictions[b][r]
            best = separation, r, max(one, key=lambda n: np.linalg.norm(one[n] - other[n]))
    separation, r, signal = best
    if not math.isfinite(separation):
        return None
    names = tuple(map(str, rivals))
    conditions = format_conditions(campaign, feasible[r].conditions)
    decided = diagnosis.verdict is Verdict.MISSING_EFFECT
    sentence = _sentence(names, conditions, separation, signal, decided)
    return Experiment(names, conditions, separation, signal, sentence)


def _rivals(diagnosis: Diagnosis) -> list[FittedSet]:
    """The sets that a new run should discriminate, the most probable first."""
    posterior = diagnosis.posterior
    if len(posterior.near) > 1 or diagnosis.verdict is Verdict.ADEQUATE:
        return list(posterior.near[:MAX_RIVALS])
    return list(posterior.sets[:2])


def _predictions(
    campaign: Campaign, of: FittedSet, runs: tuple[BenchRun, ...], steps: int
) -> list[dict[str, np.ndarray]]:  # fmt: skip
    """Sensor signals of a set's fitted machine over noise, by run and signal."""
    fit = of.evaluated.fit
    model = MeasurementModel(campaign, fit.machine, (), runs, fit.instruments)
    outcomes = model.predict_all_runs(np.zeros(0), steps)
    return [{n: v / campaign.channels[n].noise for n, v in outcomes[r].values.items()} for r in range(len(runs))]


def _jacobians(campaign: Campaign, of: FittedSet, runs: tuple[BenchRun, ...], steps: int) -> list[np.ndarray]:
    """Derivatives (samples of all signals, unknowns) of these predictions by the set's coordinates, by run."""
    fit = of.evaluated.fit
    model = MeasurementModel(campaign, fit.problem.machine, fit.problem.unknowns, runs, fit.problem.instruments)
    outcomes = model.predict_all_runs(fit.x, steps, with_sensitivities=True)
    return [
        np.concatenate([v / campaign.channels[n].noise for n, v in outcomes[r].sensitivities.items()])
        for r in range(len(runs))
    ]


def _euclidean_distance(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> float:
    return float(np.sqrt(sum(np.sum(np.square(v - other[n])) for n, v in one.items())))


def _distance_after_refit(difference: np.ndarray, jacobian: np.ndarray, covariance: np.ndarray) -> float:
    """√(Δᵀ (I + J Σ Jᵀ)⁻¹ Δ), by the Woodbury identity with Σ = L Lᵀ, which may be singular; −inf if not finite."""
    spread = jacobian @ square_root(covariance)
    projection = spread.T @ difference
    precision = np.eye(spread.shape[1]) + spread.T @ spread
    square = difference @ difference - projection @ regularised_inverse(precision) @ projection
    return math.sqrt(max(float(square), 0.0)) if np.isfinite(square) else -math.inf


def _beyond_noise(separation: float) -> str:
    """How large a separation [standard deviations of the noise] is, in words."""
    if separation >= FAR_SEPARATION:
        return "far more than the noise could hide"
    return f"by {separation:.1f} times what the noise makes uncertain"


def _sentence(
    names: tuple[str, ...], conditions: dict[str, str], separation: float, signal: str, decided: bool
) -> str:  # fmt: skip
    run = "A run with " + ", ".join(f"{n.replace('_', ' ')} {text}" for n, text in conditions.items())
    distance = f"what they predict differs {_beyond_noise(separation)}, most in {signal.replace('_', ' ')}"
    if decided:
        return f"{run} would confirm {names[0]} most clearly against its best rival, {names[1]}: {distance}."
    verb = "decides between" if separation >= DECISIVE_SEPARATION else "separates best, but not decisively,"
    return f"{run} {verb} {', '.join(names[:-1])} and {names[-1]}: {distance}."
