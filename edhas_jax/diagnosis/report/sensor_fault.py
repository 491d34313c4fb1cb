"""What a faulty sensor adds to a signal, over the signal or its rate, as measured and as the accepted fault says."""

import dataclasses

import numpy as np

from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.search.candidates import Suspect
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.sensor_models import SensorGain, SensorOffset

BINS = 24


@dataclasses.dataclass(frozen=True)
class SensorFault:
    """Recorded − true (n,) over the true signal, or over its rate where `over_rate`; means of equal counts, SI.

    `value` is from what was measured, with its standard error `std`; `law` from the accepted fault.
    """

    suspect: Suspect
    over_rate: bool
    at: np.ndarray
    value: np.ndarray
    std: np.ndarray
    law: np.ndarray


def sensor_fault(fitted: Fit, suspect: Suspect) -> SensorFault:
    """The fault of a sensor that is mounted in a fit, from the runs that were fitted."""
    signal, base = suspect.signal, fitted.problem.model()
    chain = tuple(link for link in fitted.instruments.chains[signal] if not isinstance(link, suspect.kind))
    instruments = Instruments({**fitted.instruments.chains, signal: chain})
    model = MeasurementModel(base.campaign, fitted.machine, (), base.runs, instruments)
    found = model.predict_all_runs(np.zeros(0), fitted.resolution.fine)
    over_rate = suspect.kind not in (SensorGain, SensorOffset)
    rows = []
    for r, run in enumerate(base.runs):
        if signal in run.signals:
            true, recorded = found[r].values[signal], fitted.outcomes[r].values[signal]
            along = np.gradient(true, run.time) if over_rate else true
            there = np.isfinite(run.signals[signal])
            rows.append(np.array([along, run.signals[signal] - true, recorded - true])[:, there])
    along, off, law = np.concatenate(rows, axis=1)
    bins = np.array_split(np.argsort(along), BINS)
    noise = base.campaign.channels[signal].noise
    at, value, mean = (np.array([v[k].mean() for k in bins]) for v in (along, off, law))
    return SensorFault(suspect, over_rate, at, value, noise / np.sqrt([len(k) for k in bins]), mean)
