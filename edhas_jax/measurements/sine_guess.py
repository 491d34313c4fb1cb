"""Read frequency and amplitude of the sine that has driven a bench from its record.

A guess is a proposal: the engineer confirms or changes it before a campaign is written.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.core.units import values_to_si
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.measurements.column_guess import GuessedColumn, Role
from edhas_jax.measurements.tables.table import Table

# signals that follow the set point, the nearest first; pressures and flows of a pump have twice its frequency
FOLLOWERS = "piston_position", "piston_velocity", "current", "voltage"
MIN_SAMPLES, MIN_CYCLES = 20, 1.5  # of the part that is used
MAX_GRID = 1 << 16  # samples of the part, from which it is thinned: a sine needs few
PADDING = 8  # times its length to which the part is extended, so that the peak of the spectrum is fine
MIN_SHARE = 0.8  # of the variance that the sine explains: friction and a drive that saturates distort what follows it
PHASE_ERROR = 0.002  # cycles over the record by which rounding of the frequency may shift the sine
AMPLITUDE_ROUNDING = 0.02  # by which a position may differ from its set point anyway


class SineGuess(NamedTuple):
    """A sine in a record.

    Attributes:
        column: the column in which it was found.
        frequency: [Hz], rounded within its accuracy.
        amplitude: of the position [m], rounded; NaN where the column is no position.
    """

    column: str
    frequency: float
    amplitude: float


def guess_sine(table: Table, columns: Sequence[GuessedColumn]) -> SineGuess | None:
    """Guess the sine that has driven a bench from what follows it, in the latter half of its record.

    Args:
        table: the table of a run.
        columns: what its columns are; those of the time and of what is used have a unit.

    Returns:
        The sine; None where no column has one, or no time.
    """
    time = next((c for c in columns if c.role is Role.TIME and c.column in table.columns), None)
    if time is None:
        return None
    seconds = _in_si(table, time, "s")
    followers = [c for name in FOLLOWERS for c in columns if c.role is Role.SIGNAL and c.signal == name]
    for column in (c for c in followers if c.column in table.columns):
        unit = SIGNALS[column.signal].unit
        found = _sine_in(seconds, _in_si(table, column, unit))
        if found is None:
            continue
        frequency, amplitude, duration = found
        shown = _rounded(frequency, PHASE_ERROR / (frequency * duration))
        size = _rounded(amplitude, AMPLITUDE_ROUNDING) if unit == "m" else math.nan
        return SineGuess(column.column, shown, size)
    return None


def _in_si(table: Table, column: GuessedColumn, unit: str) -> np.ndarray:
    """The values (samples,) of a column in SI.

    Raises:
        UnitError: its unit is unknown, or that of another quantity.
    """
    return values_to_si(table.columns[column.column].values, column.unit, unit)


def _sine_in(time: np.ndarray, values: np.ndarray) -> tuple[float, float, float] | None:
    """Frequency [Hz] and amplitude of the sine in the latter half of a record, and the length [s] of the record.

    Args:
        time: time stamps (samples,) [s].
        values: the values (samples,).
    """
    valid = np.isfinite(time) & np.isfinite(values)
    time, order = np.unique(time[valid], return_index=True)
    values = values[valid][order]
    if len(time) < 2:
        return None
    used = time >= 0.5 * (time[0] + time[-1])
    t, v = time[used] - time[used][0] if used.any() else time, values[used]
    if len(t) < MIN_SAMPLES or not np.ptp(v) > 0.0:
        return None
    grid = np.linspace(0.0, t[-1], min(len(t), MAX_GRID))
    even = np.interp(grid, t, v)
    step = grid[1]
    spectrum = np.abs(np.fft.rfft((even - even.mean()) * np.hanning(len(even)), PADDING * len(even)))
    first = int(MIN_CYCLES * PADDING)  # a slower sine has too few cycles here
    peak = first + int(np.argmax(spectrum[first:]))
    width = 1.0 / (PADDING * len(even) * step)

    def amplitude_and_rest(frequency: float) -> tuple[float, float]:
        angle = 2.0 * np.pi * frequency * grid
        basis = np.stack([np.ones_like(grid), np.cos(angle), np.sin(angle)], axis=1)
        terms = np.linalg.lstsq(basis, even, rcond=None)[0]
        return float(np.hypot(*terms[1:])), float(np.mean(np.square(even - basis @ terms)))

    frequency = peak * width
    while width > 1e-7 * frequency:  # towards the least rest, between the two neighbours
        near = frequency + width * np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
        frequency = float(near[np.argmin([amplitude_and_rest(f)[1] for f in near])])
        width *= 0.5
    amplitude, rest = amplitude_and_rest(frequency)
    if not frequency * t[-1] >= MIN_CYCLES or rest > (1.0 - MIN_SHARE) * float(np.var(even)):
        return None
    return frequency, amplitude, float(time[-1] - time[0])


def _rounded(value: float, share: float) -> float:
    """The number with the fewest digits that differs from a value by less than a share of it."""
    for digits in range(1, 9):
        rounded = float(f"{value:.{digits}g}")
        if abs(rounded - value) <= share * abs(value):
            return rounded
    return value
