"""Figures of merit of a comparison: one row for each run and signal."""

import numpy as np
import pandas as pd

from edhas_jax.comparison import Comparison, RunView
from edhas_jax.misfit import level

COLUMNS = {
    "residual_over_noise": "rms of (measured − model), in standard deviations of the sensor's noise",
    "nrmse": "the same over the range of what was measured",
    "peak": "largest value: measured − model",
    "mean": "mean value: measured − model",
    "amplitude": "first harmonic: measured over model",
    "phase": "first harmonic: measured after model, rad",
    "delay": "measured after model, s, from the slope of the residual along the model's rate",
    "memory": "correlation of residuals one sample apart: 0 for noise",
    "white": "whether the residuals pass for white noise (portmanteau test over 20 samples, 1 %)",
}
LAGS, CRITICAL = 20, 37.57  # χ² with 20 degrees of freedom, 1 %


def figures_of_merit(comparison: Comparison) -> pd.DataFrame:
    """A table indexed by run and signal with the columns of `COLUMNS`, SI."""
    rows = {
        (view.run.name, signal): _row(view, signal) for view in comparison.views for signal in view.residuals
    }  # fmt: skip
    index = pd.MultiIndex.from_tuples(rows, names=["run", "signal"])
    return pd.DataFrame(list(rows.values()), index=index, columns=list(COLUMNS))


def _row(view: RunView, signal: str) -> dict[str, float]:
    measured, model, white = view.run.signals[signal], view.model[signal], view.residuals[signal]
    ok = np.isfinite(measured) & np.isfinite(model)
    if ok.sum() < 2:
        return dict.fromkeys(COLUMNS, np.nan) | {"residual_over_noise": np.inf, "white": False}
    off = np.where(ok, measured - model, np.nan)
    rate = np.gradient(model, view.run.time)[ok]
    slow = float(rate @ rate)
    memory, portmanteau = whiteness(white)
    harmonic = _harmonics(view, measured, model, ok)
    return {
        "residual_over_noise": level([white]),
        "nrmse": float(np.sqrt(np.nanmean(off**2)) / (np.ptp(measured[ok]) or np.nan)),
        "peak": float(measured[ok].max() - model[ok].max()),
        "mean": float(np.nanmean(off)),
        "amplitude": abs(harmonic),
        "phase": float(-np.angle(harmonic)) if np.isfinite(harmonic) else np.nan,
        "delay": -float(off[ok] @ rate) / slow if slow > 0.0 else np.nan,
        "memory": memory,
        "white": bool(portmanteau < CRITICAL),
    }


def _harmonics(view: RunView, measured: np.ndarray, model: np.ndarray, ok: np.ndarray) -> complex:
    """The first harmonic of what was measured over that of the model, over whole cycles after the ramp."""
    if not np.isfinite(view.frequency):
        return complex(np.nan)
    time = view.run.time
    cycles = np.floor((time[-1] - view.steady) * view.frequency)
    inside = ok & (time > time[-1] - cycles / view.frequency)
    if cycles < 1 or not inside.any():
        return complex(np.nan)
    turn = np.exp(-2j * np.pi * view.frequency * time[inside])
    below = np.mean((model[inside] - model[inside].mean()) * turn)
    above = np.mean((measured[inside] - measured[inside].mean()) * turn)
    return complex(above / below) if abs(below) > 0.0 else complex(np.nan)


def whiteness(residuals: np.ndarray) -> tuple[float, float]:
    """Correlation one sample apart, and Ljung and Box's statistic over `LAGS` samples; holes are taken as 0.

    Source: Ljung, Box, Biometrika 65 (1978) 297.
    """
    values = np.nan_to_num(residuals - np.nanmean(residuals))
    n, power = len(values), float(values @ values)
    if power == 0.0 or n <= LAGS:
        return 0.0, 0.0
    memory = np.array([float(values[lag:] @ values[:-lag]) / power for lag in range(1, LAGS + 1)])
    return float(memory[0]), float(n * (n + 2) * np.sum(memory**2 / (n - np.arange(1, LAGS + 1))))
