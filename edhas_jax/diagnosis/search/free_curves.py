"""Free curves at the places of a machine: where does something act of which no law is known?

At every place of the machine (a slot, and a variable that a law there may follow) a curve of unknown shape is added.
Around a fit the signals are linear in its values, so that one simulation with derivatives tells how much of the misfit
the best curve explains. A single cause is a curve at one place; many small causes leave much with any curve.

What acts at several places is followed by one curve after another. One curve often takes over a part of another one, so
that after each curve all numbers are fitted again, those of earlier curves too, and the places are scored anew.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from edhas_jax.core.runtime import single_threaded_algebra
from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.laws.curve_start import start_from_nothing
from edhas_jax.diagnosis.laws.deviation import Columns, added_slopes, curve_term
from edhas_jax.diagnosis.laws.law_places import law_places
from edhas_jax.diagnosis.laws.law_samples import LawSamples, samples_at_slots
from edhas_jax.diagnosis.search.candidate_fit import fit_with_candidate
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.curve_candidate import CurveCandidate
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit
from edhas_jax.diagnosis.search.free_term import score_free_term
from edhas_jax.diagnosis.search.screening import Score, ScoreTest
from edhas_jax.machine.effects.tabulated_law import LawPlace, tabulated_class
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.time_resolution import TimeResolution

# curves that are simulated together: more save compilation, fewer the time of each step
GROUP = 4
MIN_GAIN = 12.0  # nats: the best of some fifty curves gains less by chance
MIN_LEFT_SHARE = 0.05  # of the excess of ½χ², by which a further curve has to raise the log-evidence
FIT_STEPS = 60  # maximum number of Levenberg-Marquardt steps of each fit with several curves
MOST_CURVES = 3

Report = Callable[[str], None]


def free_curve(fit: Fit, place: LawPlace, samples: LawSamples | None = None) -> CurveCandidate | None:
    """A free curve over the values that its variable takes along the fitted runs; None where it is constant.

    Args:
        fit: the fit.
        place: where the curve is added.
        samples: samples along the fitted runs at the slot of the place; simulated by default.
    """
    start = start_from_nothing(fit, place, samples=samples)
    if start is None:
        return None
    kind = tabulated_class(_id_at(place), place, len(start.nodes))
    return CurveCandidate(kind, None, place, start.size, tuple(map(float, start.nodes)))


def score_free_curves(test: ScoreTest, fit: Fit, report: Report) -> list[Score]:
    """The score tests of free curves at all places of a machine, the largest predicted fall of χ² first.

    Args:
        test: score test of a model.
        fit: the fit of this model.
        report: called with a sentence on the progress.
    """
    found = [score_free_term(test, curve, columns) for curve, columns in curves_with_slopes(fit, report)]
    return sorted(found, key=lambda score: -score.chi_square_fall)


def curves_with_slopes(fit: Fit, report: Report) -> Iterator[tuple[CurveCandidate, Columns]]:
    """The free curves at all places of a machine, each with the derivatives of all signals by its values.

    Args:
        fit: the fit of the model to which they are added.
        report: called with a sentence on the progress.
    """
    report("looking where curves act")
    places = _distinct_places(fit.machine)
    samples = samples_at_slots(fit, places)
    curves = [curve for place in places if (curve := free_curve(fit, place, samples[place.slot])) is not None]
    for first in range(0, len(curves), GROUP):
        some = curves[first : first + GROUP]
        report(f"looking for free curves, {first + len(some)} of {len(curves)}")
        slopes = added_slopes(fit, [curve_term(curve.place, np.array(curve.nodes), curve.id) for curve in some])
        yield from zip(some, slopes, strict=True)


@single_threaded_algebra
def add_curves_in_turn(
    evaluated: EvaluatedFit, accepted: Sequence[Candidate], resolution: TimeResolution, most: int = MOST_CURVES,
    on_progress: Report | None = None,
) -> list[tuple[CurveCandidate, EvaluatedFit]]:  # fmt: skip
    """Add free curves to a fitted model, each where it explains most, until one explains little.

    Args:
        evaluated: the fit from which the search begins.
        accepted: the candidates that its machine has.
        resolution: coarse and fine time steps per sample.
        most: largest number of curves.
        on_progress: called with a sentence on the progress.

    Returns:
        The curves in the order in which they were added, each with the fit of the model that has it and those before.
    """
    report = on_progress or (lambda sentence: None)
    mounted, found = list(accepted), []
    while len(found) < most:
        scores = score_free_curves(ScoreTest(evaluated.fit, mounted), evaluated.fit, report)
        # far from the noise a linear prediction is far too small, so that it decides only where it is tiny
        if not scores or not scores[0].predicted_gain >= MIN_GAIN:
            break
        curve = scores[0].candidate
        report(f"fitting {curve.text}")
        fitted = fit_with_candidate(evaluated, mounted, scores[0], resolution, FIT_STEPS)
        least = max(MIN_GAIN, MIN_LEFT_SHARE * evaluated.excess)
        if fitted is None or not fitted.log_evidence - evaluated.log_evidence >= least:
            break
        found.append((curve, fitted))
        mounted.append(curve)
        evaluated = fitted
    return found


def _id_at(place: LawPlace) -> str:
    """The id of the free curve at a place."""
    return "_".join((place.slot, "curve_over", place.variable, *place.factors))


def _distinct_places(machine: Rig) -> list[LawPlace]:
    """The places of a machine, without those that have a curve or where a curve is the same term as at another one."""
    found: dict[tuple, LawPlace] = {}
    present = {effect.id for effect in machine.effects}
    for slot in machine.slots:
        for place in (p for p in law_places(machine, slot.name) if _id_at(p) not in present):
            found.setdefault((slot.same_as or slot.name, place.variable, place.factors), place)
    return list(found.values())
