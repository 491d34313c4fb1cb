"""Read one run of a campaign: the columns of its file become signals in SI units over increasing time stamps."""

import dataclasses
import itertools
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from edhas_jax.config.recorded_signal import Between, RecordingError, recorded_from_samples
from edhas_jax.config.tables.table import Column, Layout, Table, TableError
from edhas_jax.config.tables.table_reader import read_tables
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.remark import Remark, Severity
from edhas_jax.core.units import UnitError, display_unit, format_quantity, is_unit_of, to_si, values_to_si
from edhas_jax.core.wording import counted, listed
from edhas_jax.machine.components.coil_and_amplifier import CurrentAmplifier
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import BenchRun, Spread, Use
from edhas_jax.measurements.checks.repeated_values import true_intervals
from edhas_jax.measurements.record_timing import RecordTiming

MIN_SAMPLES = 10  # of a run; with fewer neither noise nor shape can be judged
MAX_SIZE = 1e30  # of a value in SI; a larger one is a fault of the file, and its square may overflow
MAX_REMARKS = 10  # on one file
MAX_LISTED = 3  # faults of one kind in one column that are reported one by one
MAX_NAMES, MAX_QUOTED = 8, 40  # columns that a remark names, characters of a name
LARGE_JUMP = 0.1  # of the range of a drive; smaller jumps may be the rounding of a slow signal
MAX_UNDRIVEN = 0.01  # share of a run; recorders that are stopped by hand end some samples apart
MIN_UPDATES = 30  # of a signal that a faster recorder repeats; a few steps of a set point are no samples
MIN_REGULAR_UPDATES = 0.98  # share of those that come after a multiple of their usual interval
MAX_MISSED_UPDATES = 0.2  # share of those that come later than usual, as where the signal rests
MAX_EQUAL_CHANGES = 0.5  # share of the changes that have one size, which is then the resolution of the signal
HELD_BY_A_COMPUTER = ("voltage",)  # a controller's output truly stays between its samples
MAX_SPARSE_SHARE, MIN_REGULAR_SHARE = 0.5, 0.9  # of rows with a value, of equal steps between them: a slow signal
INTERVAL_TOLERANCE = 0.01  # between a stated interval and the steps of a time column; clocks of recorders are better
MAX_DISORDER = 0.05  # share of samples out of order above which the time axis is rejected


class ColumnSource(NamedTuple):
    """The name of a quantity's column in the files, its unit where the header gives none, and for a drive `between`.

    `between` is None where the campaign does not state it.
    """

    column: str
    unit: str
    between: Between | None = None


Columns = Mapping[str, ColumnSource]  # by signal or drive


class TimeSource(NamedTuple):
    """Where the time stamps of a file come from: a column, or a stated interval [s] from sample to sample.

    `start` is the time stamp [s] at which the run begins; None for the first one.
    """

    column: str = "time"
    unit: str = ""
    interval: float | None = None
    start: float | None = None


class RecordFile(NamedTuple):
    """A file of a run.

    Args:
        path: where it is.
        time: where its time stamps come from.
        layout: what the campaign states about the file.
    """

    path: Path
    time: TimeSource = TimeSource()
    layout: Layout = Layout()


class RunEntry(NamedTuple):
    """An entry under `runs`.

    Args:
        name: unique name of the run.
        files: files of any format that `read_tables` reads.
        use: fit or holdout.
        conditions: parameters of the machine in this run (SI).
        timing: which part of the record is used; where its time is zero its files say.
        uncertain: the parameters whose value in this run is an unknown of its own.
        columns: the columns of signals and drives that have another name in this run.
        keep: the signals of which the checks leave out no sample.
    """

    name: str
    files: tuple[RecordFile, ...]
    use: Use
    conditions: dict[str, float]
    timing: RecordTiming = RecordTiming()
    uncertain: Mapping[str, Spread] = MappingProxyType({})
    columns: Columns = MappingProxyType({})
    keep: frozenset[str] = frozenset()

    @property
    def file(self) -> Path:
        """The first file."""
        return self.files[0].path


