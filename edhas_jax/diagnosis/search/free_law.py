"""Mount a curve beside an accepted effect whose law clearly differs from that of the library, and fit it."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from edhas_jax.diagnosis.calibration.fit_problem import FitError
from edhas_jax.diagnosis.search.candidates import Candidate, with_candidate
from edhas_jax.diagnosis.search.decision_rules import strength
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit, fit_coarse
from edhas_jax.diagnosis.search.law_deviation import LawDeviation, deviation_columns, deviation_cost, law_deviation
from edhas_jax.measurements.time_resolution import TimeResolution

# gain by a deviation of a law over what is left with it: from which it is mounted, and from which the law differs
MIN_MOUNTED_STRENGTH, MIN_LAW_STRENGTH = 0.3, 1.0
SPREADS = (1.0, 4.0, 16.0, 64.0)  # prior standard deviations that are compared, over the usual one
FIT_STEPS = 10  # maximum number of Levenberg-Marquardt steps of the fit with the curve


def free_law(
    evaluated: EvaluatedFit, mounted: Sequence[Candidate], candidate: Candidate, resolution: TimeResolution,
    report: Callable[[str], None],
) -> tuple[LawDeviation | None, EvaluatedFit]:  # fmt: skip
    """The model with the deviation of a law as a curve, where that explains much more than it leaves.

    Args:
        evaluated: a fit with some candidates.
        mounted: these candidates.
        candidate: the one of them whose law is examined.
        resolution: coarse and fine time steps per sample.
        report: called with a sentence on the progress.

    Returns:
        The deviation and the fit with it; None and the given fit where the law is as in the library.
    """
    unchanged = None, evaluated
    deviation = law_deviation(evaluated.fit, candidate)
    columns = None if deviation is None else deviation_columns(evaluated.fit, deviation)
    if columns is None:
        return unchanged
    after = {factor: evaluated.excess_with(_scaled(columns, factor)) for factor in SPREADS}
    cost = deviation_cost(columns)
    factor = min(SPREADS, key=lambda f: after[f] + len(deviation.nodes) * math.log(f))
    if not strength(evaluated.excess - after[factor] - cost, after[factor], evaluated.samples) > MIN_MOUNTED_STRENGTH:
        return unchanged
    deviation = dataclasses.replace(deviation, spread=factor * deviation.spread)
    report(f"{candidate.name}: fitting its law as a curve")
    problem = with_candidate(evaluated.fit.problem, mounted, deviation)
    start = np.concatenate([evaluated.fit.x, np.zeros(len(deviation.nodes))])
    try:
        freed = fit_coarse(problem, start, resolution.coarse, FIT_STEPS)
    except FitError:
        return unchanged
    gain = freed.log_evidence - evaluated.log_evidence
    return (deviation, freed) if strength(gain, freed.excess, freed.samples) > MIN_MOUNTED_STRENGTH else unchanged


def _scaled(columns: Sequence[Mapping[str, np.ndarray]], factor: float) -> list[dict[str, np.ndarray]]:
    return [{name: factor * values for name, values in run.items()} for run in columns]
