"""How the measured signals change with a curve at a place of the machine: linear columns around a fit."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.core import structs
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.unknown_parameters import UnknownParameter


class AddedTerm(NamedTuple):
    """An effect whose present parameter values change nothing in the model, and its n unknowns."""

    effect: Effect
    unknowns: Sequence[UnknownParameter]


Columns = tuple[dict[str, np.ndarray], ...]  # by fitted run and signal (samples, n) in SI


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
    found = model.predict_all_runs(np.zeros(len(unknowns)), fit.steps_of_changes, with_sensitivities=True)
    slopes, out, first = [found[r].sensitivities for r in range(len(model.runs))], [], 0
    for term in terms:
        own = slice(first, first + len(term.unknowns))
        out.append(tuple({n: values[:, own] for n, values in run.items()} for run in slopes))
        first = own.stop
    return out
