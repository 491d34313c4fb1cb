"""Read a table from a Parquet, MATLAB or Excel file."""

import zipfile
from pathlib import Path

import numpy as np

from edhas_jax.measurements.tables.channel_files import read_hdf5_tables
from edhas_jax.measurements.tables.row_table import Cell, table_from_rows
from edhas_jax.measurements.tables.table import (
    Column,
    Report,
    Table,
    TableError,
    Vector,
    names_and_units,
    tables_of_vectors,
)

MAX_UNPACKED_SIZE = 1 << 30  # bytes of an Excel file


def read_parquet_tables(path: Path, report: Report) -> list[Table]:
    """Read the columns of a Parquet file; the metadata of a column may state its unit.

    Raises:
        TableError: the file is damaged.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        data = pq.read_table(path, page_checksum_verification=True)
        names = data.schema.names
    except FileNotFoundError:
        raise
    except (pa.ArrowException, ValueError, OSError):
        raise TableError(0, "is damaged or not a Parquet file") from None
    units = [_text((field.metadata or {}).get(b"unit", b"")) for field in data.schema]
    columns = {}
    for field, (name, unit) in zip(data.schema, names_and_units(names, units), strict=True):
        if not (pa.types.is_floating(field.type) or pa.types.is_integer(field.type)):
            report(0, f"column `{field.name}` does not hold numbers; it is left out")
            continue
        columns[name] = Column(unit, data.column(field.name).to_numpy().astype(float))
    return [Table(columns, np.arange(1, data.num_rows + 1))]


def _text(data: bytes) -> str:
    """A text in UTF-8, otherwise in the Western European code of Windows."""
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def read_mat_tables(path: Path, report: Report) -> list[Table]:
    """Read one vector per signal, named as the signal; a struct `units` may give their units as texts.

    Raises:
        TableError: the file is damaged, or h5py is needed for its version and not installed.
    """
    from scipy.io import loadmat

    try:
        data = loadmat(path, simplify_cells=True)
    except NotImplementedError:  # version 7.3
        return read_hdf5_tables(path, report)
    except FileNotFoundError:
        raise
    except Exception:  # a damaged file raises whatever its bytes lead to
        raise TableError(0, "is damaged or not a MATLAB file") from None
    units = data.pop("units", {})
    units = units if isinstance(units, dict) else {}
    vectors = [
        Vector("", name, str(units.get(name, "")), np.ravel(value).astype(float))
        for name, value in data.items()
        if not name.startswith("__") and isinstance(value, np.ndarray) and value.dtype.kind in "fiu"
    ]
    return tables_of_vectors(vectors)


def read_excel_tables(path: Path, report: Report) -> list[Table]:
    """Read the table on the first sheet of an Excel file.

    Raises:
        TableError: openpyxl is not installed, or the file is damaged or too large.
    """
    try:
        import openpyxl
    except ImportError:
        remedy = "save it as CSV, or install what reads it: pip install 'edhas_jax[excel]'"
        raise TableError(0, f"is an Excel file; {remedy}") from None
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size > MAX_UNPACKED_SIZE:
            raise TableError(0, f"unpacks to {size / 2**30:.0f} GiB, at most 1 GiB is read; save it as CSV")
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
        sheet = [[_excel_cell(value) for value in row] for row in book.worksheets[0].iter_rows(values_only=True)]
        book.close()
    except TableError:
        raise
    except Exception:  # a damaged file raises whatever its bytes lead to
        raise TableError(0, "is damaged or not an Excel file") from None
    width = max((k + 1 for row in sheet for k, cell in enumerate(row) if cell is not None), default=0)
    rows = [(line, row[:width]) for line, row in enumerate(sheet, 1) if any(cell is not None for cell in row)]
    return [table_from_rows(rows, "cells", report)]


def _excel_cell(value: object) -> Cell:
    """A cell as number, text or None."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    return None if value is None else str(value)
