"""Recorded input signals: read from a column of a CSV or Parquet file, or encoded as text in a configuration."""

import base64
import csv
import math
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.units import UnitError, exact_quantity, format_quantity, to_si
from edhas_jax.machine.components.set_points import Recorded

RECORDING_KEYS = ("kind", "file", "column", "unit", "samples", "interval", "start")
MAX_SAMPLES = 20_000_000
STEP_TOLERANCE = 1e-6  # relative; sampling steps that differ by more count as unequal


class RecordingError(Exception):
    """A recording cannot be used; `key` is the key of its section that causes it."""

    def __init__(self, key: str, message: str):
        super().__init__(message)
        self.key = key


def read_recording(path: Path, column: str | None, unit: str | None, si_unit: str, gain: float | None) -> Recorded:
    """Read an input signal from a column of a CSV or Parquet file whose columns are named `name [unit]`.

    Args:
        path: the file; its time column is `time [s]` or in another unit of time.
        column: name of the column; None if the file has only one besides the time.
        unit: unit of the column; None if the header states it.
        si_unit: "m" for a set point, "V" for a command.
        gain: gain of a current amplifier [A/V]; a column of currents is then accepted as well and divided by the gain.

    Returns:
        The samples in `si_unit` at a constant step, see `resample_uniformly`.

    Raises:
        RecordingError: the file cannot be read, the column or its unit is missing or wrong, or samples are invalid.
    """
    if not path.is_file():
        raise RecordingError("file", f"{path}: no such file")
    if path.suffix not in (".csv", ".parquet"):
        raise RecordingError("file", f"{path}: a file .csv or .parquet is needed")
    header = _header(path)
    names = [h.partition("[")[0].strip() for h in header]
    header_of = dict(zip(names, header, strict=True))
    if "time" not in header_of:
        raise RecordingError("file", f"{path}: no column `time [s]`; the columns: {', '.join(header)}")
    others = [n for n in header_of if n != "time"]
    if column is None and len(others) == 1:
        column = others[0]
    if column is None:
        raise RecordingError("column", f"missing; {path} has the columns {', '.join(others) or 'time only'}")
    if column not in others:
        raise RecordingError("column", f"{path} has no column `{column}`; {suggest(column, others)}")
    repeated = next((n for n in ("time", column) if names.count(n) > 1), None)
    if repeated:
        raise RecordingError("file", f"{path}: has several columns `{repeated}`; name each differently")
    scale = _si_scale(path, header_of[column], column, unit, si_unit, gain)
    try:
        time, values = _read_columns(path, header, [header_of["time"], header_of[column]])
    except (ValueError, OSError, csv.Error) as error:
        raise _unreadable(path, error) from None
    try:
        time = time * to_si(f"1 {_unit_in_header(header_of['time'])}", "s", "1 ms")
    except UnitError:
        raise RecordingError("file", f"{path}: the header of the time column must be `time [s]`") from None
    return resample_uniformly(path, time, values * scale)


def _header(path: Path) -> list[str]:
    """The column headers of a file."""
    try:
        if path.suffix == ".parquet":
            import pyarrow.parquet

            return list(pyarrow.parquet.read_schema(path).names)
        with path.open(encoding="utf-8-sig", newline="") as file:
            header = [cell.strip() for cell in next(csv.reader(file), [])]
    except (ValueError, OSError, csv.Error) as error:
        raise _unreadable(path, error) from None
    if not header:
        raise RecordingError("file", f"{path}: is empty")
    if len(header) == 1 and ";" in header[0]:
        raise RecordingError("file", f"{path}:1: columns must be separated by commas, not semicolons")
    return header


def _unreadable(path: Path, error: Exception) -> RecordingError:
    """The error for a file that could not be read, with the reason."""
    if path.suffix == ".parquet":
        return RecordingError("file", f"{path}: is damaged or not a Parquet file")
    reason = "not a text file in UTF-8" if isinstance(error, UnicodeDecodeError) else str(error).splitlines()[0]
    return RecordingError("file", f"{path}: cannot be read as CSV ({reason})")


def _unit_in_header(header: str) -> str:
    """The unit in a header `name [unit]`; empty without one."""
    return header.partition("[")[2].rstrip("] ").strip()


def _si_scale(path: Path, header: str, column: str, unit: str | None, si_unit: str, gain: float | None) -> float:
    """The factor from the unit of a column to `si_unit`."""
    header_unit = _unit_in_header(header)
    if header_unit and unit and _normalised_unit(header_unit) != _normalised_unit(unit):
        raise RecordingError("unit", f"the header in {path} is `{header}`, but `unit` is {unit}; leave `unit` out")
    unit = header_unit or unit
    kind = {"m": "a length (mm)", "V": "a voltage (V)" if gain is None else "a voltage (V) or a current (A)"}[si_unit]
    if not unit:
        raise RecordingError("unit", f"missing; {path} gives no unit for `{column}`, and {kind} is needed")
    for accepted, factor in ((si_unit, 1.0), *([] if gain is None else [("A", gain)])):
        try:
            scale = to_si(f"1 {unit}", accepted)
        except UnitError:
            continue
        if factor == 0.0:
            raise RecordingError("column", f"{path}: `{header}` is a current, but amplifier_gain is 0 A/V")
        return scale / factor
    raise RecordingError("column", f"{path}: `{column}` has the unit {unit}, but {kind} is needed")


def _normalised_unit(unit: str) -> str:
    """A unit without spaces and carets and with one form of µ, for comparison."""
    return unit.replace(" ", "").replace("μ", "µ").replace("^", "")


