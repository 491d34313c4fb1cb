"""Free curves at the places of a machine: where does something act of which no law is known?

At every place of the machine (a slot, and a variable that a law there may follow) a curve of unknown shape is added.
Around a fit the signals are linear in its values, so that one simulation with derivatives tells how much of the misfit
the best curve explains. A single cause is a curve at one place; many small causes leave much with any curve.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.laws.curve_start import start_from_nothing
from edhas_jax.diagnosis.laws.deviation import curve_columns
from edhas_jax.diagnosis.laws.law_places import law_places
from edhas_jax.diagnosis.search.curve_candidate import CurveCandidate
from edhas_jax.diagnosis.search.screening import Score, ScoreTest
from edhas_jax.machine.effects.tabulated_law import LawPlace, tabulated_class

USUAL_COORDINATE = 1.5  # prior standard deviations
# slots at which a curve is the same term of the same equation, but for its sign
SAME_TERMS = {"mover_friction": "mover_force", "cylinder_friction_force": "cylinder_force"}


def free_curve(fit: Fit, place: LawPlace) -> CurveCandidate | None:
    """A free curve over the values that its variable takes along the fitted runs; None where it is constant."""
    start = start_from_nothing(fit, place)
    if start is None:
        return None
    words = (place.slot, "curve_over", place.variable, *place.factors)
    kind = tabulated_class("_".join(words), place, len(start.nodes))
    return CurveCandidate(kind, None, place, tuple(map(float, start.nodes)), start.size)


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
            score = _score(test, curve, columns)
            size = float(np.abs(score.x).max(initial=0.0))
            if size > USUAL_COORDINATE:  # larger than usual: with a prior of this size
                curve = dataclasses.replace(curve, spread=size / USUAL_COORDINATE * curve.spread)
                score = _score(test, curve, columns)
            scores.append(score)
    return sorted(scores, key=lambda score: -score.chi_square_fall)


def _score(test: ScoreTest, curve: CurveCandidate, columns: Sequence[Mapping[str, np.ndarray]]) -> Score:
    return test.score_columns(curve, [{n: curve.spread * values for n, values in run.items()} for run in columns])
