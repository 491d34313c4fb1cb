"""A table of measured numbers: columns with their units, and the line of the file that each sample was read from."""

import dataclasses
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from edhas_jax.measurements.campaign import Severity

TIME = "time"  # the name of the time stamps that a file keeps apart from its channels
# bytes of a file, and of its numbers in memory, where several copies of them must fit
MAX_BYTES = 1_000_000_000
MAX_NAMES = 8  # columns that a message names


class Report(Protocol):
    """Called for what is left out of a table, or worth a note.

    Args:
        line: the line, 0 for the file as a whole.
        sentence: what is there.
        severity: a note where nothing is left out.
    """

    def __call__(self, line: int, sentence: str, severity: Severity = Severity.ERROR) -> None: ...


def report_no_line_end(line: int, report: Report) -> None:
    """Note that the last line of a text, which is used, has no line end: "0.0123" cut to "0.0" passes as a number."""
    sentence = "the last line has no line end; it is used; if the file was cut off, its last value may be wrong"
    report(line, sentence, Severity.NOTE)


class TableError(ValueError):
    """A file cannot be used at all; `line` is the line at fault, 0 for the file as a whole."""

    def __init__(self, line: int, sentence: str):
        super().__init__(sentence)
        self.line = line


@dataclasses.dataclass(frozen=True)
class Column:
    """A column.

    Args:
        unit: the unit stated in the file, "" without one.
        values: the values (samples,) as in the file.
        fault: why the column cannot be used; to be raised where it is needed.
    """

    unit: str
    values: np.ndarray
    fault: TableError | None = None


@dataclasses.dataclass(frozen=True)
class Table:
    """A table: columns over one time axis.

    Args:
        columns: the columns by name.
        lines: line (text) or row (others, from 1) of each sample (samples,).
        header_line: line that names the columns, 0 where the format has none.
        name: the group of channels in the file, "" where it has none.
    """

    columns: dict[str, Column]
    lines: np.ndarray
    header_line: int = 0
    name: str = ""

    def own_name(self, name: str) -> str | None:
        """The name of the column that `name` or `group/name` means; None if this table does not hold it."""
        if name in self.columns:
            return name
        own = name.removeprefix(f"{self.name}/")
        return own if self.name and own in self.columns else None


class Vector(NamedTuple):
    """A channel of a file: its group ("" without one), its name, which may have the unit in brackets, unit, values."""

    group: str
    name: str
    unit: str
    values: np.ndarray


class Layout(NamedTuple):
    """What a campaign states about a file, "" where it does not.

    Attributes:
        decimal: what stands before the decimals in a text: "." or ",".
        sheet: the sheet of an Excel file.
    """

    decimal: str = ""
    sheet: str = ""


def require_size(values: int) -> None:
    """Check that the numbers of a file fit into the memory, before they are read.

    Args:
        values: their count.

    Raises:
        TableError: they do not.
    """
    if 8 * values > MAX_BYTES:
        limit = f"unpacks to more than {MAX_BYTES / 1e9:g} GB, the most that is read"
        raise TableError(0, f"{limit}; export fewer channels or a shorter time")


def flat_vectors(name: str, array: np.ndarray, report: Report) -> list[tuple[str, np.ndarray]]:
    """The columns of an array of numbers, by name: `name`, or `name.1`, `name.2`, … of a matrix.

    Args:
        name: the name of the array.
        array: its values; the samples are along the longest dimension.
        report: called where it holds no numbers, or has more than two dimensions.
    """
    if array.dtype.names:
        return [entry for key in array.dtype.names for entry in flat_vectors(f"{name}.{key}", array[key], report)]
    if array.dtype.kind not in "fiuM":
        return []
    array = array.squeeze()
    if array.ndim < 2:
        values = np.atleast_1d(array)
        return [(name, seconds_since_first(values) if array.dtype.kind == "M" else values.astype(float))]
    if array.ndim > 2:
        report(0, f"`{name}` has {array.ndim} dimensions; it is left out")
        return []
    columns = array if array.shape[0] < array.shape[1] else array.T
    return [(f"{name}.{k}", column.astype(float)) for k, column in enumerate(columns, 1)]


