"""Guess what the columns of a logger's table are: the time, a signal of the model, the set point, or nothing of use.

A guess is a proposal: the engineer confirms or changes it before a campaign is written.
"""

import enum
import re
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from edhas_jax.core.units import is_unit_of, to_si
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.measurements.tables.table import Column, Table

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
# a clock without a unit: the unit in which two samples are between these times apart [s]
CLOCK_UNITS = (("s", 2e-5, 0.05), ("ms", 2e-5, 0.05), ("µs", 2e-5, 0.05))
MIN_INCREASING = 0.95  # share of the time stamps that are later than the one before


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
    for unit, shortest, longest in CLOCK_UNITS:
        if shortest <= to_si(f"{step!r} {unit}", "s") <= longest:
            return unit
    return "s"


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
