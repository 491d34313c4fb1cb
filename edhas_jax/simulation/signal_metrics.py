"""Metrics of a rig of one's own: mean, rms, smallest, largest and last value of every signal of a run."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from edhas_jax.machine.rig_base import Rig
from edhas_jax.simulation.metrics import METRICS

KINDS = {
    "mean": "mean", "rms": "rms value", "smallest": "smallest value", "largest": "largest value", "final": "last value",
}  # fmt: skip

Declarations = Mapping[str, tuple[str, str, str]]


def metric_declarations(machine: Rig | type[Rig]) -> Declarations:
    """SI unit, unit for display and meaning of every metric that a machine can have, by name."""
    if not machine.is_own:
        return METRICS
    return {
        f"{kind}_{name}": (about.unit, about.display_unit, f"{words} of {name.replace('_', ' ')}, {about.doc}")
        for name, about in machine.signals.items()
        if name != "time"
        for kind, words in KINDS.items()
    }


@np.errstate(over="ignore", invalid="ignore")  # what is not finite is told by the status
def signal_metrics(time: np.ndarray, signals: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """The metrics of runs, each of the shape of their signals without the samples; NaN where a signal is.

    Args:
        time: times of the samples [s], (samples,), increasing.
        signals: by name in SI, each (samples, …).
    """
    found = {}
    for name, values in signals.items():
        if name == "time":
            continue
        mean = _mean(time, values)
        rms = np.sqrt(_mean(time, np.square(values)))
        parts = mean, rms, values.min(axis=0), values.max(axis=0), values[-1]
        found |= {f"{kind}_{name}": part for kind, part in zip(KINDS, parts, strict=True)}
    return found


def metric_slopes(
    time: np.ndarray, signals: Mapping[str, np.ndarray], slopes: Mapping[str, np.ndarray]
) -> dict[str, Any]:
    """The derivatives of `signal_metrics` along the changes `slopes` of the signals, arrays of the same shapes."""
    found = {}
    for name, values in signals.items():
        change = slopes[name]
        rms = np.sqrt(_mean(time, np.square(values)))
        with np.errstate(divide="ignore", invalid="ignore"):
            of_rms = np.where(rms > 0.0, _mean(time, values * change) / rms, np.nan)
        ends = [np.take_along_axis(change, index[None], axis=0)[0] for index in (values.argmin(0), values.argmax(0))]
        parts = _mean(time, change), of_rms, *ends, change[-1]
        found |= {f"{kind}_{name}": part for kind, part in zip(KINDS, parts, strict=True)}
    return found


def _mean(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The mean over time of what is linear between the samples."""
    if len(time) < 2:
        return values[0]
    return np.trapezoid(values, time, axis=0) / (time[-1] - time[0])
