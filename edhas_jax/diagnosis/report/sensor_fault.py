"""The error of a faulty sensor over its signal or the rate of change: measured, and predicted by its fault."""

import dataclasses

import numpy as np

from edhas_jax.core.chart import Chart, Curve, Style, Tone, draw_chart
from edhas_jax.diagnosis.candidates.candidate import Candidate
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.machine.interface.signals import Signal
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.residuals import Z_95

ERROR_BINS = 24  # bins of equal count over which errors are averaged


@dataclasses.dataclass(frozen=True)
class SensorError:
    """Mean error of a sensor (recorded − true) in bins of equal count, all arrays (bins,) in SI.

    Args:
        candidate: the sensor fault.
        over_rate: whether `x` is the rate of change of the signal, else the signal itself.
        x: mean of the true signal, or of its rate.
        measured: mean of measured − simulated true signal.
        std: standard error of `measured` due to the noise.
        modelled: mean error that the fitted sensor fault predicts.
        about: the signal.
    """

    candidate: Candidate
    over_rate: bool
    x: np.ndarray
    measured: np.ndarray
    std: np.ndarray
    modelled: np.ndarray
    about: Signal


def estimate_sensor_error(fitted: Fit, candidate: Candidate) -> SensorError:
    """Compare the error of a sensor in the fitted runs with the error that its fitted fault predicts.

    Args:
        fitted: a fit that contains the sensor fault.
        candidate: the sensor fault. One without memory is shown over the signal, others over its rate.
    """
    signal, base = candidate.signal, fitted.problem.model()
    chain = tuple(link for link in fitted.instruments.chains[signal] if not isinstance(link, candidate.kind))
    instruments = Instruments({**fitted.instruments.chains, signal: chain})
    model = MeasurementModel(base.campaign, fitted.machine, (), fitted.runs, instruments)
    found = model.predict_all_runs(np.zeros(0), fitted.resolution.fine)
    over_rate = not candidate.kind.memoryless
    rows = []
    for r, run in enumerate(base.runs):
        if signal in run.signals:
            true, recorded = found[r].values[signal], fitted.outcomes[r].values[signal]
            x = np.gradient(true, run.time) if over_rate else true
            valid = np.isfinite(run.signals[signal])
            rows.append(np.array([x, run.signals[signal] - true, recorded - true])[:, valid])
    x, measured, modelled = np.concatenate(rows, axis=1)
    bins = np.array_split(np.argsort(x), ERROR_BINS)
    noise = base.campaign.channels[signal].noise
    x, measured, modelled = (np.array([v[b].mean() for b in bins]) for v in (x, measured, modelled))
    std = noise / np.sqrt([len(b) for b in bins])
    about = fitted.problem.machine.signals[candidate.signal]
    return SensorError(candidate, over_rate, x, measured, std, modelled, about)


def draw_sensor_fault(error: SensorError):
    """Draw the error of a sensor over its signal, or over the rate of change: measured, and by the accepted fault.

    Returns:
        A matplotlib figure.
    """
    from edhas_jax.core.figure import Figure

    about = error.about
    figure = Figure(figsize=(7.6, 4.2), layout="constrained")
    axes = figure.subplots()
    measured, modelled, std = map(about.shown_difference, (error.measured, error.modelled, error.std))
    x = about.shown_difference(error.x) if error.over_rate else about.shown(error.x)
    curves = (
        Curve(f"fault that was found: {error.candidate.name}", x, modelled, Tone.MODEL),
        Curve("measured − model, mean, 95 %", x, measured, Tone.DATA, Style.MARKS, Z_95 * std),
        Curve("", x[[0, -1]], np.zeros(2), Tone.BESIDE),
    )
    name = error.candidate.signal.replace("_", " ")
    label = f"rate of {name}, {about.display_unit}/s" if error.over_rate else f"{name}, {about.display_unit}"
    draw_chart(axes, Chart(label, f"error of {name}, {about.display_unit}", curves))
    figure.legend(loc="outside upper left", ncols=2, fontsize=9, frameon=False)
    return figure
