"""Figures of merit of a comparison by run and signal: errors, gain, phase, delay and whiteness of the residuals."""

import numpy as np
import pandas as pd

from edhas_jax.measurements.comparison import Comparison, RunComparison
from edhas_jax.measurements.residuals import autocorrelation, rms_over_noise

COLUMNS = {
    "residual_over_noise": "rms of (measured − model), in standard deviations of the sensor's noise",
    "nrmse": "rms of (measured − model) over the range of the measured signal",
    "peak": "difference of the largest values: measured − model",
    "mean": "mean difference: measured − model",
    "harmonic": "multiple of the set point's frequency at which amplitude and phase are compared: the one that carries "
    "the signal, 2 for most rectified ones; none where the model or the measurement has no power at a common one",
    "amplitude": "amplitude of the model over that of the measured signal, at this harmonic",
    "phase": "phase lag of the model behind the measured signal, at this harmonic and in its own angle, rad",
    "delay": "delay of the model behind the measured signal, s: least-squares slope of the residual over the rate",
    "memory": "autocorrelation of the residuals at a lag of one sample: 0 for white noise",
    "white": "whether the residuals pass as white noise (Ljung-Box test over 20 lags, 1 % significance)",
}
MAX_HARMONIC = 10
MIN_SHARE_OF_POWER = 0.1  # of the alternating power of model and measurement that a harmonic must carry
MIN_AMPLITUDE_OVER_ERROR = 10.0  # amplitude of a measured harmonic over the standard error that noise gives it
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
        (compared.run.name, signal): _row(compared, signal, comparison.campaign.channels[signal].noise)
        for compared in comparison.runs
        for signal in compared.residuals
    }
    index = pd.MultiIndex.from_tuples(rows, names=["run", "signal"])
    return pd.DataFrame(list(rows.values()), index=index, columns=list(COLUMNS))


def _row(compared: RunComparison, signal: str, noise: float) -> dict[str, float]:
    """Figures of merit of a signal whose noise has this standard deviation (SI)."""
    measured, model, residuals = compared.run.signals[signal], compared.model[signal], compared.residuals[signal]
    valid = np.isfinite(measured) & np.isfinite(model)
    if valid.sum() < 2:
        return dict.fromkeys(COLUMNS, np.nan) | {"residual_over_noise": np.inf, "white": False}
    error = np.where(valid, measured - model, np.nan)
    rate = np.gradient(model, compared.run.time)[valid]
    rate_squared = float(rate @ rate)
    memory, statistic = ljung_box(residuals)
    harmonic, ratio = _harmonic_ratio(compared, measured, model, valid, noise)
    return {
        "residual_over_noise": rms_over_noise([residuals]),
        "nrmse": float(np.sqrt(np.nanmean(error**2)) / (np.ptp(measured[valid]) or np.nan)),
        "peak": float(measured[valid].max() - model[valid].max()),
        "mean": float(np.nanmean(error)),
        "harmonic": harmonic,
        "amplitude": abs(ratio),
        "phase": float(-np.angle(ratio)) if np.isfinite(ratio) else np.nan,
        "delay": float(error[valid] @ rate) / rate_squared if rate_squared > 0.0 else np.nan,
        "memory": memory,
        "white": bool(statistic < CHI_SQUARED_LIMIT),
    }


def _harmonic_ratio(
    compared: RunComparison, measured: np.ndarray, model: np.ndarray, valid: np.ndarray, noise: float
) -> tuple[float, complex]:
    """The harmonic that carries a signal, and its Fourier coefficient in the model over that in the measured signal.

    The coefficients are fitted by least squares to the valid samples of the whole cycles after the ramp.

    Returns:
        NaN twice for a set point without cycles, or where no harmonic has power in both signals.
    """
    none = np.nan, complex(np.nan)
    if not np.isfinite(compared.frequency):
        return none
    time = compared.run.time
    cycles = np.floor((time[-1] - max(compared.ramp_time, time[0])) * compared.frequency)
    selected = valid & (time > time[-1] - cycles / compared.frequency)
    count, samples_per_cycle = int(selected.sum()), 1.0 / (compared.frequency * compared.run.interval)
    harmonics = np.arange(1, min(MAX_HARMONIC, int(samples_per_cycle / 4.0)) + 1)
    if cycles < 1 or not len(harmonics) or count < 4 * (2 * len(harmonics) + 1):
        return none
    angle = 2.0 * np.pi * compared.frequency * np.outer(time[selected], harmonics)
    basis = np.hstack([np.ones((count, 1)), np.cos(angle), np.sin(angle)])
    signals = np.stack([measured[selected], model[selected]], axis=1)
    terms = np.linalg.lstsq(basis, signals, rcond=None)[0][1:]
    of_measured, of_model = (terms[: len(harmonics)] - 1j * terms[len(harmonics) :]).T
    k = int(np.argmax(np.abs(of_measured) * np.abs(of_model)))
    least = np.sqrt(2.0 * MIN_SHARE_OF_POWER) * signals.std(axis=0)
    noise_limit = MIN_AMPLITUDE_OVER_ERROR * noise * np.sqrt(2.0 / count)
    if abs(of_measured[k]) <= max(least[0], noise_limit) or abs(of_model[k]) <= max(least[1], noise_limit):
        return none
    return float(harmonics[k]), complex(of_model[k] / of_measured[k])


def ljung_box(residuals: np.ndarray) -> tuple[float, float]:
    """Autocorrelation at a lag of one sample, and the Ljung-Box statistic over `LJUNG_BOX_LAGS` lags.

    Args:
        residuals: residuals (samples,); samples without a finite one count as 0 after the mean is removed.

    Returns:
        The autocorrelation and the statistic, which is χ²-distributed for white noise; zeros for too few samples.

    Source: Ljung, Box, Biometrika 65 (1978) 297.
    """
    n = len(residuals)
    if n <= LJUNG_BOX_LAGS:
        return 0.0, 0.0
    found = autocorrelation(residuals, LJUNG_BOX_LAGS)[1:]
    weights = n - np.arange(1, LJUNG_BOX_LAGS + 1)
    return float(found[0]), float(n * (n + 2) * np.sum(found**2 / weights))
