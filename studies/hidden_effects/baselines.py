"""Baseline methods that name a missing effect, from the same calibrated model and the same candidates as the diagnosis.

* Forward selection by BIC: the signatures of the candidates, which are their contributions to the signals, fitted to
  the residual of the calibrated model by least squares.
* Residual correlation: the candidates whose signatures are most parallel to the residual.
* Sparse regression of the discrepancy (PySINDy's STLSQ), in `sparse_regression.py`.

All of them use the residual at a time step whose solver error is far below the noise. As in the screening of the
diagnosis, every candidate is evaluated at the same grid of sizes and shapes, and what the uncertain parameters can
reproduce within their priors is projected out of residual and signatures. No method fits the model again.
"""

import dataclasses
import math

import numpy as np

from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.search.candidates import Candidate, candidate_unknowns
from edhas_jax.diagnosis.search.screening import MAX_SCALE, ScoreTest
from edhas_jax.measurements.measurement_model import PredictedSignals
from edhas_jax.measurements.time_resolution import choose_time_resolution

MAX_EXACT_ERROR_OVER_NOISE = 0.01  # largest rms error of the solver in the residual, in units of the noise
MIN_COSINE = 0.02  # cosine between signature and residual below which a candidate is not named; chance gives 0.015
MAX_ANSWERS = 3
MIN_INDEPENDENT_SHARE = 1e-6  # of a signature's square that must remain beside the chosen signatures


@dataclasses.dataclass(frozen=True)
class Answer:
    """What a method says: the candidates that it would add, best first (none: nothing is missing), and its ranking."""

    named: list[str]
    ranked: list[str]


@dataclasses.dataclass(frozen=True)
class ScreenedCandidate:
    """A candidate with its projected signatures (points, m) and the number of its free parameters."""

    name: str
    signatures: np.ndarray
    parameter_count: int


def exact_fit(fitted: Fit) -> tuple[Fit, int]:
    """A fit with its signals at a step whose error is far below the noise, and this number of steps per sample."""
    model = fitted.problem.model()
    per_sample = choose_time_resolution(model, fitted.x, MAX_EXACT_ERROR_OVER_NOISE).fine
    exact = model.predict_all_runs(fitted.x, per_sample)
    outcomes = tuple(
        PredictedSignals(exact[r].values, outcome.sensitivities) for r, outcome in enumerate(fitted.outcomes)
    )
    return dataclasses.replace(fitted, outcomes=outcomes), per_sample


def screen(fitted: Fit, candidates: list[Candidate]) -> tuple[np.ndarray, list[ScreenedCandidate]]:
    """The residual of a fit and the signatures of the candidates, projected and in units of noise.

    Args:
        fitted: the fit of the model without the candidates, with exact signals.
        candidates: candidate effects and sensor faults.

    Returns:
        The residual (m,), and the candidates that have a signature.
    """
    test = ScoreTest(fitted, ())
    found = []
    for candidate in candidates:
        signatures = test.projected_signatures(candidate)
        if signatures:
            count = len(candidate_unknowns(candidate, fitted.problem.campaign))
            found.append(ScreenedCandidate(candidate.name, np.array(signatures), count))
    return test.projected_residual(), found


def correlation(residual: np.ndarray, candidates: list[ScreenedCandidate]) -> Answer:
    """The candidates with the largest cosines between signature and residual, above `MIN_COSINE`."""
    length = float(np.linalg.norm(residual))
    cosines = [float(np.max(c.signatures @ residual / np.linalg.norm(c.signatures, axis=1))) for c in candidates]
    order = np.argsort(-np.array(cosines))[:MAX_ANSWERS]
    named = [candidates[k].name for k in order if cosines[k] > MIN_COSINE * length]
    return Answer(named, [candidates[k].name for k in order])


def forward_bic(residual: np.ndarray, candidates: list[ScreenedCandidate]) -> Answer:
    """Forward selection: the candidate that decreases BIC = χ² + k ln n most is added as long as BIC decreases.

    k counts the free parameters of a candidate. Its signature at each grid point is scaled by least squares within the
    limits that the screening of the diagnosis allows.
    """
    named: list[str] = []
    ranked: list[str] = []
    remaining = {c.name: (c.signatures.copy(), np.sum(np.square(c.signatures), axis=1)) for c in candidates}
    parameter_counts = {c.name: c.parameter_count for c in candidates}
    while len(named) < MAX_ANSWERS and remaining:
        falls = {}
        for name, (signatures, original) in remaining.items():
            squares, overlaps = np.sum(np.square(signatures), axis=1), signatures @ residual
            usable = squares > MIN_INDEPENDENT_SHARE * original
            scales = np.clip(np.divide(overlaps, squares, out=np.zeros_like(squares), where=usable), 0.0, MAX_SCALE)
            chi_square_falls = scales * (2.0 * overlaps - scales * squares)
            point = int(np.argmax(chi_square_falls))
            penalty = parameter_counts[name] * math.log(len(residual))
            falls[name] = float(chi_square_falls[point]) - penalty, point, scales[point]
        ranked = ranked or sorted(falls, key=lambda name: -falls[name][0])[:MAX_ANSWERS]
        best = max(falls, key=lambda name: falls[name][0])
        bic_fall, point, scale = falls[best]
        if bic_fall <= 0.0:
            break
        named.append(best)
        chosen = remaining.pop(best)[0][point]
        residual = residual - scale * chosen
        unit = chosen / np.linalg.norm(chosen)
        for signatures, _ in remaining.values():
            signatures -= np.outer(signatures @ unit, unit)
    return Answer(named, ranked)
