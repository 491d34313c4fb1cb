"""Guess what a logger's table holds: time, signals of the model and set point, and the sine that drove the bench.

A guess is a proposal: the engineer confirms or changes it before a campaign is written.
"""

import enum
import math
import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.config.tables.table import Column, Table
from edhas_jax.core.units import is_unit_of, to_si, values_to_si
from edhas_jax.machine.interface.signals import SIGNALS

TIME_NAMES = "time", "t", "zeit", "timestamp", "clock", "temps", "tiempo", "sekunden", "seconds"
SET_POINT_NAMES = (
    "reference", "ref", "set_point", "setpoint", "sollwert", "soll", "target", "demand", "qg", "xref", "xsoll",
    "reference_position", "position_reference", "position_setpoint", "target_position", "position_demand",
)  # fmt: skip
# what columns are called, by signal, in the order of preference
SIGNAL_NAMES = {
    "voltage": ("voltage", "u", "ucmd", "uc", "volt", "spannung", "command", "vir", "uout", "tension"),
    "current": ("current", "i", "icoil", "strom", "imot", "imotor", "courant", "amp"),
    "piston_position": ("pistonposition", "position", "x", "pos", "weg", "stroke", "displacement", "xp", "qm", "xist"),
    "piston_velocity": ("pistonvelocity", "velocity", "v", "speed", "geschwindigkeit", "dx", "xdot", "vp"),
    "outlet_pressure": ("outletpressure", "pout", "pressure", "p", "druck", "poutlet", "pl", "pressureout"),
    "outlet_flow": ("outletflow", "flow", "q", "qout", "volumenstrom", "flowrate", "durchfluss", "ql"),
    "chamber_pressure_a": ("chamberpressurea", "pa", "p1", "pchambera"),
    "chamber_pressure_b": ("chamberpressureb", "pb", "p2", "pchamberb"),
    "accumulator_pressure": ("accumulatorpressure", "pacc", "ptank", "psuction"),
    "head_pressure": ("headpressure", "phead", "pcap"),
    "rod_pressure": ("rodpressure", "prod"),
    "cylinder_position": ("cylinderposition", "xcyl", "ycyl", "y", "xc"),
}
USUAL_OF_UNIT = ("voltage", "current", "piston_position", "piston_velocity", "outlet_pressure", "outlet_flow")
CLOCK_UNITS, USUAL_STEPS = ("s", "ms", "µs"), (2e-5, 0.05)  # of a clock that states none; from sample to sample [s]
MIN_INCREASING = 0.95  # share of the time stamps that are later than the one before
# signals that follow the set point, the nearest first; pressures and flows of a pump have twice its frequency
FOLLOWERS = "piston_position", "piston_velocity", "current", "voltage"
MIN_SAMPLES, MIN_CYCLES = 20, 1.5  # of the part that is used
MAX_GRID = 1 << 16  # samples of the part, from which it is thinned: a sine needs few
PADDING = 8  # times its length to which the part is extended, so that the peak of the spectrum is fine
MIN_SHARE = 0.8  # of the variance that the sine explains: friction and a drive that saturates distort what follows it
PHASE_ERROR = 0.002  # cycles over the record by which rounding of the frequency may shift the sine
AMPLITUDE_ROUNDING = 0.02  # by which a position may differ from its set point anyway


class Role(enum.Enum):
    """What a column is."""

    TIME = "time"
    SIGNAL = "signal"
    SET_POINT = "set point"
    UNUSED = "not used"


class GuessedColumn(NamedTuple):
    """A column with what it is taken for.

    Attributes:
        column: its name in the file.
        role: what it is.
        signal: the signal of the model; empty for any other role.
        unit: its unit; that of the file where it states one.
        unit_stated: whether the file states the unit.
    """

    column: str
    role: Role
    signal: str
    unit: str
    unit_stated: bool


def guess_columns(table: Table, available: Iterable[str]) -> list[GuessedColumn]:
    """Guess what every column of a table is.

    Args:
        table: the table of a run.
        available: the signals that the machine has.

    Returns:
        One guess for each column, in their order; at most one column is the time, and one each signal.
    """
    time = _time_column(table)
    wanted = [name for name in available if name in SIGNALS and name not in ("time", "reference")]
    taken: dict[str, str] = {}
    names = [name for name in table.columns if name != time]
    for signal in wanted:
        candidates = [n for n in names if n not in taken and _fits(table.columns[n], SIGNALS[signal].unit)]
        known = SIGNAL_NAMES.get(signal, ()) + (_plain(signal),)
        ranked = [(known.index(_plain(n)), n) for n in candidates if _plain(n) in known]
        if ranked:
            taken[min(ranked)[1]] = signal
    set_point = next((n for n in names if n not in taken and _plain(n) in map(_plain, SET_POINT_NAMES)), None)
    for signal in (name for name in USUAL_OF_UNIT if name in wanted and name not in taken.values()):
        alone = [n for n in names if n not in taken and n != set_point and _states(table.columns[n], signal)]
        if len(alone) == 1:
            taken[alone[0]] = signal
    return [_guess(table, name, time, set_point, taken.get(name, "")) for name in table.columns]


def _guess(table: Table, name: str, time: str | None, set_point: str | None, signal: str) -> GuessedColumn:
    column = table.columns[name]
    stated = bool(column.unit)
    if name == time:
        return GuessedColumn(name, Role.TIME, "", column.unit or clock_unit(column.values), stated)
    if signal:
        return GuessedColumn(name, Role.SIGNAL, signal, column.unit or SIGNALS[signal].display_unit, stated)
    role = Role.SET_POINT if name == set_point and stated else Role.UNUSED
    return GuessedColumn(name, role, "", column.unit, stated)


def clock_unit(values: np.ndarray) -> str:
    """The unit of a clock that states none: the first of s, ms and µs in which samples are a usual time apart.

    Args:
        values: the time stamps (samples,).
    """
    step = float(np.nanmedian(np.diff(values))) if len(values) > 1 else 1.0
    shortest, longest = USUAL_STEPS
    return next((unit for unit in CLOCK_UNITS if shortest <= to_si(f"{step!r} {unit}", "s") <= longest), "s")


def _time_column(table: Table) -> str | None:
    """The column of the time: by its name, else the first one that increases throughout."""
    names = [n for n in table.columns if _plain(n) in TIME_NAMES and _fits(table.columns[n], "s")]
    if names:
        return min(names, key=lambda n: TIME_NAMES.index(_plain(n)))
    for name, column in table.columns.items():
        steps = np.diff(column.values)
        if len(steps) and np.mean(steps > 0.0) >= MIN_INCREASING and (not column.unit or _fits(column, "s")):
            return name
    return None


def _plain(name: str) -> str:
    """A name without what differs between loggers: capitals, separators, words such as "actual" and "meas"."""
    words = [word for word in re.split(r"[^a-z0-9µ]+", name.lower()) if word]
    words = [w for w in words if w not in ("actual", "act", "meas", "measured", "ist", "mes", "sensor", "signal")]
    return "".join(words)


def _states(column: Column, signal: str) -> bool:
    """Whether a column states a unit that fits a signal."""
    return bool(column.unit) and _fits(column, SIGNALS[signal].unit)


def _fits(column: Column, unit: str) -> bool:
    """Whether a column can be a quantity of this unit: it states a unit that can be converted, or none."""
    return not column.unit or is_unit_of(column.unit, unit)


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
