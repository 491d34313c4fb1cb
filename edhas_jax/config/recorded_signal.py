"""A recorded signal: read from a column of a CSV or Parquet file, or packed into a text."""

import base64
import csv
import math
import zlib
from collections.abc import Mapping
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from edhas_jax.core.names import nearest
from edhas_jax.core.units import UnitError, exact_quantity, format_quantity, to_si
from edhas_jax.machine.components.set_points import Recorded

RECORDING_KEYS = ("kind", "file", "column", "unit", "samples", "interval", "start")
MAX_SAMPLES = 20_000_000


class RecordingError(Exception):
    """A recording is of no use; `key` is the key of its section that is to blame."""

    def __init__(self, key: str, what: str):
        super().__init__(what)
        self.key = key


def read_recording(path: Path, column: str | None, unit: str | None, wanted: str, gain: float | None) -> Recorded:
    """A column of a CSV or Parquet file whose columns are named `name [unit]`, as an input in SI unit `wanted`.

    Samples at unequal steps (more than 1e-6 apart) are brought to the median step by PCHIP. With a `gain` [A/V],
    amperes are accepted and divided by it.
    """
    if not path.is_file():
        raise RecordingError("file", f"{path}: no such file")
    if path.suffix not in (".csv", ".parquet"):
        raise RecordingError("file", f"{path}: a file .csv or .parquet is needed")
    header = _header(path)
    named = [h.partition("[")[0].strip() for h in header]
    names = dict(zip(named, header, strict=True))
    if "time" not in names:
        raise RecordingError("file", f"{path}: no column `time [s]`; the columns: {', '.join(header)}")
    others = [n for n in names if n != "time"]
    if column is None and len(others) == 1:
        column = others[0]
    if column is None:
        raise RecordingError("column", f"missing; {path} has the columns {', '.join(others) or 'time only'}")
    if column not in others:
        raise RecordingError("column", f"{path} has no column `{column}`; {nearest(column, others)}")
    twice = next((n for n in ("time", column) if named.count(n) > 1), None)
    if twice:
        raise RecordingError("file", f"{path}: has several columns `{twice}`; name each differently")
    size = _column_size(path, names[column], column, unit, wanted, gain)
    try:
        time, values = _samples(path, header, [names["time"], names[column]])
    except (ValueError, OSError, csv.Error) as error:
        raise _unreadable(path, error) from None
    try:
        time = time * to_si(f"1 {_unit_of(names['time'])}", "s", "1 ms")
    except UnitError:
        raise RecordingError("file", f"{path}: the header of the time column must be `time [s]`") from None
    return resample_uniformly(path, time, values * size)


def _header(path: Path) -> list[str]:
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
    if path.suffix == ".parquet":
        return RecordingError("file", f"{path}: is damaged or not a Parquet file")
    reason = "not a text file in UTF-8" if isinstance(error, UnicodeDecodeError) else str(error).splitlines()[0]
    return RecordingError("file", f"{path}: cannot be read as CSV ({reason})")


def _unit_of(cell: str) -> str:
    return cell.partition("[")[2].rstrip("] ").strip()


def _column_size(path: Path, cell: str, column: str, unit: str | None, wanted: str, gain: float | None) -> float:
    """The SI value of one unit of a column."""
    written = _unit_of(cell)
    if written and unit and _bare(written) != _bare(unit):
        raise RecordingError("unit", f"{path} gives `{cell}`, but the unit here is {unit}; leave it out")
    unit = written or unit
    kind = {"m": "a length (mm)", "V": "a voltage (V)" if gain is None else "a voltage (V) or a current (A)"}[wanted]
    if not unit:
        raise RecordingError("unit", f"missing; {path} gives no unit for `{column}`, and {kind} is needed")
    for si, factor in ((wanted, 1.0), *([] if gain is None else [("A", gain)])):
        try:
            size = to_si(f"1 {unit}", si)
        except UnitError:
            continue
        if factor == 0.0:
            raise RecordingError("column", f"{path}: `{cell}` is a current, but amplifier_gain is 0 A/V")
        return size / factor
    raise RecordingError("column", f"{path}: `{column}` has the unit {unit}, but {kind} is needed")


def _bare(unit: str) -> str:
    """A unit text without the differences that do not matter."""
    return unit.replace(" ", "").replace("μ", "µ").replace("^", "")


