"""The file of a run: columns named `name [unit]` in a CSV or Parquet file, or the variables of a MATLAB file.

Nothing is repaired: what cannot be read is left out, a missing number is NaN, and a remark says so.
"""

import csv
import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np

from edhas_jax.measurements.campaign import Remark, Severity

SUFFIXES = (".csv", ".parquet", ".mat")


class TableError(ValueError):
    """A file is of no use at all; `line` is 0 when no single line is to blame."""

    def __init__(self, line: int, what: str):
        super().__init__(what)
        self.line = line


@dataclasses.dataclass(frozen=True)
class Column:
    """Numbers (n,) as they stand in the file, and the unit that the file gives them ("" when it gives none)."""

    unit: str
    values: np.ndarray


@dataclasses.dataclass(frozen=True)
class Table:
    """The columns of a file by name; `lines` (n,) is the line (CSV) or the row (others, from 1) of each sample."""

    columns: dict[str, Column]
    lines: np.ndarray


def read_table(path: Path, remark: Callable[[Remark], None]) -> Table:
    """The table in a file; what had to be left out goes to `remark`.

    Raises:
        TableError: no such file, another format, damaged, without a sample.
    """
    readers = {".csv": _csv, ".parquet": _parquet, ".mat": _mat}
    if path.suffix not in readers:
        raise TableError(0, f"a file {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]} is needed")
    if not path.is_file():
        raise TableError(0, "no such file")
    try:
        table = readers[path.suffix](path, lambda line, what: remark(Remark(Severity.ERROR, path, line, what)))
    except OSError as error:
        raise TableError(0, f"cannot be read: {error.strerror or error}") from None
    if len(table.lines) < 2:
        raise TableError(0, f"at least 2 samples are needed; there are {len(table.lines)}")
    return table


def _named(cells: list[str], units: list[str]) -> list[tuple[str, str]]:
    """Name and unit of every column, from `name [unit]` or, where a cell gives none, from `units`."""
    parts = [cell.partition("[") for cell in cells]
    named = [
        (name.strip(), inner.rstrip("] ").strip() or unit) for (name, _, inner), unit in zip(parts, units, strict=True)
    ]
    names = [name for name, _ in named]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice:
        raise TableError(1, f"has several columns `{twice}`; name each differently")
    return named


def _csv(path: Path, tell: Callable[[int, str], None]) -> Table:
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
    named = _named(header, [""] * len(header))
    rows, lines, no_numbers = [], [], {}
    for row in reader:
        if not row:
            continue
        if len(row) != len(header):
            cut = "; the file seems to be cut off" if reader.line_num == len(physical) else ""
            tell(reader.line_num, f"{len(row)} values where the header has {len(header)}{cut}; the line is left out")
            continue
        rows.append([_number(cell, no_numbers, (reader.line_num, at)) for at, cell in enumerate(row)])
        lines.append(reader.line_num)
    if rows and text[-1] not in "\r\n" and lines[-1] == reader.line_num:
        # "0.0123" cut to "0.0" would pass for a sample
        tell(lines[-1], "the last line has no end; the file seems to be cut off; the line is left out")
        del rows[-1], lines[-1]
    for at, (name, _) in enumerate(named):
        bad = [(line, cell) for (line, column), cell in no_numbers.items() if column == at]
        if bad:
            more = f" (and {len(bad) - 1} more in this column)" if len(bad) > 1 else ""
            tell(bad[0][0], f'`{name}`: "{bad[0][1]}" is not a number{more}; taken as a hole')
    values = np.array(rows, float).reshape(len(rows), len(named))
    columns = {name: Column(unit, values[:, at]) for at, (name, unit) in enumerate(named)}
    return Table(columns, np.array(lines, int))


def _number(cell: str, no_numbers: dict[tuple[int, int], str], place: tuple[int, int]) -> float:
    try:
        return float(cell) if cell.strip() else np.nan
    except ValueError:
        no_numbers[place] = cell.strip()
        return np.nan


def _parquet(path: Path, tell: Callable[[int, str], None]) -> Table:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        data = pq.read_table(path)
    except (pa.ArrowException, ValueError):
        raise TableError(0, "is damaged or not a Parquet file") from None
    units = [(field.metadata or {}).get(b"unit", b"").decode() for field in data.schema]
    columns = {}
    for field, (name, unit) in zip(data.schema, _named(data.schema.names, units), strict=True):
        if not (pa.types.is_floating(field.type) or pa.types.is_integer(field.type)):
            tell(0, f"column `{field.name}` holds no numbers; it is left out")
            continue
        columns[name] = Column(unit, data.column(field.name).to_numpy().astype(float))
    return Table(columns, np.arange(1, data.num_rows + 1))


def _mat(path: Path, tell: Callable[[int, str], None]) -> Table:
    """One vector per signal, named as the signal; a struct `units` may give the unit of each as text."""
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
        tell(0, f"`{name}` has {len(vectors.pop(name))} samples where others have {count}; it is left out")
    columns = {name: Column(str(units.get(name, "")), values) for name, values in vectors.items()}
    return Table(columns, np.arange(1, count + 1))
