"""Read the table of a run: columns named `name [unit]` in a CSV or Parquet file, or the variables of a MATLAB file.

Nothing is repaired: unreadable lines and columns are left out, unreadable numbers are NaN, and a remark reports each.
"""

import csv
import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np

from edhas_jax.measurements.campaign import Remark, Severity

SUFFIXES = (".csv", ".parquet", ".mat")


class TableError(ValueError):
    """A file cannot be used at all; `line` is the line at fault, 0 for the file as a whole."""

    def __init__(self, line: int, sentence: str):
        super().__init__(sentence)
        self.line = line


@dataclasses.dataclass(frozen=True)
class Column:
    """The values (samples,) of a column as in the file, and the unit stated there ("" without one)."""

    unit: str
    values: np.ndarray


@dataclasses.dataclass(frozen=True)
class Table:
    """The columns of a file by name; `lines` (samples,) is the line (CSV) or row (others, from 1) of each sample."""

    columns: dict[str, Column]
    lines: np.ndarray


def read_table(path: Path, remark: Callable[[Remark], None]) -> Table:
    """Read the table in a file.

    Args:
        path: a CSV, Parquet or MATLAB file.
        remark: called with a remark on everything that is left out.

    Returns:
        The columns that hold numbers.

    Raises:
        TableError: the file does not exist, has another format, is damaged, or has fewer than two samples.
    """
    readers = {".csv": _read_csv, ".parquet": _read_parquet, ".mat": _read_mat}

    def report(line: int, sentence: str) -> None:
        remark(Remark(Severity.ERROR, path, line, sentence))

    if path.suffix not in readers:
        raise TableError(0, f"a file {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]} is needed")
    if not path.is_file():
        raise TableError(0, "no such file")
    try:
        table = readers[path.suffix](path, report)
    except OSError as error:
        raise TableError(0, f"cannot be read: {error.strerror or error}") from None
    if len(table.lines) < 2:
        raise TableError(0, f"at least 2 samples are needed; there are {len(table.lines)}")
    return table


def _names_and_units(cells: list[str], units: list[str]) -> list[tuple[str, str]]:
    """Name and unit of every column, from `name [unit]` or, where a cell has no unit, from `units`."""
    parts = [cell.partition("[") for cell in cells]
    columns = [
        (name.strip(), inner.rstrip("] ").strip() or unit) for (name, _, inner), unit in zip(parts, units, strict=True)
    ]
    names = [name for name, _ in columns]
    duplicate = next((name for name in names if names.count(name) > 1), None)
    if duplicate:
        raise TableError(1, f"has several columns `{duplicate}`; give each its own name")
    return columns


def _read_csv(path: Path, report: Callable[[int, str], None]) -> Table:
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        raise TableError(0, "is not a text file in UTF-8; a CSV file is needed") from None
    physical = text.splitlines(keepends=True)
    reader = csv.reader(physical)
    header = [cell.strip() for cell in next(reader, [])]
    if not any(header):
        raise TableError(0, "is empty; the first line names the columns, such as `time [s],voltage [V]`")
    if len(header) == 1 and ";" in header[0]:
        raise TableError(1, "columns must be separated by commas, not semicolons")
    named = _names_and_units(header, [""] * len(header))
    rows, lines, not_numbers = [], [], {}
    for row in reader:
        if not row:
            continue
        if len(row) != len(header):
            truncated = "; the file seems to be truncated" if reader.line_num == len(physical) else ""
            report(reader.line_num, f"{len(row)} values where the header has {len(header)}{truncated}; line left out")
            continue
        rows.append([_number(cell, not_numbers, (reader.line_num, at)) for at, cell in enumerate(row)])
        lines.append(reader.line_num)
    if rows and text[-1] not in "\r\n" and lines[-1] == reader.line_num:
        # "0.0123" truncated to "0.0" would pass as a number
        report(lines[-1], "the last line has no line end; the file seems to be truncated; line left out")
        del rows[-1], lines[-1]
    for at, (name, _) in enumerate(named):
        bad = [(line, cell) for (line, column), cell in not_numbers.items() if column == at]
        if bad:
            more = f" (and {len(bad) - 1} more in this column)" if len(bad) > 1 else ""
            report(bad[0][0], f'`{name}`: "{bad[0][1]}" is not a number{more}; taken as missing')
    values = np.array(rows, float).reshape(len(rows), len(named))
    columns = {name: Column(unit, values[:, at]) for at, (name, unit) in enumerate(named)}
    return Table(columns, np.array(lines, int))


def _number(cell: str, not_numbers: dict[tuple[int, int], str], place: tuple[int, int]) -> float:
    try:
        return float(cell) if cell.strip() else np.nan
    except ValueError:
        not_numbers[place] = cell.strip()
        return np.nan


def _read_parquet(path: Path, report: Callable[[int, str], None]) -> Table:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        data = pq.read_table(path)
    except (pa.ArrowException, ValueError):
        raise TableError(0, "is damaged or not a Parquet file") from None
    units = [(field.metadata or {}).get(b"unit", b"").decode() for field in data.schema]
    columns = {}
    for field, (name, unit) in zip(data.schema, _names_and_units(data.schema.names, units), strict=True):
        if not (pa.types.is_floating(field.type) or pa.types.is_integer(field.type)):
            report(0, f"column `{field.name}` does not hold numbers; it is left out")
            continue
        columns[name] = Column(unit, data.column(field.name).to_numpy().astype(float))
    return Table(columns, np.arange(1, data.num_rows + 1))


def _read_mat(path: Path, report: Callable[[int, str], None]) -> Table:
    """Read one vector per signal, named as the signal; a struct `units` may give their units as texts."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        data = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        raise TableError(0, "is a MATLAB file of version 7.3; write it with `save(name, '-v7')`") from None
    except (MatReadError, ValueError, TypeError, KeyError):
        raise TableError(0, "is damaged or not a MATLAB file") from None
    units = data.pop("units", {})
    units = units if isinstance(units, dict) else {}
    vectors = {
        name: np.ravel(value).astype(float)
        for name, value in data.items()
        if not name.startswith("__") and isinstance(value, np.ndarray) and value.dtype.kind in "fiu"
    }
    lengths = [len(values) for values in vectors.values()]
    count = max(lengths, key=lengths.count, default=0)
    for name in [name for name, values in vectors.items() if len(values) != count]:
        report(0, f"`{name}` has {len(vectors.pop(name))} samples where others have {count}; it is left out")
    columns = {name: Column(str(units.get(name, "")), values) for name, values in vectors.items()}
    return Table(columns, np.arange(1, count + 1))