def _samples(path: Path, header: list[str], wanted: list[str]) -> list[np.ndarray]:
    if path.suffix == ".parquet":
        import pandas as pd

        frame = pd.read_parquet(path, columns=wanted)
        try:
            return [frame[name].to_numpy(float) for name in wanted]
        except (TypeError, ValueError):
            raise RecordingError("file", f"{path}: `{wanted[0]}` and `{wanted[1]}` must hold numbers") from None
    at = [header.index(name) for name in wanted]
    rows = []
    with path.open(encoding="utf-8-sig", newline="") as file:
        reader = csv.reader(file)
        next(reader)
        for row in reader:
            if not row:
                continue
            if len(row) != len(header):
                cut = "; the file seems to be cut off" if len(row) < len(header) else ""
                what = f"{len(row)} values where the header has {len(header)}{cut}"
                raise RecordingError("file", f"{path}:{reader.line_num}: {what}")
            rows.append([_number(row[i], path, reader.line_num) for i in at])
    with path.open("rb") as file:
        file.seek(-1, 2)
        if file.read(1) not in b"\r\n":
            # "0.0123" cut to "0.0" would pass for a sample
            raise RecordingError("file", f"{path}: the last line has no end; the file seems to be cut off "
                                          "(add a line end if it is complete)")  # fmt: skip
    return list(np.asarray(rows, float).reshape(-1, 2).T)


def _number(text: str, path: Path, line: int) -> float:
    try:
        return float(text)
    except ValueError:
        raise RecordingError("file", f'{path}:{line}: "{text}" is not a number') from None


def resample_uniformly(path: Path, time: np.ndarray, values: np.ndarray) -> Recorded:
    """The samples at equal steps."""
    if len(time) < 2:
        raise RecordingError("file", f"{path}: at least 2 samples are needed; there are {len(time)}")
    bad = ~(np.isfinite(time) & np.isfinite(values))
    if bad.any():
        raise RecordingError("file", f"{path}: sample {int(np.argmax(bad)) + 1} is not a finite number (NaN or inf)")
    steps = np.diff(time)
    if not (steps > 0.0).all():
        k = int(np.argmax(steps <= 0.0)) + 1
        raise RecordingError("file", f"{path}: time must increase, but sample {k + 1} ({time[k]:g} s) does not come "
                                      f"after sample {k} ({time[k - 1]:g} s)")  # fmt: skip
    interval = float(np.median(steps))
    if np.abs(steps - interval).max() <= 1e-6 * interval:
        interval = float((time[-1] - time[0]) / (len(time) - 1))
    else:
        from scipy.interpolate import PchipInterpolator

        count = math.floor((time[-1] - time[0]) / interval * (1.0 + 1e-9)) + 1
        if count > MAX_SAMPLES:
            raise RecordingError("file", f"{path}: time has gaps too long to fill at the median step of "
                                          f"{format_quantity(interval, 's')}")  # fmt: skip
        even = np.minimum(time[0] + interval * np.arange(count), time[-1])
        values = PchipInterpolator(time, values)(even)
        if count < 2:
            raise RecordingError("file", f"{path}: the time steps are too unequal to be brought to one step")
    return Recorded(values=jnp.asarray(values), interval=interval, start=float(time[0]))


def encode_samples(recorded: Recorded) -> dict[str, str]:
    """Samples that no file is known to hold, as keys of a section: SI, compressed little-endian float64."""
    data = base64.b64encode(zlib.compress(np.asarray(recorded.values, "<f8").tobytes())).decode()
    interval, start = exact_quantity(recorded.interval, "s"), exact_quantity(recorded.start, "s")
    return {"interval": interval, "start": start, "samples": data}


def decode_samples(keys: Mapping[str, str]) -> Recorded:
    """What `pack` has packed."""
    wrong = RecordingError("samples", "not as a run writes them (samples, interval, start); give a file")
    try:
        values = np.frombuffer(zlib.decompress(base64.b64decode(keys["samples"], validate=True)), "<f8")
        interval, start = to_si(keys.get("interval", ""), "s"), to_si(keys.get("start", "0 s"), "s")
    except (ValueError, zlib.error):
        raise wrong from None
    if "file" in keys or len(values) < 2 or not np.isfinite(values).all() or not interval > 0.0:
        raise wrong
    return Recorded(values=jnp.asarray(values), interval=interval, start=start)
