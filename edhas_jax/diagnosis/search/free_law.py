"""Mount a curve beside an accepted effect whose law clearly differs from that of the library, and fit it."""

from collections.abc import Callable, Sequence

import numpy as np

from edhas_jax.diagnosis.calibration.fit_problem import FitError
from edhas_jax.diagnosis.search.candidates import Candidate, build_problem
from edhas_jax.diagnosis.search.decision_rules import strength
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit, fit_coarse
from edhas_jax.diagnosis.search.law_deviation import (
    LawDeviation,
    deviation_cost,
    law_deviation,
    law_deviation_columns,
)
from edhas_jax.measurements.time_resolution import TimeResolution

MIN_LAW_STRENGTH = 1.0  # gain by a deviation of a law over what is left with it, from which the law differs
FIT_STEPS = 8  # maximum number of Levenberg-Marquardt steps of the fit with the curve


def free_law(
    evaluated: EvaluatedFit, mounted: Sequence[Candidate], resolution: TimeResolution, report: Callable[[str], None]
) -> tuple[LawDeviation | None, EvaluatedFit]:
    """The model with the deviation of the last law as a curve, where that explains much more than it leaves.

    Args:
        evaluated: a fit with some candidates.
        mounted: these candidates, the one whose law is examined last.
        resolution: coarse and fine time steps per sample.
        report: called with a sentence on the progress.

    Returns:
        The deviation and the fit with it; None and the given fit where the law is as in the library.
    """
    candidate, unchanged = mounted[-1], (None, evaluated)
    columns = law_deviation_columns(evaluated.fit, [candidate])
    after = evaluated.excess_with(columns)
    gain = evaluated.excess - after - deviation_cost(columns)
    deviation = law_deviation(evaluated.fit, candidate)
    if deviation is None or strength(gain, after, evaluated.samples) <= MIN_LAW_STRENGTH:
        return unchanged
    report(f"{candidate.name}: fitting its law as a curve")
    fitted, known = evaluated.fit, evaluated.fit.problem
    problem = build_problem(
        known.campaign, known.machine, known.instruments, mounted, deviation, known.solver_error, known.time_shifts
    )
    start = np.concatenate([fitted.x, np.zeros(len(deviation.nodes))])
    try:
        freed = fit_coarse(problem, start, resolution.coarse, FIT_STEPS)
    except FitError:
        return unchanged
    gain = freed.log_evidence - evaluated.log_evidence
    return (deviation, freed) if strength(gain, freed.excess, freed.samples) > MIN_LAW_STRENGTH else unchanged
