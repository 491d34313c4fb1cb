"""Read the tables in a binary file: Parquet, MATLAB, HDF5, TDMS of LabVIEW, MDF of measurement systems, Excel."""

import contextlib
import datetime
import importlib
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from edhas_jax.config.tables.cell_values import Cell, Row, decimal_mark, find_header, read_column
from edhas_jax.config.tables.table import (
    MAX_BYTES,
    TIME,
    Column,
    Layout,
    Report,
    Table,
    TableError,
    names_and_units,
    require_size,
)

SAMPLED_ROWS = 400  # in which the number of columns and the decimal mark are found
CHUNK = 1 << 20  # bytes that are unpacked at once
COMPRESSED = 15  # type of an element of a MATLAB file
NUMERIC_CLASSES = (
    "double", "single", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "logical", "char",
)  # fmt: skip
UNIT_ATTRIBUTES = ("unit", "units", "Unit", "Units")  # of a dataset of HDF5
MAX_UNIT = 100  # characters of a unit
TDMS_UNITS = ("unit_string", "NI_UnitDescription", "unit")  # properties of a channel of TDMS


class _Vector(NamedTuple):
    """A channel of a file: its group ("" without one), its name, which may have the unit in brackets, unit, values."""

    group: str
    name: str
    unit: str
    values: np.ndarray


def _library(module: str, what: str, extra: str, otherwise: str) -> ModuleType:
    """The library that reads a format.

    Args:
        module: its name.
        what: the kind of file, such as "an MDF file".
        extra: the extra of this package that installs it.
        otherwise: what else one can do.

    Raises:
        TableError: it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        remedy = f"{otherwise}, or install what reads it: pip install 'edhas_jax[{extra}]'"
        raise TableError(0, f"is {what}; {remedy}") from None


@contextlib.contextmanager
def _damaged_unless(what: str) -> Iterator[None]:
    """Read a file of this kind within this context: any error of the library that reads it means a damaged file.

    Raises:
        TableError: the block raised any other error than a FileNotFoundError.
    """
    try:
        yield
    except (FileNotFoundError, TableError):
        raise
    except Exception:
        raise TableError(0, f"is damaged or not {what}") from None


def _vectors_of(name: str, array: np.ndarray, report: Report) -> list[tuple[str, np.ndarray]]:
    """The columns of an array of numbers, by name: `name`, or `name.1`, `name.2`, … of a matrix.

    Args:
        name: the name of the array.
        array: its values; the samples are along the longest dimension.
        report: called where it holds no numbers, or has more than two dimensions.
    """
    if array.dtype.names:
        return [entry for key in array.dtype.names for entry in _vectors_of(f"{name}.{key}", array[key], report)]
    if array.dtype.kind not in "fiuM":
        return []
    array = array.squeeze()
    if array.ndim < 2:
        values = np.atleast_1d(array)
        return [(name, _seconds_since_first(values) if array.dtype.kind == "M" else values.astype(float))]
    if array.ndim > 2:
        report(0, f"`{name}` has {array.ndim} dimensions; it is left out")
        return []
    columns = array if array.shape[0] < array.shape[1] else array.T
    return [(f"{name}.{k}", column.astype(float)) for k, column in enumerate(columns, 1)]


def _seconds_since_first(stamps: np.ndarray) -> np.ndarray:
    """Seconds since the first of dates with their times (samples,); NaN where there is none."""
    valid = stamps[~np.isnat(stamps)]
    return (stamps - valid[0]) / np.timedelta64(1, "s") if len(valid) else np.full(len(stamps), np.nan)


def _matlab_object(name: str) -> str:
    """What to say of an object of MATLAB."""
    remedy = f"save its numbers, such as `t = {name}.Time; x = {name}.Data; save('run.mat', 't', 'x')`"
    return f"`{name}` is an object of MATLAB (timeseries, table), which only MATLAB reads; {remedy}"


def _tables_of(vectors: Sequence[_Vector]) -> list[Table]:
    """The channels of a file as tables: those of one group with the same number of samples share a table.

    Raises:
        TableError: two channels of a group have the same name.
    """
    tables: dict[tuple[str, int], Table] = {}
    for group in dict.fromkeys(vector.group for vector in vectors):
        own = [vector for vector in vectors if vector.group == group]
        named = names_and_units([vector.name for vector in own], [vector.unit for vector in own])
        for vector, (name, unit) in zip(own, named, strict=True):
            count = len(vector.values)
            table = tables.setdefault((group, count), Table({}, np.arange(1, count + 1), name=group))
            table.columns[name] = Column(unit, vector.values)
    return list(tables.values())


def _text(value: Any) -> str:
    """A text as such, as bytes in UTF-8 or the Western European code of Windows, or as character codes of MATLAB."""
    if value is None:
        return ""
    if isinstance(value, np.ndarray) and value.dtype.kind in "ui":
        return "".join(map(chr, np.ravel(value)))
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.ravel()[0]
    if not isinstance(value, bytes):
        return str(value)
    try:
        return value.decode()
    except UnicodeDecodeError:
        return value.decode("cp1252", errors="replace")


def read_parquet_tables(path: Path, layout: Layout, report: Report) -> list[Table]:
    """Read the columns of a Parquet file; the metadata of a column may state its unit.

    Raises:
        TableError: the file is damaged, or unpacks to more than is read.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    with _damaged_unless("a Parquet file"), pq.ParquetFile(path, page_checksum_verification=True) as file:
        fields = []  # that hold numbers or dates with times, with their units
        for field in file.schema_arrow:
            if pa.types.is_timestamp(field.type):
                fields.append((field.name, "s"))
            elif pa.types.is_floating(field.type) or pa.types.is_integer(field.type):
                fields.append((field.name, _text((field.metadata or {}).get(b"unit", b""))))
            else:
                report(0, f"column `{field.name}` does not hold numbers; it is left out")
        require_size(file.metadata.num_rows * len(fields))
        columns = {}
        names, units = zip(*fields, strict=True) if fields else ((), ())
        for name, (own, unit) in zip(names, names_and_units(names, units), strict=True):
            values = file.read(columns=[name]).column(0).to_numpy()
            is_stamp = values.dtype.kind == "M"
            columns[own] = Column(unit, _seconds_since_first(values) if is_stamp else values.astype(float))
        return [Table(columns, np.arange(1, file.metadata.num_rows + 1))]


