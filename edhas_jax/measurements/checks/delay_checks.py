"""Detect time shifts: a recorder that starts late, channels of different recorders, a column moved by some rows.

The delay of each signal of each run against the model is estimated by maximising their correlation. A wrong or
incomplete model delays signals too, but it also changes their shape, delays other signals as well, and does so equally
in all runs. Therefore only a shift that other signals do not share and that leaves the shape unchanged is reported. A
sensor lag is a property of the sensor, not an error in the files.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from edhas_jax.core import runtime
from edhas_jax.core.remark import Remark
from edhas_jax.core.units import format_quantity
from edhas_jax.measurements.campaign import BenchRun, Campaign, SignalsByRun
from edhas_jax.measurements.sensor_models import SensorLag

MIN_SHIFT = 1e-3  # s; a wrong parameter can cause smaller shifts
MIN_SHIFT_IN_SAMPLES = 2.0
MAX_REMAINING_DIFFERENCE = 0.4  # shape difference after the shift over that before it, for a shift to explain it
MAX_SHAPE_DIFFERENCE = 0.3  # shape difference above which a signal does not look like the model's
MIN_SHARED_PORTION = 0.5  # portion of a shift that another signal has too if the machine causes it
MAX_COMMON_SPREAD = 0.3  # range of the shifts of all signals over their median, for a shift of the whole run
LAGS_BEYOND_SHIFT = (0.0, 0.5, 1.0, 1.5)  # intervals by which a time constant may exceed the delay that it resembles
SHIFTS_PER_SCAN = 81
REFINEMENTS = 3  # scans, each around the best shift of the one before
NO_SIGNAL_LIKE_MODEL = (
    "no signal looks like the model's; was the run made under these conditions? Is its time in the unit that is stated?"
)
MAX_SAMPLES = 1000  # samples of a run that are used


class Shift(NamedTuple):
    """Delay of a signal against the model [s], and the shape difference √(1 − ρ²) that remains at that delay."""

    delay: float
    difference: float


class DelayCheck:
    """The delays of all signals of all runs against the model.

    Args:
        campaign: the campaign.
        models: signals of the model (samples,) at the time stamps, by run and signal, SI; runs without are not checked.
    """

    def __init__(self, campaign: Campaign, models: SignalsByRun):
        self._runs = {run.name: run for run in campaign.runs if run.name in models}
        self._models = models
        self._shifts = {
            (run.name, name): self._best_shift(campaign, run, name)
            for run in self._runs.values()
            for name, values in run.signals.items()
            if np.isfinite(values).any() and np.nanmin(values) < np.nanmax(values)
        }
        self._median_delay = {name: self._median(name) for name in campaign.channels}

    def check(self) -> Iterator[Remark]:
        """Yield warnings on shifts of a signal in every run, of whole runs, and of single signals in single runs."""
        everywhere = [name for name in self._median_delay if self._is_shifted_everywhere(name)]
        for name in everywhere:
            delay = _delay_text(self._median_delay[name])
            sentence = f"{name} is {delay} against the model in every run, and no other signal is"
            first = next(iter(self._runs.values()))
            yield first.warning(f"{sentence}; was it recorded separately, or does its sensor delay it?")
        for run in self._runs.values():
            names = [name for other, name in self._shifts if other == run.name]
            if min((self._shifts[run.name, name].difference for name in names), default=0.0) > MAX_SHAPE_DIFFERENCE:
                yield run.warning(NO_SIGNAL_LIKE_MODEL)
                continue
            driver = "what drove the model" if run.drives else "the set point"
            excess = {n: self._excess_delay(run, n) for n in names if n not in everywhere}
            delays = list(excess.values())
            shifted = [n for n in excess if self._is_shifted(run, n, excess[n])]
            middle = float(np.median(delays)) if len(delays) > 1 else 0.0
            same_sign = middle and shifted and min(delays) * max(delays) > 0
            if same_sign and np.ptp(delays) / abs(middle) < MAX_COMMON_SPREAD:
                delay = _delay_text(middle)
                yield run.warning(f"all signals are {delay} against {driver}; does its time start with the run?")
                continue
            reference = "the other signals of this run" if len(excess) > 1 else f"{driver}; are both of one recorder?"
            for name in shifted:
                if not any(_shares(excess[other], excess[name]) for other in excess if other != name):
                    yield run.warning(f"{name} is {_delay_text(excess[name])} against {reference}")

    def _best_shift(self, campaign: Campaign, run: BenchRun, name: str) -> Shift:
        cycle = campaign.machine_of(run).cycle
        span = 0.02 * (run.time[-1] - run.time[0]) if cycle is None else 1.0 / float(cycle.frequency)
        centre, half = 0.0, span
        for _ in range(REFINEMENTS):
            delays = np.linspace(centre - half, centre + half, SHIFTS_PER_SCAN)
            differences = self._shape_differences(run, name, delays)
            centre, half = float(delays[int(np.argmin(differences))]), 2.0 * half / (SHIFTS_PER_SCAN - 1)
        return Shift(centre, float(min(differences)))

    def _shape_difference(self, run: BenchRun, name: str, delay: float, lag: float = 0.0) -> float:
        """`_shape_differences` at one delay [s]."""
        return float(self._shape_differences(run, name, np.array([delay]), lag)[0])

    def _shape_differences(self, run: BenchRun, name: str, delays: np.ndarray, lag: float = 0.0) -> np.ndarray:
        """√(1 − ρ²) at some delays [s], ρ the correlation of the signal with the model's, lagged too; 1 for ρ ≤ 0."""
        model = self._models[run.name][name]
        if lag:
            model = np.asarray(_lagged(lag, run.time, model))
        used = np.isfinite(run.signals[name])
        used[np.arange(len(used)) % (1 + len(used) // MAX_SAMPLES) > 0] = False
        a, b = run.signals[name][used], np.interp(run.time[used] - delays[:, None], run.time, model)
        a, b = a - a.mean(), b - b.mean(axis=1, keepdims=True)
        products, norms = b @ a, np.sqrt((a @ a) * np.sum(b**2, axis=1))
        correlation = np.where(products > 0.0, products / np.where(norms > 0.0, norms, 1.0), 0.0)
        return np.sqrt(np.maximum(0.0, 1.0 - correlation**2))

    def _median(self, name: str) -> float:
        delays = [shift.delay for (_, other), shift in self._shifts.items() if other == name]
        return float(np.median(delays)) if len(delays) > 2 else 0.0

    def _excess_delay(self, run: BenchRun, name: str) -> float:
        """Delay of a signal beyond its median over the runs [s]."""
        return self._shifts[run.name, name].delay - self._median_delay[name]

    def _is_shifted(self, run: BenchRun, name: str, excess: float) -> bool:
        difference = self._shifts[run.name, name].difference
        before = self._shape_difference(run, name, self._median_delay[name])
        limit = min(MAX_SHAPE_DIFFERENCE, MAX_REMAINING_DIFFERENCE * before)
        return abs(excess) > max(MIN_SHIFT, MIN_SHIFT_IN_SAMPLES * run.interval) and difference < limit

    def _is_shifted_everywhere(self, name: str) -> bool:
        """Whether a signal alone is shifted in every run, by a pure delay rather than by the lag of a sensor."""
        delay = self._median_delay[name]
        runs = [self._runs[other] for other, n in self._shifts if n == name]
        min_shift = max([MIN_SHIFT, *(MIN_SHIFT_IN_SAMPLES * run.interval for run in runs)])
        others = (self._median_delay[n] for n in self._median_delay if n != name)
        if abs(delay) < min_shift or any(_shares(other, delay) for other in others):
            return False
        after = np.array([self._shape_difference(run, name, delay) for run in runs])
        before = np.array([self._shape_difference(run, name, 0.0) for run in runs])
        if np.median(after / before) > MAX_REMAINING_DIFFERENCE or np.median(after) > MAX_SHAPE_DIFFERENCE:
            return False
        if delay < 0.0:
            return True
        # a lag of sampled values delays them by half an interval less than its time constant
        lagged = np.array([
            min(self._shape_difference(run, name, 0.0, lag=delay + k * run.interval) for k in LAGS_BEYOND_SHIFT)
            for run in runs
        ])  # fmt: skip
        return np.sum(after**2) < np.sum(lagged**2)


@runtime.jit
def _lagged(lag, time, values):
    return SensorLag(lag_time=lag).record(time, values)


def _delay_text(delay: float) -> str:
    return f"{format_quantity(abs(delay), 's')} {'late' if delay > 0.0 else 'early'}"


def _shares(other: float, delay: float) -> bool:
    """Whether another delay has the same sign and a good part of the size."""
    return other * delay > 0.0 and abs(other) > MIN_SHARED_PORTION * abs(delay)
