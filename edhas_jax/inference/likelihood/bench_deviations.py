"""What every bench does: small deviations of clock, settings and sensors, as linear columns with priors.

Per run the trigger is early or late, the settings are a little off and the coil is warmer or colder; per signal the
sensor has a small gain error, offset and time shift. Around a fit all of them are linear:

    trigger of a run, τ        ∂y/∂t · τ              for all signals of the run
    clock in a run             ∂y/∂t · P(t) · c       for all signals of the run, P a Legendre polynomial
    setting of a run           ∂y/∂ln p · δ           for all signals of the run
    gain, offset, time shift   y · g,  o,  −∂y/∂t · s  for one signal in all runs
    filter of the recorder     (F y − y) · w          for all signals in all runs, F a low-pass filter

Every column is in units of its prior standard deviation, so that its coefficient has a standard normal prior. This is
the accuracy of the bench, or less where a model leaves much unexplained (`with_tightened_bench`).
"""

import dataclasses
import enum
import functools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.polynomial import legendre
from scipy.signal import butter, lfilter, lfilter_zi

from edhas_jax.measurements.campaign import BenchRun, Campaign
from edhas_jax.measurements.measurement_model import PredictedSignals
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter

FILTER_CUTOFFS = 0.12, 0.19, 0.33  # over the sample rate
# the fastest change of a clock's rate [Hz] that the polynomials over a record follow, and their largest degree
CLOCK_FREQUENCY, MAX_CLOCK_DEGREE = 5.0, 8


class DeviationKind(enum.Enum):
    """What deviates."""

    TRIGGER = "trigger"
    CLOCK = "clock"
    SETTING = "setting"
    GAIN = "gain"
    OFFSET = "offset"
    SHIFT = "time shift"
    FILTER = "filter of the recorder"


@dataclasses.dataclass(frozen=True)
class Deviation:
    """One deviation of the bench.

    Args:
        kind: what deviates.
        name: the signal of a sensor, or the parameter of a setting; empty for a trigger, clock or filter.
        std: accuracy, a standard deviation: of a trigger, clock or time shift [s], relative of a gain or setting, SI of
            an offset, of the weight of a filter.
        cutoff: cut-off frequency of a filter over the sample rate; 0 for other kinds.
        degree: degree of the polynomial of a clock; 0 for other kinds.
        tightening: divides `std` in a fit.
    """

    kind: DeviationKind
    name: str
    std: float
    cutoff: float = 0.0
    tightening: float = 1.0
    degree: int = 0

    @property
    def prior_std(self) -> float:
        """Prior standard deviation in a fit, in the unit of `std`."""
        return self.std / self.tightening


@dataclasses.dataclass(frozen=True)
class BenchDeviations:
    """The deviations of a bench that are marginalised.

    Args:
        of_runs: deviations that each run has on its own.
        of_sensors: deviations of the sensors, common to all runs.
    """

    of_runs: tuple[Deviation, ...] = ()
    of_sensors: tuple[Deviation, ...] = ()

    @property
    def count(self) -> int:
        """Number of deviations that are common to all runs."""
        return len(self.of_sensors)


def bench_deviations(campaign: Campaign, unknowns: Sequence[UnknownParameter]) -> BenchDeviations:
    """The deviations of a campaign whose columns can be formed from the sensitivities by some unknowns."""
    return BenchDeviations(tuple(_run_deviations(campaign, unknowns)), tuple(_sensor_deviations(campaign)))


def _run_deviations(campaign: Campaign, unknowns: Sequence[UnknownParameter]) -> list[Deviation]:
    """The deviations that each run has on its own: trigger, clock, settings, and temperature of the coil.

    A setting counts where it is among the unknowns on a logarithmic scale, whose sensitivities are at hand.
    """
    found = [Deviation(DeviationKind.TRIGGER, "", campaign.accuracy.trigger)]
    if error := campaign.accuracy.clock_error:
        degrees = range(1, max((clock_degree(run) for run in campaign.runs), default=0) + 1)
        found += [Deviation(DeviationKind.CLOCK, "", error, degree=degree) for degree in degrees]
    logarithmic = {u.name for u in unknowns if u.scale is ParameterScale.LOGARITHMIC}
    settings = campaign.accuracy.settings.items()
    found += [
        Deviation(DeviationKind.SETTING, name, std, tightening=campaign.tightening)
        for name, std in settings
        if name in logarithmic
    ]
    return [deviation for deviation in found if deviation.std > 0.0]


