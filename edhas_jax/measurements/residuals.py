"""Residuals between measurement and model in units of the sensor noise, and their rms."""

import math
from collections.abc import Iterable

import numpy as np

from edhas_jax.measurements.campaign import BenchRun, Campaign, SignalsByRun, Use
from edhas_jax.measurements.measurement_model import PredictedSignals

OVERALL = "overall"
Z_95 = 1.96  # standard errors on either side of a 95 % band


def normalised_residuals(campaign: Campaign, run: BenchRun, predicted: PredictedSignals) -> dict[str, np.ndarray]:
    """(measured − predicted)/(standard deviation of the noise) by signal (samples,).

    NaN where a sample is missing, inf where the model has no finite prediction of a measured one.
    """
    found = {}
    for n, measured in run.signals.items():
        if n in predicted.values:
            residual = (measured - predicted.values[n]) / campaign.channels[n].noise
            found[n] = np.where(np.isfinite(residual) | np.isnan(measured), residual, np.inf)
    return found


def rms_over_noise(residuals: Iterable[np.ndarray]) -> float:
    """The rms of normalised residuals over all finite samples; 1 is pure sensor noise, inf a failed simulation."""
    square_sum, count = 0.0, 0
    for values in residuals:
        square_sum += float(np.nansum(np.square(values)))
        count += int(np.isfinite(values).sum())
    return math.sqrt(square_sum / count) if count else math.inf


def rms_by_run(campaign: Campaign, residuals: SignalsByRun) -> dict[str, dict[str, float]]:
    """The rms of normalised residuals by run and signal; the parts of a run that was divided are taken together.

    Args:
        campaign: the runs.
        residuals: normalised residuals (samples,) by run and signal.
    """
    parts: dict[str, dict[str, list[np.ndarray]]] = {}
    for run in campaign.runs:
        for name, values in residuals.get(run.name, {}).items():
            parts.setdefault(run.whole, {}).setdefault(name, []).append(values)
    return {run: {name: rms_over_noise(rows) for name, rows in row.items()} for run, row in parts.items()}


def rms_by_signal(campaign: Campaign, residuals: SignalsByRun, use: Use) -> dict[str, float]:
    """The rms of normalised residuals over all runs of one use.

    Args:
        campaign: says which runs have that use.
        residuals: normalised residuals (samples,) by run and signal.
        use: fit or holdout.

    Returns:
        The rms by signal, and of all signals together under `OVERALL`; empty if there is no such run.
    """
    selected = [residuals[run.name] for run in campaign.runs_for(use) if run.name in residuals]
    names = dict.fromkeys(n for signals in selected for n in signals)
    overall = {OVERALL: rms_over_noise(v for signals in selected for v in signals.values())} if selected else {}
    return overall | {n: rms_over_noise(signals[n] for signals in selected if n in signals) for n in names}


def autocorrelation(residuals: np.ndarray, lags: int) -> np.ndarray:
    """The autocorrelation of residuals.

    Args:
        residuals: residuals (samples,); samples without a finite one count as 0 after the mean is removed.
        lags: largest lag, in samples.

    Returns:
        At lags 0 … lags, shape (lags + 1,); zeros for residuals without any power.

    Source: Box, Jenkins, Time Series Analysis (1976), section 2.1.5.
    """
    finite = np.where(np.isfinite(residuals), residuals, np.nan)
    if not np.isfinite(finite).any():
        return np.zeros(lags + 1)
    values = np.nan_to_num(finite - np.nanmean(finite))
    power = float(values @ values)
    if power == 0.0:
        return np.zeros(lags + 1)
    count = len(values)
    return np.array([float(values[lag:] @ values[: count - lag]) / power for lag in range(lags + 1)])


def white_noise_band(residuals: np.ndarray) -> float:
    """The size that the autocorrelation of white noise exceeds at one lag in twenty: 1.96/√samples.

    Args:
        residuals: residuals (samples,), of which the finite ones count.

    Source: Box, Jenkins, Time Series Analysis (1976), section 2.1.6.
    """
    return Z_95 / math.sqrt(max(int(np.isfinite(residuals).sum()), 1))
