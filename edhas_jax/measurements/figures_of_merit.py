"""Figures of merit of a comparison by run and signal: errors, gain, phase, delay and whiteness of the residuals."""

import numpy as np
import pandas as pd

from edhas_jax.measurements.comparison import Comparison, RunComparison
from edhas_jax.measurements.residuals import rms_over_noise

COLUMNS = {
    "residual_over_noise": "rms of (measured − model), in standard deviations of the sensor's noise",
    "nrmse": "rms of (measured − model) over the range of the measured signal",
    "peak": "difference of the largest values: measured − model",
    "mean": "mean difference: measured − model",
    "amplitude": "first harmonic: amplitude of the measured signal over that of the model",
    "phase": "first harmonic: phase lag of the measured signal behind the model, rad",
    "delay": "delay of the measured signal, s, from the least-squares slope of the residual over the model's rate",
    "memory": "autocorrelation of the residuals at a lag of one sample: 0 for white noise",
    "white": "whether the residuals pass as white noise (Ljung-Box test over 20 lags, 1 % significance)",
}
LJUNG_BOX_LAGS = 20
CHI_SQUARED_LIMIT = 37.57  # 99 % quantile of χ² with 20 degrees of freedom


def figures_of_merit(comparison: Comparison) -> pd.DataFrame:
    """Figures of merit of every signal in every run.

    Args:
        comparison: the model compared with the measurements.

    Returns:
        A table indexed by run and signal with the columns of `COLUMNS`, in SI units.
    """
    rows = {
        (compared.run.name, signal): _row(compared, signal)
        for compared in comparison.runs
        for signal in compared.residuals
    }
    index = pd.MultiIndex.from_tuples(rows, names=["run", "signal"])
    return pd.DataFrame(list(rows.values()), index=index, columns=list(COLUMNS))


def _row(compared: RunComparison, signal: str) -> dict[str, float]:
    measured, model, residuals = compared.run.signals[signal], compared.model[signal], compared.residuals[signal]
    valid = np.isfinite(measured) & np.isfinite(model)
    if valid.sum() < 2:
        return dict.fromkeys(COLUMNS, np.nan) | {"residual_over_noise": np.inf, "white": False}
    error = np.where(valid, measured - model, np.nan)
    rate = np.gradient(model, compared.run.time)[valid]
    rate_squared = float(rate @ rate)
    autocorrelation, statistic = ljung_box(residuals)
    ratio = _first_harmonic_ratio(compared, measured, model, valid)
    return {
        "residual_over_noise": rms_over_noise([residuals]),
        "nrmse": float(np.sqrt(np.nanmean(error**2)) / (np.ptp(measured[valid]) or np.nan)),
        "peak": float(measured[valid].max() - model[valid].max()),
        "mean": float(np.nanmean(error)),
        "amplitude": abs(ratio),
        "phase": float(-np.angle(ratio)) if np.isfinite(ratio) else np.nan,
        "delay": -float(error[valid] @ rate) / rate_squared if rate_squared > 0.0 else np.nan,
        "memory": autocorrelation,
        "white": bool(statistic < CHI_SQUARED_LIMIT),
    }


def _first_harmonic_ratio(
    compared: RunComparison, measured: np.ndarray, model: np.ndarray, valid: np.ndarray
) -> complex:
    """First Fourier coefficient of the measured signal over that of the model, over whole cycles after the ramp."""
    if not np.isfinite(compared.frequency):
        return complex(np.nan)
    time = compared.run.time
    cycles = np.floor((time[-1] - max(compared.ramp_time, time[0])) * compared.frequency)
    selected = valid & (time > time[-1] - cycles / compared.frequency)
    if cycles < 1 or not selected.any():
        return complex(np.nan)
    phasor = np.exp(-2j * np.pi * compared.frequency * time[selected])
    of_model = np.mean((model[selected] - model[selected].mean()) * phasor)
    of_measured = np.mean((measured[selected] - measured[selected].mean()) * phasor)
    return complex(of_measured / of_model) if abs(of_model) > 0.0 else complex(np.nan)


def ljung_box(residuals: np.ndarray) -> tuple[float, float]:
    """Autocorrelation at a lag of one sample, and the Ljung-Box statistic over `LJUNG_BOX_LAGS` lags.

    Args:
        residuals: residuals (samples,); missing samples (NaN) count as 0 after the mean is removed.

    Returns:
        The autocorrelation and the statistic, which is χ²-distributed for white noise; zeros for too few samples.

    Source: Ljung, Box, Biometrika 65 (1978) 297.
    """
    values = np.nan_to_num(residuals - np.nanmean(residuals))
    n, power = len(values), float(values @ values)
    if power == 0.0 or n <= LJUNG_BOX_LAGS:
        return 0.0, 0.0
    autocorrelation = np.array([
        float(values[lag:] @ values[:-lag]) / power for lag in range(1, LJUNG_BOX_LAGS + 1)
    ])  # fmt: skip
    weights = n - np.arange(1, LJUNG_BOX_LAGS + 1)
    return float(autocorrelation[0]), float(n * (n + 2) * np.sum(autocorrelation**2 / weights))
