"""Read a table from a file of channels: HDF5 and MATLAB 7.3, TDMS of LabVIEW, MDF of measurement systems."""

import importlib
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from edhas_jax.measurements.tables.table import TIME, Report, Table, TableError, Vector, tables_of_vectors

UNIT_ATTRIBUTES = ("unit", "units", "Unit", "Units")  # of a dataset of HDF5
TDMS_UNITS = ("unit_string", "NI_UnitDescription", "unit")  # properties of a channel of TDMS


def read_hdf5_tables(path: Path, report: Report) -> list[Table]:
    """Read one vector per signal from an HDF5 or MATLAB 7.3 file; as units attributes, or a struct `units` of texts.

    Raises:
        TableError: h5py is not installed, or the file is damaged.
    """
    h5py = _reader("h5py", "an HDF5 or MATLAB 7.3 file", "hdf5", "`save(name, '-v7')` from MATLAB, or CSV")
    vectors: list[Vector] = []

    def read(group: Any, path: str) -> None:
        units = group["units"] if "units" in group and isinstance(group["units"], h5py.Group) else {}
        for name, item in group.items():
            if isinstance(item, h5py.Group) and name != "units" and not name.startswith("#"):  # of MATLAB
                read(item, f"{path}/{name}" if path else name)
            if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "fiu":
                continue
            stated = next((item.attrs[a] for a in UNIT_ATTRIBUTES if a in item.attrs), None)
            unit = _text(units[name][()] if name in units else stated)
            vectors.append(Vector(path, name, unit, np.ravel(item[()]).astype(float)))

    try:
        with h5py.File(path, "r") as file:
            read(file, "")
    except FileNotFoundError:
        raise
    except Exception:  # a damaged file raises whatever its bytes lead to
        raise TableError(0, "is damaged or not an HDF5 file") from None
    return tables_of_vectors(vectors)


def read_tdms_tables(path: Path, report: Report) -> list[Table]:
    """Read the channels of a TDMS file; time stamps that the channels of a group imply become its column `time [s]`.

    Raises:
        TableError: nptdms is not installed, or the file is damaged.
    """
    nptdms = _reader("nptdms", "a TDMS file of LabVIEW", "tdms", "CSV")
    vectors: list[Vector] = []
    try:
        for group in nptdms.TdmsFile.read(path).groups():
            channels = [c for c in group.channels() if c.data_type is not None and c[:].dtype.kind in "fiu"]
            stamped = {len(channel) for channel in channels if channel.name == TIME}
            for channel in channels:
                unit = next((channel.properties[p] for p in TDMS_UNITS if channel.properties.get(p)), "")
                vectors.append(Vector(group.name, channel.name, _text(unit), np.asarray(channel[:], float)))
                if len(channel) not in stamped and (step := channel.properties.get("wf_increment")):
                    first = float(channel.properties.get("wf_start_offset", 0.0))
                    vectors.append(Vector(group.name, TIME, "s", first + float(step) * np.arange(len(channel))))
                    stamped.add(len(channel))
    except Exception:  # a damaged file raises whatever its bytes lead to
        raise TableError(0, "is damaged or not a TDMS file") from None
    return tables_of_vectors(vectors)


def read_mdf_tables(path: Path, report: Report) -> list[Table]:
    """Read the channels of an MDF file (`.mf4`): a table for all with the same time stamps, with these as `time [s]`.

    Raises:
        TableError: asammdf is not installed, or the file is damaged.
    """
    asammdf = _reader("asammdf", "an MDF file", "mdf", "CSV")
    try:
        with asammdf.MDF(path) as file:
            signals = [signal for signal in file.iter_channels() if np.asarray(signal.samples).dtype.kind in "fiu"]
    except Exception:  # a damaged file raises whatever its bytes lead to
        raise TableError(0, "is damaged or not an MDF file") from None
    clocks: dict[bytes, str] = {}
    vectors: list[Vector] = []
    for signal in signals:
        stamps = np.asarray(signal.timestamps, float)
        key = stamps.tobytes()
        if key not in clocks:
            clocks[key] = str(len(clocks) + 1)
            vectors.append(Vector(clocks[key], TIME, "s", stamps))
        if any(vector.group == clocks[key] and vector.name == signal.name for vector in vectors):
            report(0, f"there is another channel `{signal.name}`; it is left out")
        else:
            vectors.append(Vector(clocks[key], signal.name, _text(signal.unit), np.asarray(signal.samples, float)))
    return tables_of_vectors(vectors)


def _reader(module: str, what: str, extra: str, otherwise: str) -> ModuleType:
    """The library that reads a format.

    Raises:
        TableError: it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        remedy = f"install what reads it: pip install 'edhas_jax[{extra}]'; or export it as {otherwise}"
        raise TableError(0, f"is {what}; {remedy}") from None


def _text(value: Any) -> str:
    """A text of HDF5: as such, as bytes, or as the character codes of MATLAB."""
    if value is None:
        return ""
    if isinstance(value, np.ndarray) and value.dtype.kind in "ui":
        return "".join(map(chr, np.ravel(value)))
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.ravel()[0]
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
