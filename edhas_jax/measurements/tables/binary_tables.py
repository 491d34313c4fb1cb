"""Read the tables in a Parquet, MATLAB or Excel file."""

import datetime
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from edhas_jax.measurements.tables.binary_reading import damaged_unless, reader_library
from edhas_jax.measurements.tables.cell_values import Cell, decimal_mark, read_column
from edhas_jax.measurements.tables.channel_files import read_hdf5_tables
from edhas_jax.measurements.tables.row_table import Row, find_header
from edhas_jax.measurements.tables.table import (
    MAX_BYTES,
    Column,
    Layout,
    Report,
    Table,
    TableError,
    Vector,
    flat_vectors,
    matlab_object,
    names_and_units,
    require_size,
    seconds_since_first,
    tables_of_vectors,
)

SAMPLED_ROWS = 400  # in which the number of columns and the decimal mark are found
CHUNK = 1 << 20  # bytes that are unpacked at once
COMPRESSED = 15  # type of an element of a MATLAB file
NUMERIC_CLASSES = (
    "double", "single", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "logical", "char",
)  # fmt: skip


def read_parquet_tables(path: Path, layout: Layout, report: Report) -> list[Table]:
    """Read the columns of a Parquet file; the metadata of a column may state its unit.

    Raises:
        TableError: the file is damaged, or unpacks to more than is read.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    with damaged_unless("a Parquet file"), pq.ParquetFile(path, page_checksum_verification=True) as file:
        schema = file.schema_arrow
        is_time = [pa.types.is_timestamp(field.type) for field in schema]
        used = [
            pa.types.is_floating(field.type) or pa.types.is_integer(field.type) or stamp
            for field, stamp in zip(schema, is_time, strict=True)
        ]
        for field, is_used in zip(schema, used, strict=True):
            if not is_used:
                report(0, f"column `{field.name}` does not hold numbers; it is left out")
        require_size(file.metadata.num_rows * sum(used))
        units = [
            "s" if stamp else _text((field.metadata or {}).get(b"unit", b""))
            for field, stamp in zip(schema, is_time, strict=True)
        ]
        named = names_and_units(schema.names, units)
        columns = {}
        for name, (own, unit), is_used, stamp in zip(schema.names, named, used, is_time, strict=True):
            if is_used:
                values = file.read(columns=[name]).column(0).to_numpy()
                columns[own] = Column(unit, seconds_since_first(values) if stamp else values.astype(float))
        return [Table(columns, np.arange(1, file.metadata.num_rows + 1))]


def _text(data: bytes) -> str:
    """A text in UTF-8, otherwise in the Western European code of Windows."""
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def read_mat_tables(path: Path, layout: Layout, report: Report) -> list[Table]:
    """Read vectors, matrices and structures; a struct `units` of the same form may give their units as texts.

    Raises:
        TableError: the file is damaged, unpacks to more than is read, or h5py is needed and not installed.
    """
    from scipy.io import loadmat, whosmat

    with damaged_unless("a MATLAB file"):
        try:
            variables = whosmat(path)
        except NotImplementedError:  # version 7.3
            return read_hdf5_tables(path, layout, report)
        plain = [int(np.prod(shape)) for _, shape, kind in variables if kind in NUMERIC_CLASSES]
        # the sizes inside structures and cells are not listed: each byte of the file may become a number of 8 bytes
        require_size(sum(plain) if len(plain) == len(variables) else max(sum(plain), _unpacked_size(path)))
        data = loadmat(path, simplify_cells=True)
    for name, _, kind in variables:
        if kind in ("opaque", "object", "function"):
            report(0, matlab_object(name))
    units = dict(_flat("", data.pop("units", {})))
    vectors = [
        Vector("", name, str(units.get(name, "")), column)
        for root, value in data.items()
        if not root.startswith("__")
        for item, array in _flat(root, value)
        if isinstance(array, np.ndarray)
        for name, column in flat_vectors(item, array, report)
    ]
    return tables_of_vectors(vectors)


def _unpacked_size(path: Path) -> int:
    """Bytes that the elements of a MATLAB file unpack to, counted up to just above `MAX_BYTES`."""
    size = 0
    with path.open("rb") as file:
        order = "little" if file.read(128)[126:128] == b"IM" else "big"
        while len(tag := file.read(8)) == 8 and 8 * size <= MAX_BYTES:
            kind, left = (int.from_bytes(part, order) for part in (tag[:4], tag[4:]))
            if kind != COMPRESSED:
                size += left
                file.seek(left, 1)
                continue
            unpacked = zlib.decompressobj()
            while left > 0 and (data := file.read(min(left, CHUNK))) and 8 * size <= MAX_BYTES:
                left -= len(data)
                while data and 8 * size <= MAX_BYTES:
                    size += len(unpacked.decompress(data, CHUNK))
                    data = unpacked.unconsumed_tail
    return size


def _flat(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """The contents of structures and cells by their names: `s.x`, and `s.2.x` in an array of structures."""
    if isinstance(value, np.ndarray) and value.dtype == object:
        value = value.ravel().tolist()
    if isinstance(value, list):
        value = {str(k): item for k, item in enumerate(value, 1)}
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _flat(f"{name}.{key}" if name else key, item)
    else:
        yield name, value


def read_excel_tables(path: Path, layout: Layout, report: Report) -> list[Table]:
    """Read the table on a sheet of an Excel file: the stated one, otherwise the first that holds a table.

    Raises:
        TableError: openpyxl is not installed, the file is damaged or too large, or there is no such sheet or no table.
    """
    openpyxl = reader_library("openpyxl", "an Excel file", "excel", "save it as CSV")
    with damaged_unless("an Excel file"), path.open("rb") as file:
        with zipfile.ZipFile(file) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        require_size(size // 8)
        book = openpyxl.load_workbook(file, read_only=True, data_only=True)
        names = [sheet.title for sheet in book.worksheets]
        if layout.sheet and layout.sheet not in names:
            raise TableError(0, f"has no sheet `{layout.sheet}`; its sheets: {', '.join(names)}")
        errors = []
        for name in [layout.sheet] if layout.sheet else names:
            rows = _rows(book[name])
            try:
                return [_table_of_rows(rows, layout, report)]
            except TableError as error:
                errors.append(error)
        raise errors[0]


def _rows(sheet: Any) -> list[Row]:
    """The rows of a sheet that are not empty, all of the same length.

    Raises:
        TableError: the sheet is too large.
    """
    rows, filled, count = [], Counter(), 0
    sheet.reset_dimensions()  # a single cell far away would make every row as long
    for line, cells in enumerate(sheet.iter_rows(values_only=True), 1):
        count += len(cells)
        require_size(count)
        own = [k for k, cell in enumerate(cells) if cell is not None]
        if own:
            filled.update(own)
            rows.append((line, [_excel_cell(cell) for cell in cells[: own[-1] + 1]]))
    # a column of a table has several cells; a single one beside it is a note
    width = 1 + max((k for k, times in filled.items() if times > 1), default=0)
    rows = [(line, cells[:width] + [None] * (width - len(cells))) for line, cells in rows]
    return [(line, cells) for line, cells in rows if any(cell is not None for cell in cells)]


def _table_of_rows(rows: list[Row], layout: Layout, report: Report) -> Table:
    """The table in the rows of a sheet."""
    sample = [cells for _, cells in rows[:: max(1, len(rows) // SAMPLED_ROWS)]]
    header = find_header(rows, sample, "cells")
    mark = layout.decimal or decimal_mark([cell for cells in sample for cell in cells])
    body = rows[header.first :]
    lines = np.array([line for line, _ in body])
    columns = {}
    for (name, unit), cells in zip(header.names, zip(*(cells for _, cells in body), strict=True), strict=True):
        if name:
            columns[name] = read_column(name, unit, cells, lines, mark, bool(layout.decimal), report)
    return Table(columns, lines, header.line)


def _excel_cell(value: object) -> Cell:
    """A cell as number, date, text or None."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if value is None or isinstance(value, datetime.datetime | datetime.time | datetime.timedelta):
        return value
    return str(value)
