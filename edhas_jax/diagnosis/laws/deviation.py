"""How the measured signals change with a curve at a place of the machine: linear columns around a fit."""

import math

import numpy as np

from edhas_jax.core import structs
from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.laws.curve_prior import CurvePrior
from edhas_jax.machine.effects.tabulated_law import LawPlace, LawTable
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter

Columns = tuple[dict[str, np.ndarray], ...]  # by fitted run and signal (samples, n) in SI


def curve_columns(fit: Fit, place: LawPlace, nodes: np.ndarray, name: str = "free_curve") -> Columns:
    """The derivatives of all signals by the values of a curve that is added to the model of a fit.

    Args:
        fit: the fit; its model may have an effect at the place already, to which the curve is then a deviation.
        place: slot, variable and factors of the curve.
        nodes: nodes (n,) in SI.
        name: id of the curve as an effect; programs are compiled for each name.

    Returns:
        By fitted run and signal (samples, n), in the unit of the signal per unit of the curve's values (SI), without
        the part that the other unknowns could reproduce being removed; NaN where the simulation failed.
    """
    count = len(nodes)
    table = LawTable(name, place, np.asarray(nodes, float), np.full(count, place.neutral))
    machine = structs.replace(fit.machine, effects=(*fit.machine.effects, table.effect()))
    unknowns = tuple(
        UnknownParameter(
            f"{name}.value_{k}", place.neutral, 1.0, place.value_unit, (-math.inf, math.inf), ParameterScale.LINEAR
        )
        for k in range(1, count + 1)
    )
    base = fit.problem.model()
    model = MeasurementModel(base.campaign, machine, unknowns, base.runs, fit.instruments)
    found = model.predict_all_runs(np.zeros(count), fit.resolution.coarse, with_sensitivities=True)
    return tuple(found[r].sensitivities for r in range(len(base.runs)))


def deviation_columns(fit: Fit, place: LawPlace, nodes: np.ndarray, prior: CurvePrior) -> Columns:
    """The change of all signals by a curve of unknown shape, as columns whose coefficients are standard normal.

    Args:
        fit: the fit.
        place: slot, variable and factors of the curve.
        nodes: nodes (n,) in SI.
        prior: size of the curve and of its bends, SI.

    Returns:
        By fitted run and signal (samples, n) in SI.
    """
    factor = prior.factor(nodes)
    return tuple({n: slopes @ factor for n, slopes in run.items()} for run in curve_columns(fit, place, nodes))
