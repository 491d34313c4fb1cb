"""Read one run of a campaign: the columns of its file become signals in SI units over increasing time stamps."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from edhas_jax.config.recorded_signal import Between, RecordingError, recorded_from_samples
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.units import UnitError, display_unit, to_si
from edhas_jax.machine.components.coil_and_amplifier import CurrentAmplifier
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import BenchRun, Remark, Severity, Use
from edhas_jax.measurements.checks.signal_checks import true_intervals
from edhas_jax.measurements.record_timing import RecordTiming, TimingError
from edhas_jax.measurements.tables.table import Column, Layout, Table, TableError
from edhas_jax.measurements.tables.table_reader import read_table

MIN_SAMPLES = 10  # of a run; with fewer neither noise nor shape can be judged
MAX_SIZE = 1e30  # of a value in SI; a larger one is a fault of the file, and its square may overflow
MAX_REMARKS = 10  # on one file
MAX_LISTED = 3  # faults of one kind in one column that are reported one by one
MAX_NAMES, MAX_QUOTED = 8, 40  # columns that a remark names, characters of a name
LARGE_JUMP = 0.1  # of the range of a drive; smaller jumps may be the rounding of a slow signal
MAX_DISORDER = 0.05  # share of samples out of order above which the time axis is rejected


class ColumnSource(NamedTuple):
    """The name of a quantity's column in the files, its unit where the header gives none, and for a drive `between`.

    `between` is None where the campaign does not state it.
    """

    column: str
    unit: str
    between: Between | None = None


class RunReader:
    """Reads the files of the runs of a campaign; `remarks` lists what it left out, and why.

    Args:
        machine: the machine of the campaign.
        time: the column of the time stamps.
        sources: the columns of the measured signals, by signal.
        recorded: the columns of the recorded drives, by drive; that of the set point is `reference`.
        planned: whether the runs are planned: their files need not hold any measured signal.
    """

    def __init__(
        self, machine: Rig, time: ColumnSource, sources: Mapping[str, ColumnSource],
        recorded: Mapping[str, ColumnSource], planned: bool = False,
    ):  # fmt: skip
        self.remarks: list[Remark] = []
        self._planned = planned
        self._machine, self._time, self._sources, self._recorded = machine, time, sources, recorded

    def read(
        self, name: str, file: Path, use: Use, conditions: dict[str, float], timing: RecordTiming = RecordTiming(),
        layout: Layout = Layout(),
    ) -> BenchRun | None:
        """Read the file of one run.

        Args:
            name: name of the run.
            file: a file of any format that `read_table` reads.
            use: fit or holdout.
            conditions: parameters of the machine in this run (SI).
            timing: where the time of the run is zero, and which part of the record is used.
            layout: what the campaign states about the file.

        Returns:
            The run; None if no signal of it can be used.
        """
        earlier = len(self.remarks)
        run = self._read(name, file, use, conditions, timing, layout)
        found = self.remarks[earlier:]
        if len(found) > MAX_REMARKS:
            more = Remark(found[-1].severity, file, 0, f"and {len(found) - MAX_REMARKS + 1} more remarks on this file")
            self.remarks[earlier:] = [*found[: MAX_REMARKS - 1], more]
        return run

    def _read(
        self, name: str, file: Path, use: Use, conditions: dict[str, float], timing: RecordTiming,
        layout: Layout,
    ) -> BenchRun | None:
        self._file, self._header_line = file, 0
        try:
            table = read_table(file, self.remarks.append, layout)
            self._header_line = table.header_line
            order, before, time = self._time_stamps(table)
            part, time, used, remarks = timing.apply(file, time)
            self.remarks += remarks
            order, before = order[part], before[part]
            drives = {name: self._recorded_drive(name, table, order, before, time) for name in self._recorded}
        except TableError as error:
            self._remark(error.line, f"{error}; the run is left out")
            return None
        except TimingError as error:
            self._remark(0, f"{error}; the run is left out")
            return None
        order, time = order[used], time[used]
        signals = {}
        for signal, source in self._sources.items():
            column = table.columns.get(source.column)
            if column is None and self._planned:
                continue
            if column is None:
                others = [other for other in table.columns if other != self._time.column]
                problem = f"no column `{source.column}` ({suggest(source.column, others)})"
                self._remark(self._header_line, f"{problem}; {signal} is missing in this run")
                continue
            other_units = [c.unit for n, c in table.columns.items() if n != self._time.column]
            if not column.unit and source.column == signal and any(other_units):
                sentence = f"column `{source.column}` has no unit; {source.unit} is assumed, as stated in the campaign"
                self._remark(self._header_line, sentence, Severity.WARNING)
            try:
                signals[signal] = self._in_si(source, column, self._machine.signals[signal].unit)[order]
            except UnitError as error:
                sentence = f"column `{source.column}`: {error}; {signal} is left out of this run"
                self._remark(self._header_line, sentence)
            except TableError as error:
                self._remark(error.line, f"{error}; the run is left out")
                return None
        drives_read = (source.column for source in self._recorded.values())
        known = {self._time.column, *drives_read, *(source.column for source in self._sources.values())}
        unused = [f"`{column[:MAX_QUOTED]}`" for column in table.columns if column not in known]
        if unused:
            more = f" and {len(unused) - MAX_NAMES} more" if len(unused) > MAX_NAMES else ""
            names, is_one = ", ".join(unused[:MAX_NAMES]) + more, len(unused) == 1
            subject, verb = (f"column {names} is", "it is") if is_one else (f"columns {names} are", "they are")
            sentence = f"{subject} not named in the campaign; {verb} not used"
            self._remark(self._header_line, sentence, Severity.NOTE)
        signals = self._without_missing_values(signals, table.lines[order])
        if not signals and not self._planned:
            self._remark(0, "none of its columns can be used; the run is left out")
            return None
        if len(time) < MIN_SAMPLES:
            self._remark(0, f"at least {MIN_SAMPLES} samples are needed; there are {len(time)}; the run is left out")
            return None
        reference = drives.pop("reference", None) if not self._machine.is_own else None
        return BenchRun(name, file, use, conditions, time, signals, table.lines[order], reference, drives)

    def _without_missing_values(self, signals: dict[str, np.ndarray], lines: np.ndarray) -> dict[str, np.ndarray]:
        """The signals that have values, with NaN for impossible ones; missing samples are reported."""
        usable: dict[str, np.ndarray] = {}
        holes: dict[tuple[int, str], list[str]] = {}  # signals by line and text of a remark
        for signal, values in signals.items():
            excessive = np.flatnonzero(np.abs(values) > MAX_SIZE)
            if len(excessive):
                count = "1 value" if len(excessive) == 1 else f"{len(excessive)} values"
                unit = self._machine.signals[signal].unit
                sentence = f"{signal}: {count} beyond {MAX_SIZE:.0e} {unit}; taken as missing"
                self._remark(int(lines[excessive[0]]), sentence)
            values = np.where(np.abs(values) <= MAX_SIZE, values, np.nan)
            if not np.isfinite(values).any():
                self._remark(0, f"{signal}: there is not a single value; it is missing in this run")
                continue
            usable[signal] = values
            intervals = true_intervals(~np.isfinite(values))
            if len(intervals) > MAX_LISTED:
                count, until = int(np.isnan(values).sum()), lines[intervals[-1][1]]
                sentence = f"{count} missing samples in {len(intervals)} places up to line {until}; left out"
                holes.setdefault((int(lines[intervals[0][0]]), sentence), []).append(signal)
                continue
            for first, last in intervals:
                count = "1 missing sample" if first == last else f"{last - first + 1} missing samples"
                until = "" if first == last else f" up to line {lines[last]}"
                holes.setdefault((int(lines[first]), f"{count}{until}; left out"), []).append(signal)
        for (line, sentence), names in holes.items():
            self._remark(line, f"{', '.join(names)}: {sentence}")
        return usable

    def _remark(self, line: int, sentence: str, severity: Severity = Severity.ERROR) -> None:
        self.remarks.append(Remark(severity, self._file, line, sentence))

    def _in_si(self, source: ColumnSource, column: Column, unit: str) -> np.ndarray:
        """The values of a column in SI; the unit in the header takes precedence over that in the campaign.

        Raises:
            TableError: the column cannot be read.
            UnitError: its unit is unknown, or that of another quantity.
        """
        if column.fault is not None:
            raise column.fault
        stated = column.unit or source.unit
        zero = to_si(f"0 {stated}", unit, f"1 {display_unit(unit)}")
        if column.unit and source.unit and to_si(f"1 {column.unit}", unit) != to_si(f"1 {source.unit}", unit):
            units = f"column `{source.column}` is in {column.unit}, the campaign states {source.unit}"
            self._remark(self._header_line, f"{units}; the unit in the header is used", Severity.WARNING)
        size = to_si(f"1 {stated}", unit) - zero
        with np.errstate(over="ignore"):
            return zero + size * column.values

    def _time_stamps(self, table: Table) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The samples whose time stamp is later than all before it.

        Where recorded drives step, which is several rows at one time, the last row is the sample.

        Returns:
            For each sample the index of its row, that of the first row at its time, and its time stamp [s].
        """
        column = table.columns.get(self._time.column)
        if column is None:
            names = ", ".join(column[:MAX_QUOTED] for column in table.columns)
            remedy = "name it in the campaign, such as `time: {column: t, unit: ms}`"
            sentence = f"no column `{self._time.column}` with the time; {remedy}; the columns: {names}"
            raise TableError(self._header_line, sentence)
        if not column.unit and not self._time.unit:
            sentence = f"column `{self._time.column}`: a unit is missing; write for example `time [ms]`"
            raise TableError(self._header_line, sentence)
        try:
            time = self._in_si(self._time, column, "s")
        except UnitError as error:
            raise TableError(self._header_line, f"column `{self._time.column}`: {error}") from None
        finite = np.abs(time) <= MAX_SIZE
        latest = np.maximum.accumulate(np.where(finite, time, -np.inf))
        goes_on = self._steps(table, time)
        first = np.maximum.accumulate(np.where(goes_on, 0, np.arange(len(time))))
        increasing = (finite & (time > np.concatenate([[-np.inf], latest[:-1]])))[first]
        kept = np.flatnonzero(increasing & ~np.append(goes_on[1:], False))
        if goes_on.any():
            k, count = int(np.argmax(goes_on)), int(np.sum(first[kept] < kept))
            places = "1 place" if count == 1 else f"{count} places"
            sentence = f"the drives step in {places}, with rows at one time; measured signals count as in the last row"
            self._remark(int(table.lines[k]), sentence, Severity.NOTE)
        dropped = np.flatnonzero(~increasing)
        if len(dropped) > MAX_DISORDER * len(time):
            sentence = f"time does not increase in {len(dropped)} of {len(time)} samples"
            raise TableError(int(table.lines[dropped[0]]), sentence)
        intervals = np.split(dropped, np.flatnonzero(np.diff(dropped) > 1) + 1) if len(dropped) else []
        if len(intervals) > MAX_LISTED:
            count, until = f"{len(dropped)} samples in {len(intervals)} places", table.lines[dropped[-1]]
            sentence = f"time does not increase, or is missing, in {count} up to line {until}; they are left out"
            self._remark(int(table.lines[dropped[0]]), sentence)
            intervals = []
        for rows in intervals:
            k, until = rows[0], table.lines[rows[-1]]
            problem = f"time {time[k]:.6g} s does not come after {latest[k]:.6g} s" if finite[k] else "no time"
            left_out = "the sample is left out" if len(rows) == 1 else f"left out up to line {until}"
            self._remark(int(table.lines[k]), f"{problem}; {left_out}")
        return kept, first[kept], time[kept]

    def _steps(self, table: Table, time: np.ndarray) -> np.ndarray:
        """Whether each row has the time of the row before it, but another value of a recorded drive."""
        found = np.zeros(len(time), bool)
        for source in self._recorded.values():
            if source.column in table.columns:
                change = np.abs(np.diff(table.columns[source.column].values))
                found[1:] |= (np.diff(time) == 0.0) & (change > 0.0) & np.isfinite(change)
        return found

    def _recorded_drive(
        self, drive: str, table: Table, order: np.ndarray, before: np.ndarray, time: np.ndarray
    ) -> Recorded:
        """A recorded drive in its SI unit: the set point in metres, or in volts as the command of an open loop.

        The rows `order` and `before` of the samples differ where a drive steps, see `_time_stamps`.
        """
        source, machine = self._recorded[drive], self._machine
        what = "set point" if drive == "reference" else drive.replace("_", " ")
        name = source.column
        if name not in table.columns:
            sentence = f"no column `{name}` with the {what} ({suggest(name, table.columns)})"
            raise TableError(self._header_line, sentence)
        column = table.columns[name]
        if not column.unit and not source.unit and machine.drive_unit(drive) != "-":
            usual = display_unit(machine.drive_unit(drive))
            remedy = f"write for example `{name} [{usual}]` there, or `{drive}: {{column: {name}, unit: {usual}}}`"
            sentence = f"column `{name}`: a unit is missing; {remedy}"
            raise TableError(self._header_line, sentence)
        si, unit = machine.drive_unit(drive), column.unit or source.unit
        try:
            amplifier = getattr(machine, "amplifier", None)
            if si == "V" and isinstance(amplifier, CurrentAmplifier) and _is_current(unit):
                values = self._in_si(source, column, "A") / float(machine.amplifier.amplifier_gain)
            else:
                values = self._in_si(source, column, si)
            rows = np.union1d(before, order)
            time = time[np.searchsorted(order, rows)]
            if source.between is None and _looks_held(values[order], values[before]):
                sentence = f"{what} `{name}` stays and jumps; if a computer held it from sample to sample, write "
                sentence += "`between: hold` in the campaign, else `between: line`, which is assumed"
                self._remark(self._header_line, sentence, Severity.WARNING)
            return recorded_from_samples(self._file, time, values[rows], source.between or Between.LINE)
        except UnitError as error:
            raise TableError(self._header_line, f"column `{name}`: {error}") from None
        except RecordingError as error:
            raise TableError(0, f"{what} `{name}`: {str(error).removeprefix(f'{self._file}: ')}") from None


def _looks_held(after: np.ndarray, before: np.ndarray) -> bool:
    """Whether a drive is constant but for single, large changes from one sample to the next."""
    change = before[1:] - after[:-1]
    neighbours = (change[1:] != 0.0) & (change[:-1] != 0.0)
    return bool(np.abs(change).max(initial=0.0) > LARGE_JUMP * np.ptp(after) and not neighbours.any())


def _is_current(unit: str) -> bool:
    try:
        to_si(f"1 {unit}", "A")
    except UnitError:
        return False
    return True
