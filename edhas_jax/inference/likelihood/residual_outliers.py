"""Wrong samples that only the residual of a fit shows: spikes where the signal itself is steep.

The checks of the data look for samples that deviate from their neighbours. Where a signal changes fast they have to be
careful; what a calibrated model leaves is smoother. A sharp event that the model lacks is no wrong sample: it disturbs
its neighbours, or repeats at the same phase of other cycles. Nor is one that the model has and the machine has not: the
record itself must leave the line between its neighbours as the residual does.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np

from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.checks.impossible_samples import find_signal_outliers, left_out_remark, removal_of
from edhas_jax.measurements.checks.outlier_search import bridged

MOST_LEFT_OUT = 0.01  # of the samples of a signal in a run: more are no single wrong samples
MIN_SHARE_IN_RECORD = 0.6  # of a residual's deviation from its neighbours; at a step made one sample late it is half

Residuals = Mapping[str, Mapping[str, np.ndarray]]  # over noise, by run and signal (samples,)


def without_outliers(campaign: Campaign, residuals: Residuals) -> Campaign:
    """A campaign without the samples whose residual is far from that of their neighbours.

    Args:
        campaign: the campaign.
        residuals: (measured − model)/noise.

    Returns:
        The campaign with NaN in their place and a remark on each signal; the given one where there are none.
    """
    # beside a gap no sample could be judged
    in_place = [
        dataclasses.replace(
            run,
            signals={n: campaign.channels[n].noise * bridged(v, np.isnan(v)) for n, v in residuals[run.name].items()},
        )
        if run.name in residuals
        else run
        for run in campaign.runs
    ]
    of_residuals = dataclasses.replace(campaign, runs=tuple(in_place))
    runs, judged = {run.name: run for run in campaign.runs}, {run.name: run for run in in_place}
    found: dict[str, dict[str, np.ndarray]] = {}
    for name in campaign.channels:
        for run, mask in find_signal_outliers(of_residuals, name, {}, with_excursions=False).items():
            mask &= _is_in_record(runs[run].signals[name], judged[run].signals[name], mask)
            if name not in runs[run].keep and 0 < np.count_nonzero(mask) <= MOST_LEFT_OUT * len(mask):
                found.setdefault(run, {})[name] = mask
    return _without(campaign, found)


def _is_in_record(values: np.ndarray, residual: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Where a record (samples,) leaves the line between the neighbours of some samples as its residual does."""
    in_record, in_residual = (row - bridged(row, mask) for row in (values, residual))
    with np.errstate(invalid="ignore"):
        return in_record * np.sign(in_residual) > MIN_SHARE_IN_RECORD * np.abs(in_residual)


def without_missing(campaign: Campaign, residuals: Residuals) -> Campaign:
    """A campaign without the samples that have no residual; the given one where there are none."""
    found: dict[str, dict[str, np.ndarray]] = {}
    for run in campaign.runs:
        for name, values in run.signals.items():
            mask = np.isnan(residuals.get(run.name, {}).get(name, values)) & np.isfinite(values)
            if mask.any():
                found.setdefault(run.name, {})[name] = mask
    return _without(campaign, found)


def _without(campaign: Campaign, masks: Mapping[str, Mapping[str, np.ndarray]]) -> Campaign:
    if not masks:
        return campaign
    runs, remarks, removed = [], [], []
    for run in campaign.runs:
        own = masks.get(run.name, {})
        signals = {n: np.where(own[n], np.nan, v) if n in own else v for n, v in run.signals.items()}
        runs.append(dataclasses.replace(run, signals=signals))
        for name, mask in own.items():
            count = int(np.count_nonzero(mask))
            what = f"{count} sample{'s' if count > 1 else ''} with a residual far from that of the neighbours"
            remarks.append(left_out_remark(run, name, mask, what))
            removed.append(removal_of(run, name, mask))
    remarks, removed = (*campaign.remarks, *remarks), (*campaign.removed, *removed)
    return dataclasses.replace(campaign, runs=tuple(runs), remarks=remarks, removed=removed)
