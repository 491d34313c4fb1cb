"""Recorded input signals: read from a column of a table, or encoded as text in a configuration."""

import base64
import enum
import math
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import NoReturn

import numpy as np

from edhas_jax.config.declared_keys import Key, Keys, choice, own_value, text_value
from edhas_jax.config.tables.table import TIME, TableError
from edhas_jax.config.tables.table_reader import CompleteTable
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.units import UnitError, display_unit, exact_quantity, format_quantity, to_si
from edhas_jax.machine.components.set_points import Recorded, Steps

MAX_SAMPLES = 20_000_000
STEP_TOLERANCE = 1e-6  # relative; sampling steps that differ by more count as unequal


class RecordingError(Exception):
    """A recording cannot be used; `key` is the key of its section that causes it."""

    def __init__(self, key: str, message: str):
        super().__init__(message)
        self.key = key


class Between(enum.Enum):
    """What a recorded input does between two samples."""

    LINE = "line"  # goes from one to the other, smoothly
    HOLD = "hold"  # keeps the value of the first, as the set point of a computer


BETWEEN = Key(choice(Between), "what is between two samples: a smooth course, or the first of them", Between.LINE)
RECORDING = Keys({
    "kind": Key(own_value({"const": "recorded"}), ""),
    "file": Key(text_value(example="bench.csv"), "a table with headers `name [unit]` and a column `time [s]`"),
    "column": Key(text_value(), "its column, where it has several"),
    "unit": Key(text_value(), "of the column, where the header states none"),
    "between": BETWEEN,
    **{name: Key(text_value(), "as a run writes it") for name in ("samples", "interval", "start", "steps")},
}, "{kind: recorded, file: bench.csv}")  # fmt: skip


def read_recording(
    path: Path, column: str | None, unit: str | None, si_unit: str, gain: float | None, between: Between
) -> Recorded:
    """Read an input signal from a column of a table whose columns are named `name [unit]`.

    Args:
        path: the file, of any format of a recorder; its time column is `time [s]` or in another unit of time.
        column: name of the column; None if the file has only one besides the time.
        unit: unit of the column; None if the header states it.
        si_unit: SI unit of the drive.
        gain: gain of a current amplifier [A/V]; a column of currents is then accepted as well and divided by the gain.
        between: what the signal does between two samples.

    Returns:
        The signal in `si_unit`, see `recorded_from_samples`.

    Raises:
        RecordingError: the file cannot be read, the column or its unit is missing or wrong, or samples are invalid.
    """
    try:
        table = CompleteTable(path)
        chosen = _chosen_column(path, table, column)
        zero, size = _conversion(path, table, chosen, unit, si_unit, gain)
        time, values = table.values(TIME), table.values(chosen)
    except TableError as error:
        raise RecordingError("file", error.at(path)) from None
    try:
        time = time * to_si(f"1 {table.units[TIME]}", "s", "1 ms")
    except UnitError:
        raise RecordingError("file", f"{path}: the header of the time column must be `time [s]`") from None
    return recorded_from_samples(path, time, zero + size * values, between)


def _chosen_column(path: Path, table: CompleteTable, column: str | None) -> str:
    """The name of the column of a table that is wanted, or of the only one besides the time."""
    others = [name for name in table.units if name != TIME]
    if TIME not in table.units:
        columns = ", ".join(map(table.header, others))
        raise RecordingError("file", f"{path}: no column `time [s]`; the columns: {columns}")
    if column is None and len(others) == 1:
        column = others[0]
    if column is None:
        raise RecordingError("column", f"missing; {path} has the columns {', '.join(others) or 'time only'}")
    if column not in others:
        raise RecordingError("column", f"{path} has no column `{column}`; {suggest(column, others)}")
    return column


def _conversion(
    path: Path, table: CompleteTable, column: str, unit: str | None, si_unit: str, gain: float | None
) -> tuple[float, float]:
    """The SI value of 0 in the unit of a column, and of a difference of 1."""
    header, header_unit = table.header(column), table.units[column]
    if header_unit and unit and _normalised_unit(header_unit) != _normalised_unit(unit):
        raise RecordingError("unit", f"the header in {path} is `{header}`, but `unit` is {unit}; leave `unit` out")
    unit = header_unit or unit or ""
    usual = (display_unit(si_unit) or "-") + ("" if gain is None else " or A")
    if not unit and si_unit != "-":
        raise RecordingError("unit", f"missing; {path} gives no unit for `{column}`; one such as {usual} is needed")
    for accepted, factor in ((si_unit, 1.0), *([] if gain is None else [("A", gain)])):
        try:
            zero, one = (to_si(f"{number} {unit}", accepted) for number in (0, 1))
        except UnitError:
            continue
        if factor == 0.0:
            raise RecordingError("column", f"{path}: `{header}` is a current, but amplifier_gain is 0 A/V")
        return zero / factor, (one - zero) / factor
    raise RecordingError("column", f"{path}: `{column}` has the unit {unit}; one such as {usual} is needed")


def _normalised_unit(unit: str) -> str:
    """A unit without spaces and carets and with one form of µ, for comparison."""
    return unit.replace(" ", "").replace("μ", "µ").replace("^", "")