def _read_columns(path: Path, header: list[str], columns: list[str]) -> list[np.ndarray]:
    """Two columns of a file as numbers, in the units of the file."""
    if path.suffix == ".parquet":
        import pandas as pd

        frame = pd.read_parquet(path, columns=columns)
        try:
            return [frame[name].to_numpy(float) for name in columns]
        except (TypeError, ValueError):
            raise RecordingError("file", f"{path}: `{columns[0]}` and `{columns[1]}` must hold numbers") from None
    indices = [header.index(name) for name in columns]
    rows = []
    with path.open(encoding="utf-8-sig", newline="") as file:
        reader = csv.reader(file)
        next(reader)
        for row in reader:
            if not row:
                continue
            if len(row) != len(header):
                cut = "; the file seems to be cut off" if len(row) < len(header) else ""
                message = f"{len(row)} values where the header has {len(header)}{cut}"
                raise RecordingError("file", f"{path}:{reader.line_num}: {message}")
            rows.append([_number(row[i], path, reader.line_num) for i in indices])
    with path.open("rb") as file:
        file.seek(-1, 2)
        if file.read(1) not in b"\r\n":
            # "0.0123" cut off as "0.0" would be read as a valid sample
            raise RecordingError("file", f"{path}: the last line has no end; the file seems to be cut off "
                                          "(add a line end if it is complete)")  # fmt: skip
    return list(np.asarray(rows, float).reshape(-1, 2).T)


def _number(text: str, path: Path, line: int) -> float:
    try:
        return float(text)
    except ValueError:
        raise RecordingError("file", f'{path}:{line}: "{text}" is not a number') from None


def resample_uniformly(path: Path, time: np.ndarray, values: np.ndarray) -> Recorded:
    """Check samples and bring them to a constant step.

    Samples at unequal steps are interpolated at the median step by a monotone cubic (PCHIP).

    Args:
        path: the file they come from, for messages.
        time: sampling times [s], shape (samples,).
        values: samples in SI units, shape (samples,).

    Returns:
        The signal with its step [s] and the time of the first sample [s].

    Raises:
        RecordingError: fewer than 2 samples, a value that is not finite, a time that does not increase, or gaps too
            long to fill.
    """
    if len(time) < 2:
        raise RecordingError("file", f"{path}: at least 2 samples are needed; there are {len(time)}")
    invalid = ~(np.isfinite(time) & np.isfinite(values))
    if invalid.any():
        number = int(np.argmax(invalid)) + 1
        raise RecordingError("file", f"{path}: sample {number} is not a finite number (NaN or inf)")
    steps = np.diff(time)
    if not (steps > 0.0).all():
        k = int(np.argmax(steps <= 0.0)) + 1
        raise RecordingError("file", f"{path}: time must increase, but sample {k + 1} ({time[k]:g} s) does not come "
                                      f"after sample {k} ({time[k - 1]:g} s)")  # fmt: skip
    interval = float(np.median(steps))
    if np.abs(steps - interval).max() <= STEP_TOLERANCE * interval:
        interval = float((time[-1] - time[0]) / (len(time) - 1))
    else:
        from scipy.interpolate import PchipInterpolator

        count = math.floor((time[-1] - time[0]) / interval * (1.0 + 1e-9)) + 1
        if count > MAX_SAMPLES:
            raise RecordingError("file", f"{path}: time has gaps too long to fill at the median step of "
                                          f"{format_quantity(interval, 's')}")  # fmt: skip
        uniform_time = np.minimum(time[0] + interval * np.arange(count), time[-1])
        values = PchipInterpolator(time, values)(uniform_time)
        if count < 2:
            raise RecordingError("file", f"{path}: the time steps are too unequal to be brought to one step")
    return Recorded(values=np.asarray(values, float), interval=interval, start=float(time[0]))


def encode_samples(recorded: Recorded) -> dict[str, str]:
    """Encode a signal as keys of a section of a configuration.

    Returns:
        `samples` (SI values as little-endian float64, compressed, base64), `interval` and `start` with units.
    """
    data = base64.b64encode(zlib.compress(np.asarray(recorded.values, "<f8").tobytes())).decode()
    interval, start = exact_quantity(recorded.interval, "s"), exact_quantity(recorded.start, "s")
    return {"interval": interval, "start": start, "samples": data}


def decode_samples(keys: Mapping[str, str]) -> Recorded:
    """Decode the keys that `encode_samples` made.

    Raises:
        RecordingError: the keys are incomplete or damaged, or a file is named as well.
    """
    invalid = RecordingError("samples", "not as a run writes them (samples, interval, start); give a file")
    try:
        unpacked = zlib.decompressobj()
        data = unpacked.decompress(base64.b64decode(keys["samples"], validate=True), 8 * MAX_SAMPLES + 1)
        if len(data) > 8 * MAX_SAMPLES:
            raise RecordingError("samples", f"there are more than {MAX_SAMPLES:,} of them, which is the most allowed")
        if not unpacked.eof or unpacked.unused_data:
            raise invalid
        values = np.frombuffer(data, "<f8")
        interval, start = to_si(keys.get("interval", ""), "s"), to_si(keys.get("start", "0 s"), "s")
    except (ValueError, zlib.error):
        raise invalid from None
    if "file" in keys or len(values) < 2 or not np.isfinite(values).all() or not interval > 0.0:
        raise invalid
    return Recorded(values=np.asarray(values, float), interval=interval, start=start)
