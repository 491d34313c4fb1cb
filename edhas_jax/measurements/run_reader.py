"""One run of a campaign: from the columns of its file to signals in SI over a time that increases."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from edhas_jax.config.recorded_signal import RecordingError, resample_uniformly
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.units import UnitError, display_unit, to_si
from edhas_jax.machine.components.coil_and_amplifier import CurrentAmplifier
from edhas_jax.machine.components.controllers import OpenLoop
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import BenchRun, Remark, Severity, Use
from edhas_jax.measurements.signal_checks import true_intervals
from edhas_jax.measurements.table_reader import Column, Table, TableError, read_table

DISORDER = 0.05  # share of samples out of order above which no time axis can be trusted


class ColumnSource(NamedTuple):
    """Where a quantity stands in the files: the name of its column, and its unit where a header gives none."""

    column: str
    unit: str


class RunReader:
    """Reads the files of a campaign; what it leaves out and why is in `remarks`."""

    def __init__(self, machine: Rig, time: ColumnSource, sources: Mapping[str, ColumnSource], set_point: str | None):
        self.remarks: list[Remark] = []
        self._machine, self._time, self._sources, self._set_point = machine, time, sources, set_point

    def read(self, name: str, file: Path, use: Use, conditions: dict[str, float]) -> BenchRun | None:
        """The run in a file, under a name; None when nothing of it can be used."""
        self._file, self._head = file, 1 if file.suffix == ".csv" else 0
        try:
            table = read_table(file, self.remarks.append)
            order, time = self._clock(table)
            reference = self._recorded(table, order, time) if self._set_point else None
        except TableError as error:
            self._tell(error.line, f"{error}; the run is left out")
            return None
        signals = {}
        for signal, source in self._sources.items():
            column = table.columns.get(source.column)
            if column is None:
                others = [other for other in table.columns if other != self._time.column]
                what = f"no column `{source.column}` ({suggest(source.column, others)})"
                self._tell(self._head, f"{what}; {signal} is missing in this run")
                continue
            others = [c.unit for n, c in table.columns.items() if n != self._time.column]
            if not column.unit and source.column == signal and any(others):
                what = f"column `{source.column}` has no unit; {source.unit} is taken, as the campaign says"
                self._tell(self._head, what, Severity.WARNING)
            try:
                signals[signal] = self._si(source, column, SIGNALS[signal].unit)[order]
            except UnitError as error:
                self._tell(self._head, f"column `{source.column}`: {error}; {signal} is left out of this run")
        known = {self._time.column, self._set_point, *(source.column for source in self._sources.values())}
        for column in table.columns.keys() - known:
            self._tell(self._head, f"column `{column}` is not named in the campaign; it is not used", Severity.NOTE)
        lines = table.lines[order]
        for signal, values in signals.items():
            for first, last in true_intervals(~np.isfinite(values)):
                until = "" if first == last else f" up to line {lines[last]}"
                self._tell(int(lines[first]), f"{signal}: a hole of {last - first + 1} samples{until}; left out")
        if not signals:
            self._tell(0, "none of its columns can be used; the run is left out")
            return None
        return BenchRun(name, file, use, conditions, time, signals, lines, reference)

    def _tell(self, line: int, sentence: str, severity: Severity = Severity.ERROR) -> None:
        self.remarks.append(Remark(severity, self._file, line, sentence))

    def _si(self, source: ColumnSource, column: Column, unit: str) -> np.ndarray:
        """A column in SI; the header's unit counts, and where it gives none the campaign's."""
        given = column.unit or source.unit
        zero = to_si(f"0 {given}", unit, f"1 {display_unit(unit)}")
        if column.unit and source.unit and to_si(f"1 {column.unit}", unit) != to_si(f"1 {source.unit}", unit):
            what = f"column `{source.column}` is in {column.unit}, the campaign says {source.unit}; the header counts"
            self._tell(self._head, what, Severity.WARNING)
        size = to_si(f"1 {given}", unit) - zero
        return zero + size * column.values

    def _clock(self, table: Table) -> tuple[np.ndarray, np.ndarray]:
        """The samples (indices) whose time is later than that of all before them, and their times [s]."""
        column = table.columns.get(self._time.column)
        if column is None:
            named = ", ".join(table.columns)
            raise TableError(self._head, f"no column `{self._time.column}` with the time; the columns: {named}")
        if not column.unit and not self._time.unit:
            what = f"column `{self._time.column}`: a unit is missing; write for example `time [ms]`"
            raise TableError(self._head, what)
        try:
            time = self._si(self._time, column, "s")
        except UnitError as error:
            raise TableError(self._head, f"column `{self._time.column}`: {error}") from None
        known = np.isfinite(time)
        latest = np.maximum.accumulate(np.where(known, time, -np.inf))
        later = known & (time > np.concatenate([[-np.inf], latest[:-1]]))
        out = np.flatnonzero(~later)
        if len(out) > DISORDER * len(time):
            raise TableError(int(table.lines[out[0]]), f"time does not increase in {len(out)} of {len(time)} samples")
        for rows in np.split(out, np.flatnonzero(np.diff(out) > 1) + 1) if len(out) else ():
            k, until = rows[0], table.lines[rows[-1]]
            shown = f"time {time[k]:.6g} s does not come after {latest[k]:.6g} s" if known[k] else "no time"
            left_out = "the sample is left out" if len(rows) == 1 else f"left out up to line {until}"
            self._tell(int(table.lines[k]), f"{shown}; {left_out}")
        return np.flatnonzero(later), time[later]

    def _recorded(self, table: Table, order: np.ndarray, time: np.ndarray) -> Recorded:
        """The recorded set point, in metres, or in volts where it is the command of an open loop."""
        name, machine = self._set_point, self._machine
        if name not in table.columns:
            raise TableError(self._head, f"no column `{name}` with the set point ({suggest(name, table.columns)})")
        column, source = table.columns[name], ColumnSource(name, "")
        if not column.unit:
            raise TableError(self._head, f"column `{name}`: a unit is missing; write for example `{name} [mm]`")
        replay = isinstance(machine.controller, OpenLoop)
        try:
            if replay and isinstance(machine.amplifier, CurrentAmplifier) and _is_current(column.unit):
                values = self._si(source, column, "A") / float(machine.amplifier.amplifier_gain)
            else:
                values = self._si(source, column, "V" if replay else "m")
            return resample_uniformly(self._file, time, values[order])
        except UnitError as error:
            raise TableError(self._head, f"column `{name}`: {error}") from None
        except RecordingError as error:
            raise TableError(0, f"set point `{name}`: {str(error).removeprefix(f'{self._file}: ')}") from None


def _is_current(unit: str) -> bool:
    try:
        to_si(f"1 {unit}", "A")
    except UnitError:
        return False
    return True
