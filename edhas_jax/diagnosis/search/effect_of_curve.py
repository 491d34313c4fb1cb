"""The effect whose law a free curve is.

A mechanism whose law differs much may explain nothing with the law of the library, so that no trial of it succeeds. A
free curve at the same place explains what it does, whatever its law. Most slots belong to one mechanism: a curve there,
over the variable that the law of the library follows, is the law of that effect. The laws of
these effects have one or two extrema at most; a curve with many, such as a ripple, is none of them.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from edhas_jax.diagnosis.calibration.fit_problem import FitError, FitProblem
from edhas_jax.diagnosis.search.candidates import Candidate, with_candidate
from edhas_jax.diagnosis.search.curve_candidate import CurveCandidate
from edhas_jax.diagnosis.search.evaluated_fit import fit_coarse, start_coordinates
from edhas_jax.diagnosis.search.law_deviation import SUFFIX, LawDeviation, law_deviation
from edhas_jax.diagnosis.search.result import Round
from edhas_jax.diagnosis.search.screening import Score, with_scaled_size
from edhas_jax.diagnosis.search.settled_fit import without_wrong_samples
from edhas_jax.diagnosis.search.stage_encoding import RoundEnd
from edhas_jax.diagnosis.search.tightened_bench import with_tightened_bench
from edhas_jax.diagnosis.search.trial import SMALL_SIZE, Trial
from edhas_jax.machine.effects import LIBRARY, Effect
from edhas_jax.machine.effects.tabulated_law import tabulated_class
from edhas_jax.measurements.time_resolution import TimeResolution

CURVE_DEGREE, MIN_CURVE_SHARE = 3, 0.5  # a polynomial of this degree explains at least this share of a smooth curve
FIT_STEPS = 10  # maximum number of Levenberg-Marquardt steps of the fit with the effect and its curve


def round_with_effect_of_curve(
    first: Round, curve_trial: Trial, more: Sequence[type[Effect]], resolution: TimeResolution
) -> RoundEnd | None:
    """The first round with the effect accepted whose law a free curve is, and the model with both.

    Args:
        first: the first round of the search.
        curve_trial: the fit of the calibrated model with the curve.
        more: user-defined effect classes that are considered.
        resolution: coarse and fine time steps per sample.

    Returns:
        The round and the model; None where the curve is not the law of just one effect that is considered, or has
        more extrema than such a law.
    """
    curve, baseline = curve_trial.candidate, first.baseline
    if not isinstance(curve, CurveCandidate) or curve_trial.evaluated is None:
        return None
    known = [kind for kind in (*LIBRARY, *more) if [slot.name for slot in kind.slots] == [curve.place.slot]]
    score = next((s for s in first.scores if [s.candidate.kind] == known and s.candidate.signal is None), None)
    values = dict(curve_trial.evaluated.fit.values)
    if score is None or not _is_smooth(curve, values):
        return None
    candidate = score.candidate
    problem = with_candidate(baseline.fit.problem, (), candidate)
    try:
        deviation = _as_deviation(problem, candidate, curve, values, resolution)
        if deviation is None:
            return None
        values |= dict(zip(deviation.value_names, (values[name] for name in curve.value_names), strict=True))
        both = with_candidate(problem, (candidate,), deviation)
        model = fit_coarse(both, _start(both, score, values), resolution.coarse, FIT_STEPS)
    except FitError:
        return None
    trial = Trial.failed(score).with_fit(baseline, model)
    gain = trial.log_evidence_gain
    trial = dataclasses.replace(
        trial, gain_beyond_laws=gain, own_law_gain=gain, remaining_excess=model.excess, own_law_excess=model.excess
    )
    others = [t for t in first.trials if t.candidate != candidate]
    found = dataclasses.replace(first, trials=(trial, *others), accepted=trial, laws=(deviation,))
    return RoundEnd(found, without_wrong_samples(with_tightened_bench(model, resolution.coarse), resolution))


def _is_smooth(curve: CurveCandidate, values: dict[str, float]) -> bool:
    """Whether a polynomial of low degree explains most of a curve's variation over its nodes."""
    y = np.array([values[name] for name in curve.value_names])
    fitted = np.polynomial.Polynomial.fit(curve.nodes, y, CURVE_DEGREE)(np.array(curve.nodes))
    return bool(np.sum(np.square(y - fitted)) <= (1.0 - MIN_CURVE_SHARE) * np.sum(np.square(y - y.mean())))


def _as_deviation(
    problem: FitProblem, candidate: Candidate, curve: CurveCandidate, values: dict[str, float],
    resolution: TimeResolution,
) -> LawDeviation | None:  # fmt: skip
    """The curve as the deviation of the law of a candidate; None where this law follows another variable."""
    usual = fit_coarse(problem, start_coordinates(problem, values), resolution.coarse, 0)
    found = law_deviation(usual.fit, candidate)
    if found is None or found.place != curve.place:
        return None
    kind = tabulated_class(candidate.id + SUFFIX, curve.place, len(curve.nodes))
    return LawDeviation(kind, None, curve.place, curve.spread, curve.nodes)


def _start(problem: FitProblem, score: Score, values: dict[str, float]) -> np.ndarray:
    """Coordinates (n,) with the law of the library so small that the curve alone acts."""
    x = start_coordinates(problem, values)
    own = {u.name for u in score.candidate.own_unknowns(problem.unknowns).values()}
    places = [k for k, u in enumerate(problem.unknowns) if u.name in own]
    x[places] = with_scaled_size([problem.unknowns[k] for k in places], x[places], SMALL_SIZE, score.exponent)
    return x