def seconds_since_first(stamps: np.ndarray) -> np.ndarray:
    """Seconds since the first of dates with their times (samples,); NaN where there is none."""
    valid = stamps[~np.isnat(stamps)]
    return (stamps - valid[0]) / np.timedelta64(1, "s") if len(valid) else np.full(len(stamps), np.nan)


def matlab_object(name: str) -> str:
    """What to say of an object of MATLAB."""
    remedy = f"save its numbers, such as `t = {name}.Time; x = {name}.Data; save('run.mat', 't', 'x')`"
    return f"`{name}` is an object of MATLAB (timeseries, table), which only MATLAB reads; {remedy}"


def tables_of_vectors(vectors: Sequence[Vector]) -> list[Table]:
    """The tables of the channels of a file: one for each group and number of samples.

    Raises:
        TableError: two channels of a group have the same name.
    """
    names = {}
    for group in dict.fromkeys(vector.group for vector in vectors):
        own = [vector for vector in vectors if vector.group == group]
        names[group] = iter(names_and_units([vector.name for vector in own], [vector.unit for vector in own]))
    tables: dict[tuple[str, int], Table] = {}
    for vector in vectors:
        (name, unit), count = next(names[vector.group]), len(vector.values)
        table = tables.setdefault((vector.group, count), Table({}, np.arange(1, count + 1), name=vector.group))
        table.columns[name] = Column(unit, vector.values)
    return list(tables.values())


def joined(tables: Sequence[Table], report: Report) -> Table:
    """All tables that have as many samples as most columns, and the same time stamps, as one.

    A name that several of them have is `group/name`, unless the columns are the same.

    Args:
        tables: at least one table.
        report: called for what is left out.
    """
    if len(tables) == 1:
        return tables[0]
    counts = [len(table.lines) for table in tables for _ in table.columns]
    count = max(counts, key=counts.count, default=0)
    alike = [table for table in tables if len(table.lines) == count]
    main = max(alike, key=lambda table: len(table.columns))
    columns: dict[str, Column] = {}
    for table in tables:
        own = [f"`{name}`" for name in table.columns if name != TIME]
        names, (verb, it) = ", ".join(own[:MAX_NAMES]), ("has", "it is") if len(own) == 1 else ("have", "they are")
        if len(table.lines) != count:
            report(0, f"{names} {verb} {len(table.lines)} samples where others have {count}; {it} left out")
            continue
        if not _same(main.columns.get(TIME), table.columns.get(TIME)):
            report(0, f"{names} {verb} other time stamps than most channels; {it} left out")
            continue
        for name, column in table.columns.items():
            others = [other.columns[name] for other in alike if other is not table and name in other.columns]
            own = name if all(_same(column, other) for other in others) else f"{table.name}/{name}"
            columns.setdefault(own, column)
    return Table(columns, main.lines)


def _same(one: Column | None, other: Column | None) -> bool:
    """Whether two columns are equal, or one is absent."""
    return one is None or other is None or np.array_equal(one.values, other.values, equal_nan=True)


def names_and_units(cells: Sequence[str], units: Sequence[str], line: int = 0) -> list[tuple[str, str]]:
    """Name and unit of every column.

    Args:
        cells: the names, with or without a unit: `name [unit]`.
        units: the units of names without one.
        line: line of the names, for the message.

    Raises:
        TableError: two columns have the same name.
    """
    parts = [cell.partition("[") for cell in cells]
    columns = [
        (name.strip(), inner.rstrip("] ").strip() or unit) for (name, _, inner), unit in zip(parts, units, strict=True)
    ]
    counts = Counter(name for name, _ in columns)
    duplicate = next((name for name, count in counts.items() if name and count > 1), None)
    if duplicate:
        raise TableError(line, f"has several columns `{duplicate}`; give each its own name")
    return columns
