"""How much of a hidden effect another effect explains, so that a withheld effect is really unknown to the diagnosis.

The share is that of the visible change: 1 where a multiple of the other effect's change, with whatever the uncertain
parameters and the usual errors of a bench add, is the same; 0 where the two have nothing in common.
"""

import itertools
from collections.abc import Iterable

import numpy as np

from edhas_jax.core.structs import replace
from edhas_jax.diagnosis.search.candidates import Candidate, can_mount
from edhas_jax.machine.effects import LIBRARY, Effect
from edhas_jax.measurements.measurement_model import EvaluationPoint, MeasurementModel
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter
from studies.hidden_effects.generators.generic_terms import GENERIC_TERMS
from studies.hidden_effects.generators.laws import Law
from studies.hidden_effects.generators.visibility import VisibilityTest

MAX_SHARE = 0.8  # of a withheld effect that any one generic term or similar effect may explain
MIN_SHARE = 0.2  # of a term as linear, below which it is not simulated
REFINEMENTS = 3  # iterations that fit the coefficient of a term, one simulation each
TRIED_COEFFICIENTS = (0.3, 2.0, 10.0)  # of a term at the place of the law, in units of its typical size
ROUGH_STEPS_PER_SAMPLE = 6
# slots that add a body or a volume to the machine, so that a term of size 0 has no meaning there
STRUCTURAL_SLOTS = ("coupling_force", "suction_line_resistance", "outlet_line_resistance")


def share(test: VisibilityTest, change: np.ndarray, other: np.ndarray) -> float:
    """The share (0 … 1) of the visible change that a multiple of another change explains."""
    size = test.all.visible(change) * test.all.visible(other)
    return float(test.all.overlap(change, other) ** 2 / size) if size > 0.0 else 0.0


def shares_of_generic_terms(
    test: VisibilityTest, law: Law, change: np.ndarray, terms: Iterable[type[Effect]] = GENERIC_TERMS
) -> dict[str, float]:
    """What each generic term explains of a change, by id; terms that the machine cannot have are left out.

    A term is first taken as linear in its coefficient. Where it then resembles the change at all, or acts at the same
    place, it is simulated, first with several coefficients and then with better ones, because an effect may be far
    from linear in its size.

    Args:
        test: what a change leaves visible.
        law: the law that makes the change.
        change: its change of the signals.
        terms: the terms.
    """
    usable = [kind for kind in terms if can_mount(test.machine, kind)]
    structural = [kind for kind in usable if any(slot.name in STRUCTURAL_SLOTS for slot in kind.slots)]
    linear = [kind for kind in usable if kind not in structural]
    found = {}
    for kind in structural:
        machine = replace(test.machine, effects=(*test.machine.effects, kind()))
        found[kind.id] = share(test, change, _finite(test.change(machine)))
    machine = replace(test.machine, effects=(*test.machine.effects, *(kind(coefficient=0.0) for kind in linear)))
    unknowns = [_coefficient(kind) for kind in linear]
    model = MeasurementModel(test.plan, machine, unknowns, test.runs)
    outcome = model.predict_all_runs(np.zeros(len(unknowns)), ROUGH_STEPS_PER_SAMPLE, with_sensitivities=True)
    columns = test.stacked([outcome[r].sensitivities for r in range(len(test.runs))]).T
    promising: dict[int, list[float]] = {}
    for k, (kind, column) in enumerate(zip(linear, columns, strict=True)):
        found[kind.id] = share(test, change, column)
        if set(kind.slots) & set(law.kind.slots):
            promising[k] = [s * c for s in (-1.0, 1.0) for c in TRIED_COEFFICIENTS]
        elif found[kind.id] > MIN_SHARE:
            promising[k] = [test.all.overlap(change, column) / test.all.visible(column)]
    for _ in range(REFINEMENTS):
        points = [(k, c) for k, coefficients in promising.items() for c in coefficients]
        after = _changes(test, model, [c * np.eye(len(unknowns))[k] for k, c in points])
        best: dict[int, tuple[float, float]] = {}
        for (k, c), column in zip(points, after, strict=True):
            reached = share(test, change, column)
            if reached > best.get(k, (0.0, 0.0))[0]:
                best[k] = reached, c * test.all.overlap(change, column) / test.all.visible(column)
        promising = {k: [c] for k, (_, c) in best.items()}
        found |= {linear[k].id: max(found[linear[k].id], reached) for k, (reached, _) in best.items()}
    return found


def _coefficient(kind: type[Effect]) -> UnknownParameter:
    """The coefficient of a generic term, in units of its typical size."""
    p = Law(None, kind).size
    return UnknownParameter(f"{kind.id}.{p.name}", 0.0, p.default, p.unit, p.span, ParameterScale.LINEAR, False)


def shares_of_similar_effects(test: VisibilityTest, law: Law, change: np.ndarray) -> dict[str, float]:
    """What those effects of the library explain that a law is easily confused with, each at its best size and shape."""
    found = {}
    for kind in LIBRARY:
        if kind.id not in law.kind.confused_with or not can_mount(test.machine, kind):
            continue
        unknowns = Candidate(kind).unknowns(test.plan)
        machine = replace(test.machine, effects=(*test.machine.effects, kind()))
        model = MeasurementModel(test.plan, machine, unknowns, test.runs)
        after = _changes(test, model, list(_sizes_and_shapes(unknowns)))
        found[kind.id] = max((share(test, change, column) for column in after), default=0.0)
    return found


def _sizes_and_shapes(unknowns: list[UnknownParameter]) -> np.ndarray:
    """Sizes and shapes of an effect as coordinates (points, n), fixed here so that a case depends on no method."""
    points = {1: ((-1.5, -0.5, 0.5, 1.5),), 2: ((-1.2, 0.3), (-1.5, -0.5, 0.5, 1.5))}
    usual = (-0.5,), (-1.6, -1.1, -0.7, -0.3, 0.0, 0.4, 0.8, 1.3), (-1.7, -0.85, 0.0, 0.85)
    if not 0 < len(unknowns) <= len(usual):
        return np.zeros((1, len(unknowns)))
    return np.array(list(itertools.product(*points.get(len(unknowns), usual))))


def _changes(test: VisibilityTest, model: MeasurementModel, points: list[np.ndarray]) -> list[np.ndarray]:
    """The changes of the signals by a model at several points; none where it could not be simulated."""
    if not points:
        return []
    runs = tuple(range(len(test.runs)))
    outcomes = model.predict([EvaluationPoint(x, runs) for x in points], ROUGH_STEPS_PER_SAMPLE, False)
    return [_finite(test.change_to([outcome[r].values for r in runs])) for outcome in outcomes]


def _finite(change: np.ndarray) -> np.ndarray:
    """The change, or none where the machine could not be simulated."""
    return change if np.isfinite(change).all() else np.zeros_like(change)
