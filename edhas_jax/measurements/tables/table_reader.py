"""Read the table of a run from a file of any format that data loggers write; its content says which one it is.

Nothing is repaired: unreadable lines and columns are left out, unreadable numbers are NaN, and a remark reports each.
"""

from collections.abc import Callable
from pathlib import Path

from edhas_jax.core.regular_file import FileKindError, require_regular_file
from edhas_jax.measurements.campaign import Remark, Severity
from edhas_jax.measurements.tables.binary_tables import read_excel_table, read_mat_table, read_parquet_table
from edhas_jax.measurements.tables.channel_files import read_hdf5_table, read_mdf_table, read_tdms_table
from edhas_jax.measurements.tables.table import Report, Table, TableError
from edhas_jax.measurements.tables.text_table import read_text_table

MAX_BYTES = 1_000_000_000  # of a run file
# first bytes of a file, and its reader, or what to do with it
FORMATS: tuple[tuple[bytes, Callable[[Path, Report], Table] | str], ...] = (
    (b"PAR1", read_parquet_table),
    (b"MATLAB", read_mat_table),
    (b"PK\x03\x04", read_excel_table),
    (b"\xd0\xcf\x11\xe0", "is a file of Excel 97; save it as CSV or .xlsx"),
    (b"\x1f\x8b", "is compressed with gzip; unpack it"),
    (b"TDSm", read_tdms_table),
    (b"\x89HDF", read_hdf5_table),
    (b"MDF ", read_mdf_table),
    (b"UnFinMF ", "is an MDF file that was not finished; finish it with the program that wrote it"),
    (b"%PDF", "is a PDF file; export the table as CSV"),
)
# formats that an empty or damaged file is meant to have
SUFFIXES = {
    ".parquet": read_parquet_table, ".mat": read_mat_table, ".xlsx": read_excel_table, ".tdms": read_tdms_table,
    ".h5": read_hdf5_table, ".hdf5": read_hdf5_table, ".mf4": read_mdf_table, ".mdf": read_mdf_table,
}  # fmt: skip


def read_table(path: Path, remark: Callable[[Remark], None]) -> Table:
    """Read the table in a file.

    Args:
        path: a text file with separated values, a Parquet, MATLAB, Excel, HDF5, TDMS or MDF file.
        remark: called with a remark on everything that is left out.

    Returns:
        The columns that hold numbers.

    Raises:
        TableError: the file does not exist, has another format, is damaged, or has fewer than two samples.
    """

    def report(line: int, sentence: str) -> None:
        remark(Remark(Severity.ERROR, path, line, sentence))

    try:
        if (size := require_regular_file(path)) > MAX_BYTES:
            raise TableError(0, f"has {size / 1e6:.4g} MB; at most {MAX_BYTES / 1e6:.4g} MB are read")
        table = _reader(path)(path, report)
    except FileNotFoundError:
        raise TableError(0, "no such file") from None
    except FileKindError as error:
        raise TableError(0, str(error.strerror)) from None
    except OSError as error:
        raise TableError(0, f"cannot be read: {error.strerror or error}") from None
    if len(table.lines) < 2:
        raise TableError(0, f"at least 2 samples are needed; there are {len(table.lines)}")
    return table


def _reader(path: Path) -> Callable[[Path, Report], Table]:
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
    return SUFFIXES.get(path.suffix.lower(), read_text_table)
