"""Read the table of a run from a file of any format that data loggers write; its content says which one it is.

Nothing is repaired: unreadable lines are left out, unreadable numbers are NaN, and a remark reports each; a column that
cannot be read says why (`Column.fault`).
"""

from collections.abc import Callable
from pathlib import Path

from edhas_jax.core.regular_file import FileKindError, require_regular_file
from edhas_jax.measurements.campaign import Remark, Severity
from edhas_jax.measurements.tables.binary_tables import read_excel_tables, read_mat_tables, read_parquet_tables
from edhas_jax.measurements.tables.channel_files import read_hdf5_tables, read_mdf_tables, read_tdms_tables
from edhas_jax.measurements.tables.table import MAX_BYTES, Layout, Report, Table, TableError, joined
from edhas_jax.measurements.tables.text_table import read_text_tables

MIN_SAMPLES = 2  # of a table; a single value is a setting of the logger
# first bytes of a file, and its reader, or what to do with it
FORMATS: tuple[tuple[bytes, Callable[[Path, Layout, Report], list[Table]] | str], ...] = (
    (b"PAR1", read_parquet_tables),
    (b"MATLAB", read_mat_tables),
    (b"PK\x03\x04", read_excel_tables),
    (b"\xd0\xcf\x11\xe0", "is a file of Excel 97; save it as CSV or .xlsx"),
    (b"\x1f\x8b", "is compressed with gzip; unpack it"),
    (b"TDSm", read_tdms_tables),
    (b"\x89HDF", read_hdf5_tables),
    (b"MDF ", read_mdf_tables),
    (b"UnFinMF ", "is an MDF file that was not finished; finish it with the program that wrote it"),
    (b"%PDF", "is a PDF file; export the table as CSV"),
)
# formats that an empty or damaged file is meant to have
SUFFIXES = {
    ".parquet": read_parquet_tables, ".mat": read_mat_tables, ".xlsx": read_excel_tables, ".tdms": read_tdms_tables,
    ".h5": read_hdf5_tables, ".hdf5": read_hdf5_tables, ".mf4": read_mdf_tables, ".mdf": read_mdf_tables,
}  # fmt: skip


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
    try:
        if (size := require_regular_file(path)) > MAX_BYTES:
            raise TableError(0, f"has {size / 1e6:.4g} MB; at most {MAX_BYTES / 1e6:.4g} MB are read")
        tables = _reader(path)(path, layout, _report(path, remark))
    except FileNotFoundError:
        raise TableError(0, "no such file") from None
    except FileKindError as error:
        raise TableError(0, str(error.strerror)) from None
    except OSError as error:
        raise TableError(0, f"cannot be read: {error.strerror or error}") from None
    count = max((len(table.lines) for table in tables), default=0)
    if count < MIN_SAMPLES:
        raise TableError(0, f"at least {MIN_SAMPLES} samples are needed; there are {count}")
    return [table for table in tables if len(table.lines) >= MIN_SAMPLES]


def read_table(path: Path, remark: Callable[[Remark], None], layout: Layout = Layout()) -> Table:
    """Read the table in a file; of several tables those with the same time as most columns, as one.

    Args, returns and raises as of `read_tables`.
    """
    return joined(read_tables(path, remark, layout), _report(path, remark))


def _report(path: Path, remark: Callable[[Remark], None]) -> Report:
    def report(line: int, sentence: str, severity: Severity = Severity.ERROR) -> None:
        remark(Remark(severity, path, line, sentence))

    return report


def _reader(path: Path) -> Callable[[Path, Layout, Report], list[Table]]:
    """The reader for the format of a file.

    Raises:
        TableError: no reader reads this format.
    """
    with path.open("rb") as file:
        start = file.read(8)
    for magic, reader in FORMATS:
        if start.startswith(magic):
            if isinstance(reader, str):
                raise TableError(0, reader)
            return reader
    return SUFFIXES.get(path.suffix.lower(), read_text_tables)