def recorded_from_samples(
    path: Path, time: np.ndarray, values: np.ndarray, between: Between = Between.LINE
) -> Recorded:
    """Check samples and make a recorded signal of them.

    Samples that follow each other at the same time are a step from the first of them to the last. Samples at unequal
    intervals are interpolated at the median interval by a monotone cubic (PCHIP), steps apart.

    Args:
        path: the file they come from, for messages.
        time: sampling times [s], shape (samples,).
        values: samples in SI units, shape (samples,).
        between: what the signal does between two samples.

    Returns:
        The signal with its interval [s] and the time of the first sample [s].

    Raises:
        RecordingError: fewer than 2 samples, a value that is not finite, a time that decreases, or gaps too long to
            fill.
    """

    def refuse(problem: str) -> NoReturn:
        raise RecordingError("file", f"{path}: {problem}")

    invalid = ~(np.isfinite(time) & np.isfinite(values))
    if invalid.any():
        refuse(f"sample {int(np.argmax(invalid)) + 1} is not a finite number (NaN or inf)")
    if (np.diff(time) < 0.0).any():
        k = int(np.argmax(np.diff(time) < 0.0)) + 1
        order = f"sample {k + 1} ({time[k]:g} s) does not come after sample {k} ({time[k - 1]:g} s)"
        refuse(f"time must increase, but {order}")
    time, first, count = np.unique(time, return_index=True, return_counts=True)
    if len(time) < 2:
        refuse(f"at least 2 samples are needed; there are {len(time)}")
    before, values = values[first], values[first + count - 1]
    if between is Between.HOLD:
        return Recorded.held(time, values)
    stepping = np.flatnonzero(values != before)
    level, steps = np.cumsum(values - before), None
    if len(stepping):
        steps, values = Steps(times=time[stepping], levels=np.append(0.0, level[stepping])), values - level
    interval = float(np.median(np.diff(time)))
    if np.abs(np.diff(time) - interval).max() <= STEP_TOLERANCE * interval:
        interval = float((time[-1] - time[0]) / (len(time) - 1))
    else:
        from scipy.interpolate import PchipInterpolator

        count = math.floor((time[-1] - time[0]) / interval * (1.0 + 1e-9)) + 1
        if count > MAX_SAMPLES:
            refuse(f"time has gaps too long to fill at the median step of {format_quantity(interval, 's')}")
        uniform_time = np.minimum(time[0] + interval * np.arange(count), time[-1])
        values = PchipInterpolator(time, values)(uniform_time)
        if count < 2:
            refuse("the time steps are too unequal to be brought to one step")
    return Recorded(values=np.asarray(values, float), interval=interval, start=float(time[0]), steps=steps)


def _packed(numbers: object) -> str:
    """Numbers as text: little-endian float64, compressed, base64."""
    return base64.b64encode(zlib.compress(np.asarray(numbers, "<f8").tobytes())).decode()


def encode_samples(recorded: Recorded) -> dict[str, str]:
    """Encode a signal as keys of a section of a configuration.

    Returns:
        `samples` (SI values), `interval` and `start` with units, and `steps` (times and levels) where it has any.
    """
    interval, start = exact_quantity(recorded.interval, "s"), exact_quantity(recorded.start, "s")
    keys = {"interval": interval, "start": start, "samples": _packed(recorded.values)}
    if recorded.steps is not None:
        keys["steps"] = _packed(np.concatenate([recorded.steps.times, recorded.steps.levels]))
    return keys


def decode_samples(keys: Mapping[str, str]) -> Recorded:
    """Decode the keys that `encode_samples` made.

    Raises:
        RecordingError: the keys are incomplete or damaged, or a file is named as well.
    """
    invalid = RecordingError("samples", "not as a run writes them (samples, interval, start, steps); give a file")
    try:
        values = _unpacked(keys["samples"])
        numbers = _unpacked(keys["steps"]) if "steps" in keys else None
        interval, start = to_si(keys.get("interval", ""), "s"), to_si(keys.get("start", "0 s"), "s")
    except (ValueError, zlib.error):
        raise invalid from None
    if {"file", "between"} & set(keys) or len(values) < 2 or not np.isfinite(values).all() or not interval > 0.0:
        raise invalid
    steps = None
    if numbers is not None:
        steps = Steps(times=numbers[: len(numbers) // 2], levels=numbers[len(numbers) // 2 :])
        is_ordered = np.isfinite(numbers).all() and (np.diff(steps.times) > 0.0).all()
        if len(numbers) < 3 or len(numbers) % 2 == 0 or not is_ordered:
            raise invalid
    return Recorded(values=values, interval=interval, start=start, steps=steps)


def _unpacked(text: str) -> np.ndarray:
    """The numbers of a text that `_packed` made.

    Raises:
        ValueError, zlib.error: it is damaged.
        RecordingError: there are too many of them.
    """
    unpacked = zlib.decompressobj()
    data = unpacked.decompress(base64.b64decode(text, validate=True), 8 * MAX_SAMPLES + 1)
    if len(data) > 8 * MAX_SAMPLES:
        raise RecordingError("samples", f"there are more than {MAX_SAMPLES:,} of them, which is the most allowed")
    if not unpacked.eof or unpacked.unused_data:
        raise ValueError("not one compressed text")
    return np.asarray(np.frombuffer(data, "<f8"), float)