def _sensor_deviations(campaign: Campaign) -> list[Deviation]:
    """The deviations of the sensors, which are the same in all runs."""
    found = []
    for name, accuracy in campaign.accuracy.signals.items():
        sizes = (
            (DeviationKind.GAIN, accuracy.gain), (DeviationKind.OFFSET, accuracy.offset),
            (DeviationKind.SHIFT, accuracy.shift),
        )  # fmt: skip
        found += [Deviation(kind, name, std, tightening=campaign.tightening) for kind, std in sizes]
    found = [deviation for deviation in found if deviation.std > 0.0 and deviation.name in campaign.channels]
    # one anti-alias filter for all channels is usual; any cut-off is nearly a combination of these
    std = campaign.accuracy.recorder_filter
    return found + [Deviation(DeviationKind.FILTER, "", std, cutoff) for cutoff in FILTER_CUTOFFS if std > 0.0]


def clock_degree(run: BenchRun) -> int:
    """The largest degree of the polynomials that describe the error of the clock in a run."""
    duration = float(run.time[-1] - run.time[0])
    return min(1 + math.ceil(2.0 * CLOCK_FREQUENCY * duration), MAX_CLOCK_DEGREE)


def record_position(run: BenchRun) -> np.ndarray:
    """The time stamps (samples,) of a run, scaled to −1 at the start of its record and 1 at its end."""
    return 2.0 * (run.time - run.time[0]) / max(float(run.time[-1] - run.time[0]), np.finfo(float).tiny) - 1.0


def deviation_columns(
    deviations: Sequence[Deviation], run: BenchRun, signal: str, predicted: PredictedSignals,
    unknowns: Sequence[UnknownParameter],
) -> np.ndarray:  # fmt: skip
    """The change of one signal of one run by each deviation of one standard deviation, (samples, deviations) in SI.

    Args:
        deviations: what may deviate.
        run: gives the time of the samples.
        signal: name of the signal.
        predicted: the signals at the fit, with their sensitivities.
        unknowns: the unknowns of these sensitivities.
    """
    values = predicted.values[signal]
    columns = np.zeros((len(values), len(deviations)))
    if not deviations:
        return columns
    rate = np.gradient(values, run.time)
    places = {u.name: k for k, u in enumerate(unknowns)}
    polynomials = np.zeros((0, len(values)))
    if any(deviation.kind is DeviationKind.CLOCK for deviation in deviations):
        polynomials = legendre.legvander(record_position(run), clock_degree(run)).T
    for k, deviation in enumerate(deviations):
        if deviation.kind is DeviationKind.TRIGGER:
            columns[:, k] = deviation.prior_std * rate
        elif deviation.kind is DeviationKind.CLOCK:
            if deviation.degree < len(polynomials):
                columns[:, k] = deviation.prior_std * polynomials[deviation.degree] * rate
        elif deviation.kind is DeviationKind.SETTING:
            place = places[deviation.name]
            columns[:, k] = predicted.sensitivities[signal][:, place] * (deviation.prior_std / unknowns[place].spread)
        elif deviation.kind is DeviationKind.FILTER:
            columns[:, k] = deviation.prior_std * (_filtered(values, deviation.cutoff) - values)
        elif deviation.name == signal:
            columns[:, k] = deviation.prior_std * _sensor_change(deviation.kind, values, rate)
    return columns


def _filtered(values: np.ndarray, cutoff: float) -> np.ndarray:
    """Values after a Butterworth filter of second order that starts in steady state; `cutoff` over the sample rate."""
    numerator, denominator, steady = _filter_design(cutoff)
    return lfilter(numerator, denominator, values, zi=steady * values[0])[0]


@functools.cache
def _filter_design(cutoff: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Numerator, denominator and initial state in steady state of the filter; designed once for many columns."""
    numerator, denominator = butter(2, 2.0 * cutoff)
    return numerator, denominator, lfilter_zi(numerator, denominator)


def _sensor_change(kind: DeviationKind, values: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """The change of a signal by a unit gain error, offset or time shift of its sensor."""
    changes: Mapping[DeviationKind, np.ndarray] = {
        DeviationKind.GAIN: values, DeviationKind.OFFSET: np.ones_like(values), DeviationKind.SHIFT: -rate,
    }  # fmt: skip
    return changes[kind]
