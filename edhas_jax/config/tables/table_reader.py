"""Read a table from a file of any format that data loggers write; its content says which one it is.

Nothing is repaired: in the record of a run, unreadable lines are left out, unreadable numbers are NaN, and a remark
reports each; a column that cannot be read says why (`Column.fault`). In a table that a configuration names, nothing may
be missing (`CompleteTable`).
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from edhas_jax.config.tables import binary_tables as binary
from edhas_jax.config.tables.table import MAX_BYTES, TIME, Column, Layout, Report, Table, TableError
from edhas_jax.config.tables.text_table import read_text_tables
from edhas_jax.core.regular_file import FileKindError, require_regular_file
from edhas_jax.core.remark import Remark, Severity

MIN_SAMPLES = 2  # of a table; a single value is a setting of the logger
MAX_NAMES = 8  # columns that a message names
# first bytes of a file, suffixes of an empty or damaged one that is meant to have this format, and its reader, or what
# to do with it
FORMATS: tuple[tuple[bytes, tuple[str, ...], Callable[[Path, Layout, Report], list[Table]] | str], ...] = (
    (b"PAR1", (".parquet",), binary.read_parquet_tables),
    (b"MATLAB", (".mat",), binary.read_mat_tables),
    (b"PK\x03\x04", (".xlsx",), binary.read_excel_tables),
    (b"\xd0\xcf\x11\xe0", (), "is a file of Excel 97; save it as CSV or .xlsx"),
    (b"\x1f\x8b", (), "is compressed with gzip; unpack it"),
    (b"TDSm", (".tdms",), binary.read_tdms_tables),
    (b"\x89HDF", (".h5", ".hdf5"), binary.read_hdf5_tables),
    (b"MDF ", (".mf4", ".mdf"), binary.read_mdf_tables),
    (b"UnFinMF ", (), "is an MDF file that was not finished; finish it with the program that wrote it"),
    (b"%PDF", (), "is a PDF file; export the table as CSV"),
)


def read_tables(path: Path, remark: Callable[[Remark], None], layout: Layout = Layout()) -> list[Table]:
    """Read the tables in a file: one for each group of channels and number of samples, each with its own time.

    Args:
        path: a text file with separated values, a Parquet, MATLAB, Excel, HDF5, TDMS or MDF file.
        remark: called with a remark on everything that is left out.
        layout: what the campaign states about the file.

    Returns:
        The columns that hold numbers; at least one table, each of at least two samples.

    Raises:
        TableError: the file does not exist, has another format, is damaged, or has fewer than two samples.
    """
    report = _report(path, remark)
    tables = _tables(path, report, layout)
    for gap in (column.gap for table in tables for column in table.columns.values() if column.gap):
        report(gap.line, str(gap), outcome="taken as missing")
    count = max((len(table.lines) for table in tables), default=0)
    if count < MIN_SAMPLES:
        raise TableError(0, f"at least {MIN_SAMPLES} samples are needed; there are {count}")
    return [table for table in tables if len(table.lines) >= MIN_SAMPLES]


def read_table(path: Path, remark: Callable[[Remark], None], layout: Layout = Layout()) -> Table:
    """Read the table in a file; of several tables those with the same time as most columns, as one.

    Args, returns and raises as of `read_tables`.
    """
    return _joined(read_tables(path, remark, layout), _report(path, remark))


class CompleteTable:
    """A table of which no line may be left out, and no number that is needed may be missing.

    Args:
        path: the file, of any format.

    Attributes:
        units: by name of a column its unit in the file, "" without one.

    Raises:
        TableError: as `read_tables`, and where a line cannot be used, or the last one has no end.
    """

    def __init__(self, path: Path):
        self._columns_left_out: list[str] = []

        def report(line: int, sentence: str, severity: Severity = Severity.ERROR, outcome: str = "") -> None:
            if line:
                remedy = "" if severity is Severity.ERROR else "; add one if the file is complete"
                raise TableError(line, sentence + remedy)
            self._columns_left_out.append(sentence)

        self._path, self._table = path, _joined(_tables(path, report, Layout()), report)
        self.units = {name: column.unit for name, column in self._table.columns.items()}

    def __len__(self):
        return len(self._table.lines)

    def header(self, name: str) -> str:
        """The header of a column: `name [unit]`."""
        return f"{name} [{self.units[name]}]" if self.units[name] else name

    def place(self, row: int) -> str:
        """File and line of a row."""
        return f"{self._path}:{self._table.lines[row]}"

    def values(self, name: str) -> np.ndarray:
        """The numbers (rows,) in a column, in its unit.

        Raises:
            TableError: one of them is missing or not finite.
        """
        column = self._table.columns[name]
        if problem := column.fault or column.gap:
            raise problem
        wrong = ~np.isfinite(column.values)
        if wrong.any():
            k = int(np.argmax(wrong))
            missing = "a number is missing; every row needs one" if np.isnan(column.values[k]) else "must be finite"
            raise TableError(int(self._table.lines[k]), f"`{self.header(name)}`: {missing}")
        return column.values

    def require_all_columns(self) -> None:
        """Check that every column of the file holds numbers.

        Raises:
            TableError: one does not.
        """
        if self._columns_left_out:
            raise TableError(0, self._columns_left_out[0])


def _tables(path: Path, report: Report, layout: Layout) -> list[Table]:
    """The tables in a file as its reader finds them.

    Raises:
        TableError: the file does not exist, has another format, or is damaged.
    """
    try:
        if (size := require_regular_file(path)) > MAX_BYTES:
            raise TableError(0, f"has {size / 1e6:.4g} MB; at most {MAX_BYTES / 1e6:.4g} MB are read")
        return _reader(path)(path, layout, report)
    except FileNotFoundError:
        raise TableError(0, "no such file") from None
    except FileKindError as error:
        raise TableError(0, str(error.strerror)) from None
    except OSError as error:
        raise TableError(0, f"cannot be read: {error.strerror or error}") from None


def _joined(tables: Sequence[Table], report: Report) -> Table:
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


def _report(path: Path, remark: Callable[[Remark], None]) -> Report:
    def report(line: int, sentence: str, severity: Severity = Severity.ERROR, outcome: str = "") -> None:
        remark(Remark(severity, path, line, "; ".join(filter(None, (sentence, outcome)))))

    return report


def _reader(path: Path) -> Callable[[Path, Layout, Report], list[Table]]:
    """The reader for the format of a file.

    Raises:
        TableError: no reader reads this format.
    """
    with path.open("rb") as file:
        start = file.read(8)
    by_content = (reader for magic, _, reader in FORMATS if start.startswith(magic))
    by_name = (reader for _, suffixes, reader in FORMATS if path.suffix.lower() in suffixes)
    reader = next(by_content, None) or next(by_name, read_text_tables)
    if isinstance(reader, str):
        raise TableError(0, reader)
    return reader
