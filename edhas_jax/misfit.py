"""How far a model is from the measurements, in units of the sensors' noise."""

import math
from collections.abc import Iterable, Mapping

import numpy as np

from edhas_jax.campaign import BenchRun, Campaign, Use
from edhas_jax.prediction import Outcome

OVERALL = "overall"


def whitened(campaign: Campaign, run: BenchRun, outcome: Outcome) -> dict[str, np.ndarray]:
    """(measured − model)/noise (n,) by signal; NaN where a sample is missing."""
    return {
        n: (values - outcome.values[n]) / campaign.channels[n].noise
        for n, values in run.signals.items()
        if n in outcome.values
    }


def level(residuals: Iterable[np.ndarray]) -> float:
    """The rms of residuals in units of their noise over all samples that were measured; inf if the model failed."""
    square, count = 0.0, 0
    for values in residuals:
        square += float(np.nansum(np.square(values)))
        count += int(np.isfinite(values).sum())
    return math.sqrt(square / count) if count else math.inf


def levels(campaign: Campaign, residuals: Mapping[str, Mapping[str, np.ndarray]], use: Use) -> dict[str, float]:
    """Residual over noise of the runs of one use, overall and by signal, from `residuals` by run and signal."""
    chosen = [residuals[run.name] for run in campaign.runs_for(use) if run.name in residuals]
    names = dict.fromkeys(n for signals in chosen for n in signals)
    out = {OVERALL: level(v for signals in chosen for v in signals.values())} if chosen else {}
    return out | {n: level(signals[n] for signals in chosen if n in signals) for n in names}
