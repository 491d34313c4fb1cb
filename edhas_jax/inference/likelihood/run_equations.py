"""Normal equations of a campaign, run by run, with the bench deviations marginalised.

All columns of a run (the sensitivities to the unknowns, its bench deviations, any further signatures, and the
residual r) are whitened and multiplied with each other. With L the columns of the deviations that the run has on its
own, whose coefficients have standard normal priors, every product is reduced to

    aᵀ (I + L Lᵀ)⁻¹ b = aᵀb − aᵀL (I + LᵀL)⁻¹ Lᵀb

(Woodbury), which integrates them out. The products are all that fits, comparisons of candidates and predictions of
left-out runs need; no simulation is repeated for them.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from edhas_jax.inference.likelihood.bench_deviations import BenchDeviations, deviation_columns
from edhas_jax.inference.likelihood.symmetric_matrices import regularised_inverse
from edhas_jax.inference.likelihood.whitening import whiten
from edhas_jax.measurements.campaign import BenchRun, Campaign
from edhas_jax.measurements.measurement_model import PredictedSignals
from edhas_jax.measurements.unknown_parameters import UnknownParameter

MAX_DERIVATIVE = 20.0  # change of a signal by one prior standard deviation of an unknown, over the range of the signal


@dataclasses.dataclass(frozen=True)
class RunEquations:
    """Products of the whitened columns of one run, its own deviations marginalised.

    Args:
        gram: products (q, q) of the columns: unknowns, sensors' deviations, further signatures, residual last.
        samples: number of whitened samples.
    """

    gram: np.ndarray
    samples: int


def run_columns(
    campaign: Campaign, run: BenchRun, predicted: PredictedSignals, unknowns: Sequence[UnknownParameter],
    bench: BenchDeviations, signatures: Mapping[str, np.ndarray] | None = None,
) -> tuple[np.ndarray, int]:  # fmt: skip
    """The whitened columns of one run.

    Args:
        campaign: noise of the signals.
        run: the measurements.
        predicted: the signals at the fit and their derivatives with respect to the coordinates of the unknowns.
        unknowns: these unknowns.
        bench: the deviations of the bench.
        signatures: further columns (samples, k) by signal, SI.

    Returns:
        Columns (m, l + n + g + k + 1): the run's own deviations, unknowns, sensors' deviations, signatures, residual;
        and the number l of the first ones. NaN everywhere where the model fails at a sample that was measured.
    """
    own, of_unknowns = len(bench.of_runs), len(unknowns)
    deviations = [*bench.of_runs, *bench.of_sensors]
    further = 0 if signatures is None else next(iter(signatures.values())).shape[1]
    lengths = [len(measured) for measured in run.signals.values()]
    columns = np.empty((sum(lengths), len(deviations) + of_unknowns + further + 1))
    ends, fails = np.cumsum(lengths), False
    for (name, measured), end in zip(run.signals.items(), ends, strict=True):
        block, values = columns[end - len(measured) : end], predicted.values[name]
        fails = fails or not (np.isfinite(values) | np.isnan(measured)).all()
        slopes = block[:, own : own + of_unknowns]
        slopes[:] = bounded_slopes(run, name, predicted)
        found = deviation_columns(deviations, run, name, PredictedSignals({name: values}, {name: slopes}), unknowns)
        block[:, :own], block[:, own + of_unknowns : len(deviations) + of_unknowns] = found[:, :own], found[:, own:]
        if signatures is not None:
            block[:, len(deviations) + of_unknowns : -1] = signatures[name]
        block[:, -1] = measured - values
        block[:] = whiten(block, campaign.channels[name])
    if fails:  # samples without a prediction must not look like samples that were not measured
        columns[:] = np.nan
        return columns, own
    known = np.isfinite(columns[:, -1])
    return columns if known.all() else columns[known], own


def bounded(run: BenchRun, predicted: PredictedSignals) -> PredictedSignals:
    """Predicted signals whose derivatives are limited to `MAX_DERIVATIVE` times the range of each signal.

    Where friction sticks or valves bounce, derivatives may grow without limit along a run. A linear prediction of a
    change far beyond the range of a signal means nothing, but would hide all other columns by its size.
    """
    return PredictedSignals(predicted.values, {n: bounded_slopes(run, n, predicted) for n in predicted.values})


def bounded_slopes(run: BenchRun, name: str, predicted: PredictedSignals) -> np.ndarray:
    """The derivatives (samples, unknowns) of one signal, limited to `MAX_DERIVATIVE` times its range."""
    values, slopes = predicted.values[name], predicted.sensitivities[name]
    measured = run.signals.get(name, values)
    extents = [np.ptp(v[np.isfinite(v)]) for v in (values, measured) if np.isfinite(v).any()]
    limit = MAX_DERIVATIVE * float(max(extents, default=0.0))
    return np.clip(slopes, -limit, limit) if limit > 0.0 else slopes


def run_equations(columns: np.ndarray, own: int, gram: np.ndarray | None = None) -> RunEquations:
    """The products of the columns of a run with the first `own` of them marginalised; `gram` where they are known."""
    with np.errstate(over="ignore", invalid="ignore"):
        gram = columns.T @ columns if gram is None else gram
        return RunEquations(marginalised(gram, slice(0, own)), len(columns))


def marginalised(gram: np.ndarray, place: slice) -> np.ndarray:
    """Products without the columns at `place`, their coefficients with standard normal priors integrated out."""
    kept = np.ones(len(gram), bool)
    kept[place] = False
    inner = gram[place, place]
    cross = gram[np.ix_(kept, ~kept)]
    return gram[np.ix_(kept, kept)] - cross @ regularised_inverse(np.eye(len(inner)) + inner) @ cross.T