def read_mat_tables(path: Path, layout: Layout, report: Report) -> list[Table]:
    """Read vectors, matrices and structures; a struct `units` of the same form may give their units as texts.

    Raises:
        TableError: the file is damaged, unpacks to more than is read, or h5py is needed and not installed.
    """
    from scipy.io import loadmat, whosmat

    with _damaged_unless("a MATLAB file"):
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
            report(0, _matlab_object(name))
    units = dict(_flat("", data.pop("units", {})))
    vectors = [
        _Vector("", name, str(units.get(name, "")), column)
        for root, value in data.items()
        if not root.startswith("__")
        for item, array in _flat(root, value)
        if isinstance(array, np.ndarray)
        for name, column in _vectors_of(item, array, report)
    ]
    return _tables_of(vectors)


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


def read_hdf5_tables(path: Path, layout: Layout, report: Report) -> list[Table]:
    """Read vectors and matrices from an HDF5 or MATLAB 7.3 file; as units attributes, or a struct `units` of texts.

    Raises:
        TableError: h5py is not installed, the file is damaged, unpacks to more than is read, or refers to other files.
    """
    otherwise = "export it with `save(name, '-v7')` from MATLAB, or as CSV"
    h5py = _library("h5py", "an HDF5 or MATLAB 7.3 file", "hdf5", otherwise)
    with _damaged_unless("an HDF5 file"), h5py.File(path, "r") as file:
        is_matlab = file.userblock_size > 0
        items: list[tuple[tuple[str, ...], Any]] = []
        links: list[tuple[tuple[str, ...], Any]] = []
        _collect(h5py, file, (), {h5py.h5o.get_info(file.id).addr}, items, links)
        # no link leads out of the file, or that would have been found
        targets = [(place, group.get(place[-1])) for place, group in links]
        items += [(place, target) for place, target in targets if isinstance(target, h5py.Dataset)]
        data = [(place, item) for place, item in items if item.dtype.kind in "fiuV" and "units" not in place]
        require_size(sum(item.size * max(1, len(item.dtype.names or ())) for _, item in data))
        texts = {place: item for place, item in items if "units" in place and item.size <= MAX_UNIT}
        vectors = []
        for place, item in data:
            name = ".".join(place) if is_matlab else place[-1]
            kind = _text(item.attrs.get("MATLAB_class"))
            if "MATLAB_object_decode" in item.attrs:
                report(0, _matlab_object(name))
            if "MATLAB_object_decode" in item.attrs or kind in ("char", "cell"):
                continue
            group = "" if is_matlab else "/".join(place[:-1])
            beside = texts.get(("units", *place) if is_matlab else (*place[:-1], "units", place[-1]))
            stated = next((item.attrs[a] for a in UNIT_ATTRIBUTES if a in item.attrs), None)
            unit = _text(stated if beside is None else beside[()])
            for own, values in _vectors_of(name, item[()], report):
                vectors.append(_Vector(group, own, unit, values))
    return _tables_of(vectors)


