"""Signals shifted in time: a recorder that starts late, channels of different recorders, a column moved by some rows.

Each signal of each run is moved against the model's until they look most alike. A wrong or incomplete model moves
signals too, but it also changes their shape, moves neighbours along, and does so alike in all runs: what is told is a
shift that the others do not share and that leaves the shape as it is. A sensor's lag is no fault of the files.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import jax
import numpy as np

from edhas_jax.core.units import format_quantity
from edhas_jax.machine.components.set_points import Sine
from edhas_jax.measurements.campaign import BenchRun, Campaign, Remark, Severity
from edhas_jax.measurements.sensor_models import SensorLag

LAGS = (0.0, 0.5, 1.0, 1.5)  # intervals by which the time constant of a lag may exceed the shift it looks like
LEAST = 1e-3  # s; smaller shifts cannot be told from what a wrong parameter does
SAMPLES = 2.0  # and shifts by fewer samples
BETTER = 0.4  # what moving the signal leaves of the difference to the model
ALIKE = 0.3  # difference to the model, as a share of the signal, above which shapes are not the same
SHARED = 0.5  # share of a shift that another signal has too when it comes from the machine
COUNT = 81  # shifts that are tried
ENOUGH = 4000  # samples of a run that are looked at


class Shift(NamedTuple):
    """How late a signal is against the model [s], and the difference to it that remains there."""

    late: float
    left: float


class DelayCheck:
    """The shifts of all signals of all runs against `models`: by run, the model's signals at the samples."""

    def __init__(self, campaign: Campaign, models: Mapping[str, Mapping[str, np.ndarray]]):
        self._runs = {run.name: run for run in campaign.runs if run.name in models}
        self._models = models
        self._found = {
            (run.name, name): self._best(campaign, run, name)
            for run in self._runs.values()
            for name, values in run.signals.items()
            if np.isfinite(values).any() and np.nanmin(values) < np.nanmax(values)
        }
        names = campaign.channels
        self._usual = {name: self._median(name) for name in names}

    def check(self) -> Iterator[Remark]:
        """What is shifted: whole runs, signals in single runs, signals in every run."""
        everywhere = [name for name in self._usual if self._is_shifted_everywhere(name)]
        for name in everywhere:
            told = _told(self._usual[name])
            for run in list(self._runs.values())[:1]:
                sentence = f"{name} comes {told} against the model in every run, and no other signal does"
                yield _warning(run, f"{sentence}; a recorder of its own, or a delay of the sensor?")
        for run in self._runs.values():
            names = [name for other, name in self._found if other == run.name]
            if min((self._found[run.name, name].left for name in names), default=0.0) > ALIKE:
                yield _warning(run, "no signal looks like the model's; are these the conditions that it was run under?")
                continue
            moved = {n: self._moved(run, n) for n in names if n not in everywhere}
            sizes = list(moved.values())
            sure = [n for n in moved if self._is_sure(run, n, moved[n])]
            if len(sizes) > 1 and sure and min(sizes) * max(sizes) > 0 and _spread(sizes) < 0.3:
                told = _told(float(np.median(sizes)))
                yield _warning(run, f"all signals come {told} against the set point; does its time start with the run?")
                continue
            for name in sure:
                if not any(_shares(moved[other], moved[name]) for other in moved if other != name):
                    yield _warning(run, f"{name} comes {_told(moved[name])} against the other signals of this run")

    def _best(self, campaign: Campaign, run: BenchRun, name: str) -> Shift:
        drive = campaign.machine_of(run).reference
        span = 1.0 / float(drive.frequency) if isinstance(drive, Sine) else 0.02 * (run.time[-1] - run.time[0])
        centre, half = 0.0, span
        for _ in range(3):
            tried = np.linspace(centre - half, centre + half, COUNT)
            left = [self._left(run, name, late) for late in tried]
            centre, half = float(tried[int(np.argmin(left))]), 2.0 * half / (COUNT - 1)
        return Shift(centre, min(left))

    def _left(self, run: BenchRun, name: str, late: float, lag: float = 0.0) -> float:
        """What differs in shape when the model is delayed: √(1 − ρ²), ρ the correlation."""
        model = self._models[run.name][name]
        if lag:
            model = np.asarray(_lagged(lag, run.time, model))
        seen = np.isfinite(run.signals[name])
        seen[np.arange(len(seen)) % (1 + len(seen) // ENOUGH) > 0] = False
        a, b = run.signals[name][seen], np.interp(run.time[seen] - late, run.time, model)
        a, b = a - a.mean(), b - b.mean()
        both = np.sqrt((a @ a) * (b @ b))
        return float(np.sqrt(max(0.0, 1.0 - (a @ b / both) ** 2))) if both > 0.0 and a @ b > 0.0 else 1.0

    def _median(self, name: str) -> float:
        late = [shift.late for (_, other), shift in self._found.items() if other == name]
        return float(np.median(late)) if len(late) > 2 else 0.0

    def _moved(self, run: BenchRun, name: str) -> float:
        """How much later than usual for this signal [s]."""
        return self._found[run.name, name].late - self._usual[name]

    def _is_sure(self, run: BenchRun, name: str, moved: float) -> bool:
        left = self._found[run.name, name].left
        unmoved = self._left(run, name, self._usual[name])
        return abs(moved) > max(LEAST, SAMPLES * run.interval) and left < min(ALIKE, BETTER * unmoved)

    def _is_shifted_everywhere(self, name: str) -> bool:
        """Whether a signal is alone in being late in every run, by a pure shift; a sensor's lag is none."""
        late = self._usual[name]
        runs = [self._runs[other] for other, n in self._found if n == name]
        least = max([LEAST, *(SAMPLES * run.interval for run in runs)])
        if abs(late) < least or any(_shares(self._usual[n], late) for n in self._usual if n != name):
            return False
        shifted = np.array([self._left(run, name, late) for run in runs])
        unmoved = np.array([self._left(run, name, 0.0) for run in runs])
        if np.median(shifted / unmoved) > BETTER or np.median(shifted) > ALIKE:
            return False
        if late < 0.0:
            return True
        # a lag of sampled values is late by half an interval less than its time constant
        lagged = np.array([min(self._left(run, name, 0.0, lag=late + k * run.interval) for k in LAGS) for run in runs])
        return np.sum(shifted**2) < np.sum(lagged**2)


@jax.jit
def _lagged(lag, time, values):
    return SensorLag(lag_time=lag).record(time, values)


def _warning(run: BenchRun, sentence: str) -> Remark:
    return Remark(Severity.WARNING, run.file, 0, sentence)


def _told(late: float) -> str:
    return f"{format_quantity(abs(late), 's')} {'late' if late > 0.0 else 'early'}"


def _shares(other: float, late: float) -> bool:
    return other * late > 0.0 and abs(other) > SHARED * abs(late)


def _spread(sizes: list[float]) -> float:
    return float(np.ptp(sizes) / abs(np.median(sizes)))
