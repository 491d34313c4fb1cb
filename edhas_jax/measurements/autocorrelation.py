"""Autocorrelation of residuals: what a model leaves is white noise where it is right."""

import math

import numpy as np

from edhas_jax.measurements.residuals import Z_95


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
