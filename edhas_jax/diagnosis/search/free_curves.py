"""Free curves at the places of a machine: where does something act of which no law is known?

At every place of the machine (a slot, and a variable that a law there may follow) a curve of unknown shape is added.
Around a fit the signals are linear in its values, so that one simulation with derivatives tells how much of the misfit
the best curve explains. A single cause is a curve at one place; many small causes leave much with any curve.
"""

from collections.abc import Callable

import numpy as np

from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.laws.curve_start import start_from_nothing
from edhas_jax.diagnosis.laws.deviation import added_slopes, curve_term
from edhas_jax.diagnosis.laws.law_places import law_places
from edhas_jax.diagnosis.laws.law_samples import LawSamples, samples_at_slots
from edhas_jax.diagnosis.search.curve_candidate import CurveCandidate
from edhas_jax.diagnosis.search.free_term import score_free_term
from edhas_jax.diagnosis.search.screening import Score, ScoreTest
from edhas_jax.machine.effects.tabulated_law import LawPlace, tabulated_class
from edhas_jax.machine.rigs import Rig

# slots at which a curve is the same term of the same equation, but for its sign
SAME_TERMS = {"mover_friction": "mover_force", "cylinder_friction_force": "cylinder_force"}


# curves that are simulated together: more save compilation, fewer the time of each step
GROUP = 4


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


def score_free_curves(test: ScoreTest, fit: Fit, report: Callable[[str], None]) -> list[Score]:
    """The score tests of free curves at all places of a machine, the largest predicted fall of χ² first.

    Args:
        test: score test of a model.
        fit: the fit of this model.
        report: called with a sentence on the progress.
    """
    report("looking where curves act")
    places = _distinct_places(fit.machine)
    samples = samples_at_slots(fit, places)
    curves = [curve for place in places if (curve := free_curve(fit, place, samples[place.slot])) is not None]
    scores = []
    for first in range(0, len(curves), GROUP):
        some = curves[first : first + GROUP]
        report(f"looking for free curves, {first + len(some)} of {len(curves)}")
        slopes = added_slopes(fit, [curve_term(curve.place, np.array(curve.nodes), curve.id) for curve in some])
        scores += [score_free_term(test, curve, columns) for curve, columns in zip(some, slopes, strict=True)]
    return sorted(scores, key=lambda score: -score.chi_square_fall)


def _id_at(place: LawPlace) -> str:
    """The id of the free curve at a place."""
    return "_".join((place.slot, "curve_over", place.variable, *place.factors))


def _distinct_places(machine: Rig) -> list[LawPlace]:
    """The places of a machine, without those that have a curve or where a curve is the same term as at another one."""
    found: dict[tuple, LawPlace] = {}
    present = {effect.id for effect in machine.effects}
    for slot in machine.slots:
        for place in (p for p in law_places(machine, slot.name) if _id_at(p) not in present):
            found.setdefault((SAME_TERMS.get(slot.name, slot.name), place.variable, place.factors), place)
    return list(found.values())
