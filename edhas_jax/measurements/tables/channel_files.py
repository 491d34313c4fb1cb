"""Read a table from a file of channels: HDF5 and MATLAB 7.3, TDMS of LabVIEW, MDF of measurement systems."""

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from edhas_jax.measurements.tables.binary_reading import damaged_unless, reader_library
from edhas_jax.measurements.tables.table import (
    TIME,
    Layout,
    Report,
    Table,
    TableError,
    Vector,
    flat_vectors,
    matlab_object,
    require_size,
    tables_of_vectors,
)

UNIT_ATTRIBUTES = ("unit", "units", "Unit", "Units")  # of a dataset of HDF5
MAX_UNIT = 100  # characters of a unit
TDMS_UNITS = ("unit_string", "NI_UnitDescription", "unit")  # properties of a channel of TDMS


def read_hdf5_tables(path: Path, layout: Layout, report: Report) -> list[Table]:
    """Read vectors and matrices from an HDF5 or MATLAB 7.3 file; as units attributes, or a struct `units` of texts.

    Raises:
        TableError: h5py is not installed, the file is damaged, unpacks to more than is read, or refers to other files.
    """
    otherwise = "export it with `save(name, '-v7')` from MATLAB, or as CSV"
    h5py = reader_library("h5py", "an HDF5 or MATLAB 7.3 file", "hdf5", otherwise)
    with damaged_unless("an HDF5 file"), h5py.File(path, "r") as file:
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
                report(0, matlab_object(name))
            if "MATLAB_object_decode" in item.attrs or kind in ("char", "cell"):
                continue
            group = "" if is_matlab else "/".join(place[:-1])
            beside = texts.get(("units", *place) if is_matlab else (*place[:-1], "units", place[-1]))
            stated = next((item.attrs[a] for a in UNIT_ATTRIBUTES if a in item.attrs), None)
            unit = _text(stated if beside is None else beside[()])
            for own, values in flat_vectors(name, item[()], report):
                vectors.append(Vector(group, own, unit, values))
    return tables_of_vectors(vectors)


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
    nptdms = reader_library("nptdms", "a TDMS file of LabVIEW", "tdms", "export it as CSV")
    vectors: list[Vector] = []
    with damaged_unless("a TDMS file"), nptdms.TdmsFile.open(path) as file:
        require_size(sum(len(channel) for group in file.groups() for channel in group.channels()))
        for group in file.groups():
            channels = [(c, c[:]) for c in group.channels() if c.data_type is not None]
            stamped = {len(channel) for channel, _ in channels if channel.name == TIME}
            for channel, data in channels:
                unit = next((channel.properties[p] for p in TDMS_UNITS if channel.properties.get(p)), "")
                for name, values in flat_vectors(channel.name, data, report):
                    unit = "s" if data.dtype.kind == "M" else _text(unit)
                    vectors.append(Vector(group.name, name, unit, values))
                step = channel.properties.get("wf_increment")
                if len(channel) not in stamped and step and data.dtype.kind in "fiu":
                    first = float(channel.properties.get("wf_start_offset", 0.0))
                    vectors.append(Vector(group.name, TIME, "s", first + float(step) * np.arange(len(channel))))
                    stamped.add(len(channel))
    return tables_of_vectors(vectors)


def read_mdf_tables(path: Path, layout: Layout, report: Report) -> list[Table]:
    """Read the channels of an MDF file (`.mf4`): a table for all with the same time stamps, with these as `time [s]`.

    Raises:
        TableError: asammdf is not installed, the file is damaged, or unpacks to more than is read.
    """
    asammdf = reader_library("asammdf", "an MDF file", "mdf", "export it as CSV")
    with damaged_unless("an MDF file"), asammdf.MDF(path) as file:
        require_size(sum(group.channel_group.cycles_nr * len(group.channels) for group in file.groups))
        signals = [signal for signal in file.iter_channels() if np.asarray(signal.samples).dtype.kind in "fiu"]
    vectors: dict[tuple[str, str], Vector] = {}
    clocks: dict[bytes, str] = {}
    for signal in signals:
        stamps = np.asarray(signal.timestamps, float)
        clock = clocks.setdefault(stamps.tobytes(), str(len(clocks) + 1))
        vectors.setdefault((clock, TIME), Vector(clock, TIME, "s", stamps))
        if (clock, signal.name) in vectors:
            report(0, f"there is another channel `{signal.name}`; it is left out")
        else:
            values = np.asarray(signal.samples, float)
            vectors[clock, signal.name] = Vector(clock, signal.name, _text(signal.unit), values)
    return tables_of_vectors(list(vectors.values()))


def _text(value: Any) -> str:
    """A text of HDF5: as such, as bytes, or as the character codes of MATLAB."""
    if value is None:
        return ""
    if isinstance(value, np.ndarray) and value.dtype.kind in "ui":
        return "".join(map(chr, np.ravel(value)))
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.ravel()[0]
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
