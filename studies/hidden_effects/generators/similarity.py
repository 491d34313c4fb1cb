"""How much of a hidden effect another effect of the library explains: of a withheld one, none may explain nearly all.

The share is that of the visible change: 1 where the other effect's change, with whatever the uncertain parameters and
the usual errors of a bench add, is a multiple of it; 0 where the two have nothing in common.
"""

import itertools
import math
from collections.abc import Iterable

import numpy as np

from edhas_jax.core import structs
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.measurement_model import EvaluationPoint, MeasurementModel
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter
from studies.hidden_effects.generators.laws import Law, can_mount
from studies.hidden_effects.generators.visibility import VisibilityTest

MAX_SHARE = 0.8  # of a withheld effect that any one similar effect may explain
STEPS_PER_SAMPLE = 6
# sizes and shapes of an effect with one, two or more parameters, in quarters of their plausible ranges
POINTS = {1: ((-1.5, -0.5, 0.5, 1.5),), 2: ((-1.2, 0.3), (-1.5, -0.5, 0.5, 1.5)),
          3: ((-0.5,), (-1.6, -1.1, -0.7, -0.3, 0.0, 0.4, 0.8, 1.3), (-1.7, -0.85, 0.0, 0.85))}  # fmt: skip


def share(test: VisibilityTest, change: np.ndarray, other: np.ndarray) -> float:
    """The share (0 … 1) of the visible change that a multiple of another change explains."""
    size = test.all.visible(change) * test.all.visible(other)
    return float(test.all.overlap(change, other) ** 2 / size) if size > 0.0 else 0.0


def shares_of_similar_effects(
    test: VisibilityTest, law: Law, change: np.ndarray, library: Iterable[type[Effect]]
) -> dict[str, float]:
    """What those effects of a library explain that a law is easily confused with, each at its best size and shape."""
    found, runs = {}, tuple(range(len(test.runs)))
    for kind in library:
        if kind.id not in law.kind.confused_with or not can_mount(test.machine, kind):
            continue
        unknowns = _unknowns(kind)
        machine = structs.replace(test.machine, effects=(*test.machine.effects, kind()))
        model = MeasurementModel(test.plan, machine, unknowns, test.runs)
        axes = POINTS.get(len(unknowns), ((0.0,),) * len(unknowns))
        points = [EvaluationPoint(np.array(x), runs) for x in itertools.product(*axes)]
        outcomes = model.predict(points, STEPS_PER_SAMPLE, False)
        after = [test.change_to([outcome[r].values for r in runs]) for outcome in outcomes]
        found[kind.id] = max((share(test, change, a) for a in after if np.isfinite(a).all()), default=0.0)
    return found


def _unknowns(kind: type[Effect]) -> list[UnknownParameter]:
    """The parameters of an effect as unknowns whose plausible ranges are 4 units wide."""
    out = []
    for p in Law(None, kind).free_parameters:
        (low, high), name = p.plausible, f"{kind.id}.{p.name}"
        if low > 0.0:
            out.append(UnknownParameter(name, math.sqrt(low * high), math.log(high / low) / 4.0, p.unit, p.span))
        else:
            middle, quarter = 0.5 * (low + high), 0.25 * (high - low)
            out.append(UnknownParameter(name, middle, quarter, p.unit, p.span, ParameterScale.LINEAR))
    return out