def _collect(h5py: ModuleType, group: Any, place: tuple[str, ...], seen: set[int], items: list, links: list) -> None:
    """Collect the datasets below a group with their places, and the links inside the file.

    Raises:
        TableError: something is kept in another file.
    """
    for name in group:
        own, link = (*place, name), group.get(name, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            raise _elsewhere(own, f"is a link to {link.filename}")
        if isinstance(link, h5py.SoftLink):
            links.append((own, group))
            continue
        item = group[name]
        if isinstance(item, h5py.Dataset):
            if item.is_virtual:
                raise _elsewhere(own, "is a virtual dataset")
            if item.external:
                raise _elsewhere(own, f"is kept in {item.external[0][0]}")
            items.append((own, item))
        elif isinstance(item, h5py.Group) and not name.startswith("#"):  # where MATLAB keeps what others refer to
            address = h5py.h5o.get_info(item.id).addr
            if address not in seen:
                seen.add(address)
                _collect(h5py, item, own, seen, items, links)


def _elsewhere(place: tuple[str, ...], what: str) -> TableError:
    return TableError(0, f"`{'/'.join(place)}` {what}; no other file is read: store the numbers in this one (h5repack)")


def read_tdms_tables(path: Path, layout: Layout, report: Report) -> list[Table]:
    """Read the channels of a TDMS file; time stamps that the channels of a group imply become its column `time [s]`.

    Raises:
        TableError: nptdms is not installed, the file is damaged, or unpacks to more than is read.
    """
    nptdms = _library("nptdms", "a TDMS file of LabVIEW", "tdms", "export it as CSV")
    vectors: list[_Vector] = []
    with _damaged_unless("a TDMS file"), nptdms.TdmsFile.open(path) as file:
        require_size(sum(len(channel) for group in file.groups() for channel in group.channels()))
        for group in file.groups():
            channels = [(c, c[:]) for c in group.channels() if c.data_type is not None]
            stamped = {len(channel) for channel, _ in channels if channel.name == TIME}
            for channel, data in channels:
                unit = next((channel.properties[p] for p in TDMS_UNITS if channel.properties.get(p)), "")
                for name, values in _vectors_of(channel.name, data, report):
                    unit = "s" if data.dtype.kind == "M" else _text(unit)
                    vectors.append(_Vector(group.name, name, unit, values))
                step = channel.properties.get("wf_increment")
                if len(channel) not in stamped and step and data.dtype.kind in "fiu":
                    first = float(channel.properties.get("wf_start_offset", 0.0))
                    vectors.append(_Vector(group.name, TIME, "s", first + float(step) * np.arange(len(channel))))
                    stamped.add(len(channel))
    return _tables_of(vectors)


def read_mdf_tables(path: Path, layout: Layout, report: Report) -> list[Table]:
    """Read the channels of an MDF file (`.mf4`): a table for all with the same time stamps, with these as `time [s]`.

    Raises:
        TableError: asammdf is not installed, the file is damaged, or unpacks to more than is read.
    """
    asammdf = _library("asammdf", "an MDF file", "mdf", "export it as CSV")
    with _damaged_unless("an MDF file"), asammdf.MDF(path) as file:
        require_size(sum(group.channel_group.cycles_nr * len(group.channels) for group in file.groups))
        signals = [signal for signal in file.iter_channels() if np.asarray(signal.samples).dtype.kind in "fiu"]
    vectors: dict[tuple[str, str], _Vector] = {}
    clocks: dict[bytes, str] = {}
    for signal in signals:
        stamps = np.asarray(signal.timestamps, float)
        clock = clocks.setdefault(stamps.tobytes(), str(len(clocks) + 1))
        vectors.setdefault((clock, TIME), _Vector(clock, TIME, "s", stamps))
        if (clock, signal.name) in vectors:
            report(0, f"there is another channel `{signal.name}`; it is left out")
        else:
            values = np.asarray(signal.samples, float)
            vectors[clock, signal.name] = _Vector(clock, signal.name, _text(signal.unit), values)
    return _tables_of(list(vectors.values()))


def read_excel_tables(path: Path, layout: Layout, report: Report) -> list[Table]:
    """Read the table on a sheet of an Excel file: the stated one, otherwise the first that holds a table.

    Raises:
        TableError: openpyxl is not installed, the file is damaged or too large, or there is no such sheet or no table.
    """
    openpyxl = _library("openpyxl", "an Excel file", "excel", "save it as CSV")
    with _damaged_unless("an Excel file"), path.open("rb") as file:
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
                return [_table_of_rows(rows, layout)]
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


def _table_of_rows(rows: list[Row], layout: Layout) -> Table:
    """The table in the rows of a sheet."""
    sample = [cells for _, cells in rows[:: max(1, len(rows) // SAMPLED_ROWS)]]
    header = find_header(rows, sample, "cells")
    mark = layout.decimal or decimal_mark([cell for cells in sample for cell in cells])
    body = rows[header.first :]
    lines = np.array([line for line, _ in body])
    columns = {}
    for (name, unit), cells in zip(header.names, zip(*(cells for _, cells in body), strict=True), strict=True):
        if name:
            columns[name] = read_column(name, unit, cells, lines, mark, bool(layout.decimal))
    return Table(columns, lines, header.line)


def _excel_cell(value: object) -> Cell:
    """A cell as number, date, text or None."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if value is None or isinstance(value, datetime.datetime | datetime.time | datetime.timedelta):
        return value
    return str(value)
