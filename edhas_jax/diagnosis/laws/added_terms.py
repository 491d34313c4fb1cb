"""How the measured signals change with a curve at a place of the machine: linear columns around a fit."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.core import structs
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.effects.tabulated_law import LawPlace, LawTable
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter


class AddedTerm(NamedTuple):
    """An effect whose present parameter values change nothing in the model, and its n unknowns."""

    effect: Effect
    unknowns: Sequence[UnknownParameter]


Columns = tuple[dict[str, np.ndarray], ...]  # by fitted run and signal (samples, n) in SI


def curve_term(place: LawPlace, nodes: np.ndarray, name: str) -> AddedTerm:
    """A curve that changes nothing yet, with its values as unknowns.

    Args:
        place: slot, variable and factors of the curve; where an effect acts there already, it is a deviation from that.
        nodes: nodes (n,) in SI.
        name: id of the curve as an effect; programs are compiled for each name.
    """
    count = len(nodes)
    table = LawTable(name, place, np.asarray(nodes, float), np.full(count, place.neutral))
    unknowns = tuple(
        UnknownParameter(
            f"{name}.value_{k}", place.neutral, 1.0, place.value_unit, (-math.inf, math.inf), ParameterScale.LINEAR
        )
        for k in range(1, count + 1)
    )
    return AddedTerm(table.effect(), unknowns)


def added_slopes(fit: Fit, terms: Sequence[AddedTerm]) -> list[Columns]:
    """The derivatives of all signals with respect to the unknowns of terms that are added to the model of a fit.

    All terms are added at once. As none has influence, the derivatives are those of each term alone, and one program
    is compiled instead of many.

    Args:
        fit: the fit.
        terms: the terms.

    Returns:
        For each term, by fitted run and signal (samples, n), in the unit of the signal per unit coordinate, without the
        part that the other unknowns could reproduce being removed; NaN where the simulation failed.
    """
    machine = structs.replace(fit.machine, effects=(*fit.machine.effects, *(term.effect for term in terms)))
    unknowns = tuple(u for term in terms for u in term.unknowns)
    model = MeasurementModel(fit.problem.campaign, machine, unknowns, fit.runs, fit.instruments)
    found = model.predict_all_runs(np.zeros(len(unknowns)), fit.resolution.coarse, with_sensitivities=True)
    slopes, out, first = [found[r].sensitivities for r in range(len(model.runs))], [], 0
    for term in terms:
        own = slice(first, first + len(term.unknowns))
        out.append(tuple({n: values[:, own] for n, values in run.items()} for run in slopes))
        first = own.stop
    return out
