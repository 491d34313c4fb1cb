"""The laws of the members of a set: does one differ from that of the library, and by which curve?

A curve is added beside a law where it raises the log weight of the set clearly. The prior of its values may have
several widths, of which the one with the smallest misfit is taken.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.diagnosis.candidates.candidate import Candidate, FreeTerm, with_candidates
from edhas_jax.diagnosis.candidates.law_deviation import LawDeviation, curve_columns, law_deviation, memory_columns
from edhas_jax.diagnosis.search.linear_model import Floor, FlooredModel, LinearModel
from edhas_jax.diagnosis.search.weight import log_likelihood
from edhas_jax.inference.fit.evaluated_fit import EvaluatedFit, fit_coarse, noise_level
from edhas_jax.inference.fit.fit_problem import FitError
from edhas_jax.measurements.time_resolution import TimeResolution

LAW_GAIN = 4.0  # nats of log weight from which a law differs (50 : 1), as four widths of its prior are tried
SPREADS = (1.0, 4.0, 16.0, 64.0)  # prior standard deviations of a deviation that are compared, over the usual one
CURVE_STEPS = 10  # maximum number of Levenberg-Marquardt steps of the fit with a curve


class MemberLaw(NamedTuple):
    """What the measurements say of the law of a member.

    Args:
        candidate: the member.
        gain: log weight [nats] that another law gains.
        curve: its deviation, in the model of a diagnosis; None where the law is as in the library, or has a memory.
    """

    candidate: Candidate
    gain: float
    curve: LawDeviation | None = None

    @property
    def differs(self) -> bool:
        """Whether the law differs from that of the library."""
        return self.gain > LAW_GAIN


def with_member_laws(
    evaluated: EvaluatedFit, members: Sequence[Candidate], resolution: TimeResolution, report: Callable[[str], None]
) -> tuple[tuple[MemberLaw, ...], EvaluatedFit]:
    """The laws of the effects of a set, and the model with a curve beside each that differs.

    Args:
        evaluated: the fit of the set.
        members: its members.
        resolution: coarse and fine time steps per sample.
        report: called with a sentence on the progress.
    """
    found = []
    for candidate in members:
        if candidate.signal is None and not isinstance(candidate, FreeTerm):
            law, evaluated = _with_law(member_law(evaluated, candidate), evaluated, resolution, report)
            found.append(law)
    return tuple(found), evaluated


def member_law(evaluated: EvaluatedFit, candidate: Candidate) -> MemberLaw:
    """What the measurements say of the law of a member of a fitted set, with the curve that gains most, not yet fitted.

    Args:
        evaluated: the fit.
        candidate: the member, an effect.
    """
    library = _weighable(evaluated)
    if (columns := memory_columns(evaluated.fit, candidate)) is not None:
        return MemberLaw(candidate, _gain(evaluated.samples, library, _weighable(evaluated, columns)))
    curve = law_deviation(evaluated.fit, candidate)
    columns = None if curve is None else curve_columns(evaluated.fit, curve)
    if columns is None:
        return MemberLaw(candidate, 0.0)
    others = {factor: _weighable(evaluated, _scaled(columns, factor)) for factor in SPREADS}
    gains = {factor: _gain(evaluated.samples, library, other) for factor, other in others.items()}
    factor = max(gains, key=gains.__getitem__)
    return MemberLaw(candidate, gains[factor], dataclasses.replace(curve, spread=factor * curve.spread))


def _with_law(
    law: MemberLaw, evaluated: EvaluatedFit, resolution: TimeResolution, report: Callable[[str], None]
) -> tuple[MemberLaw, EvaluatedFit]:
    """The law of one member, and the model with its curve where that was added."""
    if law.curve is None or not law.differs:
        return law._replace(curve=None), evaluated
    report(f"{law.candidate.name}: fitting its law as a curve")
    problem = with_candidates(evaluated.fit.problem, [law.curve])
    start = np.concatenate([evaluated.fit.x, np.zeros(len(law.curve.coefficient_names))])
    try:
        fitted = fit_coarse(problem, start, resolution.coarse, CURVE_STEPS)
    except FitError:
        return MemberLaw(law.candidate, 0.0), evaluated
    law = law._replace(gain=_gain(evaluated.samples, _weighable(evaluated), _weighable(fitted)))
    return (law, fitted) if law.differs else (law._replace(curve=None), evaluated)


def _weighable(
    evaluated: EvaluatedFit, columns: Sequence[Mapping[str, np.ndarray]] | None = None
) -> FlooredModel | None:
    """The linear model of a fit with further columns, by fitted run and signal (samples, k) in SI; None if infinite."""
    model = LinearModel(evaluated.fit, columns, np.zeros((evaluated.samples, 0)))
    return model.at(Floor()) if model.is_finite else None


def _gain(samples: int, library: FlooredModel | None, other: FlooredModel | None) -> float:
    """The gain of log weight by another law [nats], at least 0."""
    if library is None or other is None:
        return 0.0
    least = min(noise_level(samples) + min(library.numbers, other.numbers), library.misfit, other.misfit)
    by_other, by_library = (log_likelihood(of.misfit - least, samples) for of in (other, library))
    return max(by_other - by_library, 0.0)


def _scaled(columns: Sequence[Mapping[str, np.ndarray]], factor: float) -> list[dict[str, np.ndarray]]:
    return [{name: factor * values for name, values in run.items()} for run in columns]
