"""Free curves at the places of a machine: where does something act of which no law is known?

At every place of the machine (a slot, and a variable that a law there may follow) a curve of unknown shape is added.
Around a fit the signals are linear in its values, so that one simulation with derivatives tells how much of the misfit
the best curve explains. A single cause is a curve at one place; many small causes leave much with any curve.
"""

from collections.abc import Callable

import numpy as np

from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.laws.curve_start import start_from_nothing
from edhas_jax.diagnosis.laws.deviation import curve_columns
from edhas_jax.diagnosis.laws.law_places import law_places
from edhas_jax.diagnosis.search.curve_candidate import CurveCandidate
from edhas_jax.diagnosis.search.free_term import score_free_term
from edhas_jax.diagnosis.search.screening import Score, ScoreTest
from edhas_jax.machine.effects.tabulated_law import LawPlace, tabulated_class

# slots at which a curve is the same term of the same equation, but for its sign
SAME_TERMS = {"mover_friction": "mover_force", "cylinder_friction_force": "cylinder_force"}


def free_curve(fit: Fit, place: LawPlace) -> CurveCandidate | None:
    """A free curve over the values that its variable takes along the fitted runs; None where it is constant."""
    start = start_from_nothing(fit, place)
    if start is None:
        return None
    words = (place.slot, "curve_over", place.variable, *place.factors)
    kind = tabulated_class("_".join(words), place, len(start.nodes))
    return CurveCandidate(kind, None, place, start.size, tuple(map(float, start.nodes)))


def score_free_curves(test: ScoreTest, fit: Fit, report: Callable[[str], None]) -> list[Score]:
    """The score tests of free curves at all places of a machine, the largest predicted fall of χ² first.

    Args:
        test: score test of a model.
        fit: the fit of this model.
        report: called with a sentence on the progress.
    """
    machine, scores, taken = fit.machine, [], set()
    for slot in machine.slots:
        for place in law_places(machine, slot.name):
            acts = (SAME_TERMS.get(slot.name, slot.name), place.variable, place.factors)
            curve = None if acts in taken else free_curve(fit, place)
            taken.add(acts)
            if curve is None:
                continue
            report(f"looking for {curve.text}")
            columns = curve_columns(fit, place, np.array(curve.nodes), curve.id)
            scores.append(score_free_term(test, curve, columns))
    return sorted(scores, key=lambda score: -score.chi_square_fall)
