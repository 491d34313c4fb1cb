"""Read a table from a file of channels: HDF5 and MATLAB 7.3, TDMS of LabVIEW, MDF of measurement systems."""

import importlib
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from edhas_jax.measurements.tables.table import Report, Table, TableError, table_of_vectors

TIME = "time"  # the name of the time stamps that a file keeps apart from its channels
UNIT_ATTRIBUTES = ("unit", "units", "Unit", "Units")  # of a dataset of HDF5
TDMS_UNITS = ("unit_string", "NI_UnitDescription", "unit")  # properties of a channel of TDMS


def read_hdf5_table(path: Path, report: Report) -> Table:
    """Read one vector per signal from an HDF5 or MATLAB 7.3 file; as units attributes, or a struct `units` of texts.

    Raises:
        TableError: h5py is not installed, or the file is damaged.
    """
    h5py = _reader("h5py", "an HDF5 or MATLAB 7.3 file", "hdf5", "`save(name, '-v7')` from MATLAB, or CSV")
    try:
        with h5py.File(path, "r") as file:
            units = file["units"] if "units" in file and isinstance(file["units"], h5py.Group) else {}
            vectors = {}
            for name, item in file.items():
                if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "fiu":
                    continue
                stated = next((item.attrs[a] for a in UNIT_ATTRIBUTES if a in item.attrs), None)
                unit = _text(units[name][()] if name in units else stated)
                vectors[name] = unit, np.ravel(item[()]).astype(float)
    except FileNotFoundError:
        raise
    except Exception:  # a damaged file raises whatever its bytes lead to
        raise TableError(0, "is damaged or not an HDF5 file") from None
    return table_of_vectors(vectors, report)


def read_tdms_table(path: Path, report: Report) -> Table:
    """Read the channels of a TDMS file; time stamps that its channels imply become the column `time [s]`.

    Raises:
        TableError: nptdms is not installed, or the file is damaged.
    """
    nptdms = _reader("nptdms", "a TDMS file of LabVIEW", "tdms", "CSV")
    try:
        vectors: dict[str, tuple[str, np.ndarray]] = {}
        file = nptdms.TdmsFile.read(path)
        channels = [(group.name, channel) for group in file.groups() for channel in group.channels()]
        names = [channel.name for _, channel in channels]
        for group, channel in channels:
            if channel.data_type is None or np.asarray(channel[:]).dtype.kind not in "fiu":
                continue
            name = channel.name if names.count(channel.name) == 1 else f"{group}/{channel.name}"
            unit = next((channel.properties[p] for p in TDMS_UNITS if channel.properties.get(p)), "")
            vectors[name] = _text(unit), np.asarray(channel[:], float)
            if TIME not in names and TIME not in vectors and channel.properties.get("wf_increment"):
                vectors[TIME] = "s", np.asarray(channel.time_track(), float)
    except Exception:  # a damaged file raises whatever its bytes lead to
        raise TableError(0, "is damaged or not a TDMS file") from None
    return table_of_vectors(vectors, report)


def read_mdf_table(path: Path, report: Report) -> Table:
    """Read the channels of an MDF file (`.mf4`) that have the most frequent time stamps, with these as `time [s]`.

    Raises:
        TableError: asammdf is not installed, or the file is damaged.
    """
    asammdf = _reader("asammdf", "an MDF file", "mdf", "CSV")
    try:
        with asammdf.MDF(path) as file:
            signals = [signal for signal in file.iter_channels() if np.asarray(signal.samples).dtype.kind in "fiu"]
    except Exception:  # a damaged file raises whatever its bytes lead to
        raise TableError(0, "is damaged or not an MDF file") from None
    stamps = [np.asarray(signal.timestamps, float) for signal in signals]
    keys = [stamp.tobytes() for stamp in stamps]
    common = max(keys, key=keys.count, default=b"")
    vectors: dict[str, tuple[str, np.ndarray]] = {}
    for signal, stamp, key in zip(signals, stamps, keys, strict=True):
        if key != common:
            report(0, f"`{signal.name}` has other time stamps than most channels; it is left out")
        elif signal.name in vectors:
            report(0, f"there is another channel `{signal.name}`; it is left out")
        else:
            vectors.setdefault(TIME, ("s", stamp))
            vectors[signal.name] = _text(signal.unit), np.asarray(signal.samples, float)
    return table_of_vectors(vectors, report)


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