@dataclasses.dataclass
class _Record:
    """A table of a run with its own time axis.

    Args:
        file: the file that holds it.
        table: its columns.
        sources: the columns of its signals, by signal.
        drives: the columns of its drives, by drive.
        order: rows (samples,) of the table whose time stamps increase, the last one where several have the same.
        before: the first ones (samples,) of these.
        time: their time stamps (samples,) [s], counted from the start of the run once that is known.
        used: which of them are used (samples,).
    """

    file: RecordFile
    table: Table
    sources: dict[str, ColumnSource]
    drives: dict[str, ColumnSource]
    order: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0, int))
    before: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0, int))
    time: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))
    used: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0, bool))

    def own_name(self, name: str) -> str | None:
        """The name of the column that `name`, `group/name` or `file/name` means; None if it is not here."""
        own = self.table.own_name(name)
        return self.table.own_name(name.removeprefix(f"{self.file.path.stem}/")) if own is None else own

    @property
    def is_needed(self) -> bool:
        """Whether anything of it is read."""
        return bool(self.sources or self.drives)


class RunReader:
    """Reads the files of the runs of a campaign; `remarks` lists what it left out, and why.

    Args:
        machine: the machine of the campaign.
        sources: the columns of the measured signals, by signal.
        recorded: the columns of the recorded drives, by drive; that of the set point is `reference`.
        planned: whether the runs are planned: their files need not hold any measured signal.
    """

    def __init__(self, machine: Rig, sources: Columns, recorded: Columns, planned: bool = False):
        self.remarks: list[Remark] = []
        self._machine, self._sources, self._recorded, self._planned = machine, sources, recorded, planned
        self._file, self._header_line, self._time = Path(), 0, TimeSource()

    def read(self, entry: RunEntry) -> list[BenchRun]:
        """Read the files of one run.

        Returns:
            The run, or its parts: one for each time axis, the first with the name of the run. Empty if no signal of it
            can be used.
        """
        earlier = len(self.remarks)
        runs = self._read(entry)
        found = self.remarks[earlier:]
        if len(found) > MAX_REMARKS:
            what = "file" if len(entry.files) == 1 else "run"
            sentence = f"and {len(found) - MAX_REMARKS + 1} more remarks on this {what}"
            more = Remark(found[-1].severity, entry.file, 0, sentence)
            self.remarks[earlier:] = [*found[: MAX_REMARKS - 1], more]
        return runs

    def _read(self, entry: RunEntry) -> list[BenchRun]:
        self._file, self._header_line = entry.file, 0
        try:
            records = self._tables(entry)
            self._find_columns(entry, records)
            needed = [record for record in records if record.is_needed] or records[:1]
            for record in (r for r in records if not any(r is of for of in needed)):
                self._at(record)
                self._remark_unused(record, {self._time.column})
            self._find_times(entry, needed, records)
            drives = {n: self._drive(n, record) for record in needed for n in record.drives}
            parts = [(record, *part) for record in needed for part in self._signals_by_rate(record)]
            ends = [record.time[rows[-1]] for record, signals, rows in parts if signals and len(rows)]
            if ends:
                self._compare_drives([record for record in needed if record.drives], entry.timing.run_in, max(ends))
        except TableError as error:
            self._remark(error.line, f"{error}; the run is left out")
            return []
        reference = None if "reference" in self._machine.drives else drives.pop("reference", None)
        runs, too_short = [], False
        for record, signals, rows in parts:
            self._at(record)
            time, lines = record.time[rows], record.table.lines[record.order[rows]]
            signals = self._without_missing_values(signals, lines)
            if not signals and not (self._planned and not runs):
                continue
            if len(time) < MIN_SAMPLES:
                too_short = True
                what = "the run is left out" if len(parts) == 1 else f"{', '.join(signals)} left out"
                self._remark(0, f"at least {MIN_SAMPLES} samples are needed; there are {len(time)}; {what}")
                continue
            runs.append(BenchRun(
                entry.name, record.file.path, entry.use, entry.conditions, time, signals, lines, reference, drives,
                entry.uncertain, keep=entry.keep,
            ))  # fmt: skip
        if not runs and not too_short:
            self._remark(0, "none of its columns can be used; the run is left out")
        # the parts after the first say in their names what they measure
        parts = (dataclasses.replace(r, name=f"{r.name}, {', '.join(r.signals)}", part_of=r.name) for r in runs[1:])
        return [*runs[:1], *parts]

    def _tables(self, entry: RunEntry) -> list[_Record]:
        """The tables of the files of a run.

        Raises:
            TableError: a file cannot be read.
        """
        records = []
        for file in entry.files:
            self._file, self._header_line = file.path, 0
            tables = read_tables(file.path, self.remarks.append, file.layout)
            records += [_Record(file, table, {}, {}) for table in tables]
        self._at(records[0])
        return records

    def _at(self, record: _Record) -> None:
        """Let remarks refer to a record."""
        self._file, self._header_line, self._time = record.file.path, record.table.header_line, record.file.time

    def _find_columns(self, entry: RunEntry, records: Sequence[_Record]) -> None:
        """Find the record of every signal and drive.

        Raises:
            TableError: that of a drive is missing, or several records have it.
        """
        for known, are_drives in ((self._recorded, True), (self._sources, False)):
            for name, source in (known | {n: s for n, s in entry.columns.items() if n in known}).items():
                holders = [(record, own) for record in records if (own := record.own_name(source.column)) is not None]
                problem = self._several(name, source, holders) if len(holders) > 1 else ""
                if problem and are_drives:
                    raise TableError(0, problem)
                if are_drives or len(holders) == 1:
                    record, own = holders[0] if holders else (records[0], source.column)
                    (record.drives if are_drives else record.sources)[name] = source._replace(column=own)
                elif holders or not self._planned:
                    others = [n for record in records for n in record.table.columns if n != record.file.time.column]
                    problem = problem or f"no column `{source.column}` ({suggest(source.column, others)})"
                    self._remark(self._header_line, f"{problem}; {name} is missing in this run")

    @staticmethod
    def _several(name: str, source: ColumnSource, holders: Sequence[tuple[_Record, str]]) -> str:
        names = [f"{record.table.name or record.file.path.stem}/{own}" for record, own in holders]
        return f"several columns `{source.column}`; write `{name}: {{column: {names[0]}}}`, or {', '.join(names[1:])}"

    def _find_times(self, entry: RunEntry, needed: list[_Record], records: Sequence[_Record]) -> None:
        """The time axis of every needed record, counted from the start of the run; those without one are left out.

        Records whose time stamps overlap, and those of one file, have the same clock: time is counted from the first
        stamp of any of them.

        Raises:
            TableError: no record has time stamps, or samples at the stated times.
        """
        problems = []
        for record in needed:
            self._at(record)
            try:
                stamps = self._time_stamps(self._with_time(record, records), record.drives.values())
                record.order, record.before, record.time = stamps
            except TableError as error:
                problems.append((record, error))
        dated, zeros = [record for record in needed if not any(record is of for of, _ in problems)], []
        for record in dated:
            time, others = record.time, [other for other in needed if len(other.time) and len(record.time)]
            alike = [
                other.time for other in others
                if other.file is record.file or other.time[0] <= time[-1] and time[0] <= other.time[-1]
            ]  # fmt: skip
            earliest = min(alike, key=lambda of: of[0], default=time)
            zeros.append(None if earliest is time else self._timing(entry, record).zero(earliest))
        for record, zero in zip(dated, zeros, strict=True):
            self._at(record)
            try:
                part, record.time, record.used, remarks = self._timing(entry, record).apply(
                    record.file.path, record.time, zero
                )
            except TableError as error:
                problems.append((record, error))
                continue
            record.order, record.before = record.order[part], record.before[part]
            self.remarks += remarks
        if len(problems) == len(needed) or any(record.drives for record, _ in problems):
            self._at(problems[0][0])
            raise problems[0][1]
        for record, error in problems:
            needed.remove(record)
            self._at(record)
            self._remark(error.line, f"{error}; {', '.join(record.sources)} left out of this run")

    @staticmethod
    def _timing(entry: RunEntry, record: _Record) -> RecordTiming:
        return dataclasses.replace(entry.timing, start=record.file.time.start)

    def _with_time(self, record: _Record, records: Sequence[_Record]) -> Table:
        """The table of a record, with the time stamps of another table of its file where it has none of its own."""
        table, name = record.table, self._time.column
        if (own := table.own_name(name)) is not None:
            self._time = self._time._replace(column=own)
            return table
        for other in (r.table for r in records if r.file is record.file and len(r.table.lines) == len(table.lines)):
            if (own := other.own_name(name)) is not None:
                return dataclasses.replace(table, columns=table.columns | {name: other.columns[own]})
        return table

    def _signals_by_rate(self, record: _Record) -> list[tuple[dict[str, np.ndarray], np.ndarray]]:
        """The signals of a record with the places (samples,) of their samples in its time axis.

        A signal with a value in every tenth row, for example, has a time axis of its own.

        Raises:
            TableError: a column cannot be read.
        """
        self._at(record)
        signals, known = {}, {self._time.column}
        for name, source in record.sources.items():
            column, known = record.table.columns[source.column], known | {source.column}
            other_units = [c.unit for n, c in record.table.columns.items() if n != self._time.column]
            if not column.unit and source.column == name and any(other_units):
                sentence = f"column `{source.column}` has no unit; {source.unit} is assumed, as stated in the campaign"
                self._remark(self._header_line, sentence, Severity.WARNING)
            try:
                signals[name] = self._in_si(source, column, self._machine.signals[name].unit)[record.order]
            except UnitError as error:
                sentence = f"column `{source.column}`: {error}; {name} is left out of this run"
                self._remark(self._header_line, sentence)
        self._remark_unused(record, known | {source.column for source in record.drives.values()})
        used = np.flatnonzero(record.used)
        signals = {name: values[used] for name, values in signals.items()}
        drives = [record.table.columns[source.column].values[record.order][used] for source in record.drives.values()]
        recorded = np.isfinite([*signals.values(), *drives]).reshape(-1, len(used))
        filled = int(recorded.any(axis=0).sum())
        slow = {name: rows for name, values in signals.items() if (rows := _sparse_rows(values, filled)) is not None}
        held = {
            name: rows for name, values in signals.items()
            if name not in slow and name not in HELD_BY_A_COMPUTER and (rows := _updated_rows(values)) is not None
        }  # fmt: skip
        slow |= held
        rates: dict[bytes, list[str]] = {}
        for name, rows in slow.items():
            rates.setdefault(rows.tobytes(), []).append(name)
        fast = {name: values for name, values in signals.items() if name not in slow}
        # rows in which only the slow signals were recorded are no samples of the others
        rows = np.isfinite(list(fast.values())).any(axis=0) if slow and fast else np.ones(len(used), bool)
        found = [({name: values[rows] for name, values in fast.items()}, used[rows])] if fast or not slow else []
        for names in rates.values():
            rows = slow[names[0]]
            every = round(len(used) / len(rows))
            found_where = "a value in every {}th row; the rows between are no samples"
            if names[0] in held:
                found_where = "a new value only every {} rows; those between repeat the last one and are no samples"
            self._remark(0, f"{', '.join(names)}: {found_where.format(every)}", Severity.NOTE)
            found.append(({name: signals[name][rows] for name in names}, used[rows]))
        return found

    def _compare_drives(self, records: Iterable[_Record], start: float, end: float) -> None:
        """Say which drives of the records were not recorded from the start of a run to its last sample [s]."""
        for record in records:
            self._at(record)
            for name, source in record.drives.items():
                column = record.table.columns.get(source.column)
                times = record.time if column is None else record.time[np.isfinite(column.values[record.order])]
                if len(times) < MIN_SAMPLES:
                    continue
                slack = MAX_UNDRIVEN * (end - start) + 2.0 * float(np.median(np.diff(times)))
                missing = [f"before {format_quantity(times[0], 's')}"] if times[0] > start + slack else []
                # a computer may write its set point only when it changes
                if times[-1] < end - slack and source.between is not Between.HOLD:
                    missing.append(f"after {format_quantity(times[-1], 's')}")
                if missing:
                    what = f"{name.replace('_', ' ')} `{source.column}` was not recorded {' and '.join(missing)}"
                    span = f"the run lasts from {format_quantity(start, 's')} to {format_quantity(end, 's')}"
                    remedy = "the model takes it as constant there; `window` limits the run"
                    self._remark(0, f"{what}, {span}; {remedy}", Severity.WARNING)

    def _remark_unused(self, record: _Record, known: Collection[str]) -> None:
        unused = [f"`{column[:MAX_QUOTED]}`" for column in record.table.columns if column not in known]
        if unused:
            names, is_one = listed(unused, MAX_NAMES), len(unused) == 1
            subject, verb = (f"column {names} is", "it is") if is_one else (f"columns {names} are", "they are")
            sentence = f"{subject} not named in the campaign; {verb} not used"
            self._remark(self._header_line, sentence, Severity.NOTE)

    def _without_missing_values(self, signals: dict[str, np.ndarray], lines: np.ndarray) -> dict[str, np.ndarray]:
        """The signals that have values, with NaN for impossible ones; missing samples are reported."""
        usable: dict[str, np.ndarray] = {}
        holes: dict[tuple[int, str], list[str]] = {}  # signals by line and text of a remark
        for signal, values in signals.items():
            excessive = np.flatnonzero(np.abs(values) > MAX_SIZE)
            if len(excessive):
                count, unit = counted(len(excessive), "value"), self._machine.signals[signal].unit
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
                count = counted(last - first + 1, "missing sample")
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
        with np.errstate(over="ignore"):
            values = values_to_si(column.values, stated, unit, f"1 {display_unit(unit)}")
        if column.unit and source.unit and to_si(f"1 {column.unit}", unit) != to_si(f"1 {source.unit}", unit):
            units = f"column `{source.column}` is in {column.unit}, the campaign states {source.unit}"
            self._remark(self._header_line, f"{units}; the unit in the header is used", Severity.WARNING)
        return values

    def _time_stamps(
        self, table: Table, drives: Iterable[ColumnSource]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The samples whose time stamp is later than all before it.

        Where the recorded drives in the table step, which is several rows at one time, the last row is the sample.

        Returns:
            For each sample the index of its row, that of the first row at its time, and its time stamp [s].
        """
        column = table.columns.get(self._time.column)
        if self._time.interval is not None:
            self._compare_interval(column)
            rows = np.arange(len(table.lines))
            return rows, rows, self._time.interval * rows
        if column is None:
            names = ", ".join(column[:MAX_QUOTED] for column in table.columns)
            remedy = "name it in the campaign, such as `time: {column: t, unit: ms}`, or state `time: {interval: 1 ms}`"
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
        goes_on = _steps(table, drives, time)
        first = np.maximum.accumulate(np.where(goes_on, 0, np.arange(len(time))))
        increasing = (finite & (time > np.concatenate([[-np.inf], latest[:-1]])))[first]
        kept = np.flatnonzero(increasing & ~np.append(goes_on[1:], False))
        if goes_on.any():
            k, places = int(np.argmax(goes_on)), counted(int(np.sum(first[kept] < kept)), "place")
            sentence = f"the drives step in {places}, with rows at one time; measured signals count as in the last row"
            self._remark(int(table.lines[k]), sentence, Severity.NOTE)
        dropped = np.flatnonzero(~increasing)
        if len(dropped) > MAX_DISORDER * len(time):
            sentence = f"time does not increase in {len(dropped)} of {len(time)} samples"
            raise TableError(int(table.lines[dropped[0]]), sentence)
        intervals = true_intervals(~increasing)
        if len(intervals) > MAX_LISTED:
            count, until = f"{len(dropped)} samples in {len(intervals)} places", table.lines[dropped[-1]]
            sentence = f"time does not increase, or is missing, in {count} up to line {until}; they are left out"
            self._remark(int(table.lines[dropped[0]]), sentence)
            intervals = []
        for k, last in intervals:
            problem = f"time {time[k]:.6g} s does not come after {latest[k]:.6g} s" if finite[k] else "no time"
            left_out = "the sample is left out" if k == last else f"left out up to line {table.lines[last]}"
            self._remark(int(table.lines[k]), f"{problem}; {left_out}")
        return kept, first[kept], time[kept]

    def _compare_interval(self, column: Column | None) -> None:
        """Say where the time column of a file contradicts the interval that the campaign states."""
        if column is None or not column.unit or not is_unit_of(column.unit, "s") or column.fault is not None:
            return
        interval, stated = float(np.median(np.diff(values_to_si(column.values, column.unit, "s")))), self._time.interval
        if abs(interval - stated) > INTERVAL_TOLERANCE * stated:
            found, used = format_quantity(interval, "s"), format_quantity(stated, "s")
            sentence = f"column `{self._time.column}` has a step of {found}, the campaign states {used}; that is used"
            self._remark(self._header_line, sentence, Severity.WARNING)

    def _drive(self, drive: str, record: _Record) -> Recorded:
        """A recorded drive in its SI unit: the set point in metres, or in volts as the command of an open loop.

        Where it is slower than its table the blank rows between its samples do not count.
        """
        self._at(record)
        machine, source, table = self._machine, record.drives[drive], record.table
        si, name = machine.drive_unit(drive), source.column
        what = "set point" if drive == "reference" else drive.replace("_", " ")
        column = table.columns.get(name)
        if column is None:
            sentence = f"no column `{name}` with the {what} ({suggest(name, table.columns)})"
            raise TableError(self._header_line, sentence)
        if not column.unit and not source.unit and si != "-":
            usual = display_unit(si)
            remedy = f"write for example `{name} [{usual}]` there, or `{drive}: {{column: {name}, unit: {usual}}}`"
            raise TableError(self._header_line, f"column `{name}`: a unit is missing; {remedy}")
        # rows of the samples, and the first rows at their times: they differ where a drive steps
        order, before, time = record.order, record.before, record.time
        if (rows := _sparse_rows(column.values[order], len(order))) is not None:
            order, before, time = order[rows], before[rows], time[rows]
        try:
            amplifier, unit = getattr(machine, "amplifier", None), column.unit or source.unit
            if si == "V" and isinstance(amplifier, CurrentAmplifier) and is_unit_of(unit, "A"):
                values = self._in_si(source, column, "A") / float(amplifier.amplifier_gain)
            else:
                values = self._in_si(source, column, si)
            rows = np.union1d(before, order)
            time = time[np.searchsorted(order, rows)]
            is_held = _looks_held(values[order], values[before]) or _updated_rows(values[order]) is not None
            if source.between is None and is_held:
                sentence = f"{what} `{name}` stays and jumps; if a computer held it from sample to sample, write "
                sentence += "`between: hold` in the campaign, else `between: line`, which is assumed"
                self._remark(self._header_line, sentence, Severity.WARNING)
            return recorded_from_samples(self._file, time, values[rows], source.between or Between.LINE)
        except UnitError as error:
            raise TableError(self._header_line, f"column `{name}`: {error}") from None
        except RecordingError as error:
            raise TableError(0, f"{what} `{name}`: {str(error).removeprefix(f'{self._file}: ')}") from None


def _steps(table: Table, drives: Iterable[ColumnSource], time: np.ndarray) -> np.ndarray:
    """Whether each row has the time of the row before it, but another value of a recorded drive."""
    found = np.zeros(len(time), bool)
    for source in drives:
        if source.column in table.columns:
            change = np.abs(np.diff(table.columns[source.column].values))
            found[1:] |= (np.diff(time) == 0.0) & (change > 0.0) & np.isfinite(change)
    return found


def _looks_held(after: np.ndarray, before: np.ndarray) -> bool:
    """Whether a drive is constant but for single changes from one sample to the next, of which some are large."""
    change = before[1:] - after[:-1]
    neighbours = (change[1:] != 0.0) & (change[:-1] != 0.0)
    return bool(np.abs(change).max(initial=0.0) > LARGE_JUMP * np.ptp(after) and not neighbours.any())


def _sparse_rows(values: np.ndarray, filled: int) -> np.ndarray | None:
    """The rows (k,) that hold a value, where they are regular and few of those in which anything was recorded."""
    rows = np.flatnonzero(np.isfinite(values))
    if not MIN_SAMPLES <= len(rows) <= MAX_SPARSE_SHARE * filled:
        return None
    steps = np.diff(rows)
    is_regular = np.mean(np.abs(steps - np.median(steps)) <= 1) > MIN_REGULAR_SHARE
    return rows if is_regular else None


def _updated_rows(values: np.ndarray) -> np.ndarray | None:
    """The rows (k,) with a new sample of a signal that a faster recorder repeats in the rows between.

    A signal that rests for some samples has rows at its usual steps meanwhile.
    """
    filled = np.flatnonzero(np.isfinite(values))
    changes = np.diff(values[filled])
    rows = np.flatnonzero(changes != 0.0) + 1
    steps = np.diff(rows)
    if len(rows) < MIN_UPDATES or not (every := float(np.median(steps))) >= 2.0:
        return None
    counts, slack = np.maximum(np.round(steps / every), 1.0), float(every > 2.0)
    sizes = np.unique(np.abs(changes[rows - 1]), return_counts=True)[1]
    is_regular = np.mean(np.abs(steps - counts * every) <= slack) > MIN_REGULAR_UPDATES
    # a signal of coarse resolution that rises evenly changes by its last digit each time
    if not is_regular or np.mean(counts > 1.0) > MAX_MISSED_UPDATES or sizes.max() > MAX_EQUAL_CHANGES * len(rows):
        return None
    edges = [rows[0] % every, *rows, max(len(filled), rows[-1] + every)]
    found = [first + np.arange(0.0, last - first - 0.5 * every, every) for first, last in itertools.pairwise(edges)]
    return filled[np.round(np.concatenate(found)).astype(int)]
