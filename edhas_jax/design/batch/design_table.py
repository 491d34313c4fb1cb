"""Tables of designs: names of their columns, and CSV or Parquet files of parameter values."""

import csv
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from edhas_jax.core.structs import Parameter
from edhas_jax.core.units import UnitError, format_quantity, to_si
from edhas_jax.design.batch.experiment_design import MAX_DESIGNS, DesignError
from edhas_jax.machine.parameters import ParameterError, find_parameter, format_span, list_parameters, short_names
from edhas_jax.machine.rigs import Rig


def resolve_parameter(machine: Rig, name: str) -> tuple[Parameter, str]:
    """Find a parameter that can be varied, and its column name in tables: the shortest unique one.

    Args:
        machine: the machine that owns the parameter.
        name: its name, with or without the owner.

    Returns:
        The parameter and its column name.

    Raises:
        ParameterError: the name is unknown or ambiguous, or is a result of a run and not a parameter.
    """
    flat = name.rpartition(".")[2]
    metrics, signals = machine.metrics, machine.signals
    if flat in metrics or flat in signals and flat not in (p.name for p, _, _ in list_parameters(machine)):
        what = f"a metric ({metrics[flat].doc})" if flat in metrics else f"a signal ({signals[flat].doc})"
        raise ParameterError(f"is {what}, a result of a run; only parameters can be varied")
    if flat == "ramp_time" and machine.cycle is not None:
        raise ParameterError("has no effect in a sweep: every design is run to its periodic state; leave it out")
    p, path = find_parameter(machine, name)
    return p, short_names(machine)[path, p.name]


def read_design_table(path: Path | str, machine: Rig) -> dict[str, np.ndarray]:
    """Read the designs in a CSV or Parquet file: a column `name [unit]` per parameter, a row per design.

    Args:
        path: the file.
        machine: the machine that owns the parameters.

    Returns:
        By parameter a column of values (SI), shape (designs,).

    Raises:
        DesignError: no such file, a column that is no parameter of this machine, a missing value, or one outside the
            allowed span.
    """
    path = Path(path)
    if not path.is_file():
        raise DesignError(f"{path}: no such file")
    if path.suffix not in (".csv", ".parquet"):
        raise DesignError(f"{path}: a file .csv or .parquet is needed")
    try:
        header, rows, place_of = _read_csv(path) if path.suffix == ".csv" else _read_parquet(path)
    except (OSError, csv.Error, UnicodeDecodeError) as error:
        raise DesignError(f"{path}: cannot be read as {path.suffix[1:]} ({str(error).splitlines()[0]})") from None
    if not len(rows):
        raise DesignError(f"{path}: has no rows")
    if len(rows) > MAX_DESIGNS:
        raise DesignError(f"{path}: has {len(rows):,} designs; at most {MAX_DESIGNS:,}")
    columns: dict[str, np.ndarray] = {}
    for i, cell in enumerate(header):
        name, unit = cell.partition("[")[0].strip(), cell.partition("[")[2].rstrip("] ").strip()
        try:
            p, column = resolve_parameter(machine, name)
            one = to_si(f"1 {unit}", p.unit, f"{name} [{_default_unit(p)}]")
            zero = to_si(f"0 {unit}", p.unit)
        except (ParameterError, UnitError) as error:
            raise DesignError(f"{path}: column `{cell}`: {error}") from None
        if column in columns:
            raise DesignError(f"{path}: column `{cell}`: {column} has a column already")
        values = rows[:, i]
        scale = one - zero
        # division by the integer gives the same floating-point number as the literal 20e-6 for 20 µm; a product may not
        values = values / round(1 / scale) if scale < 0.7 and not zero else zero + values * scale
        low, high = p.span
        invalid = ~((low <= values) & (values <= high))
        if invalid.any():
            row = int(np.argmax(invalid))
            got = format_quantity(values[row], p.unit)
            raise DesignError(f"{path}{place_of(row)}: {column} must lie in {format_span(p)} ({p.doc}); got {got}")
        columns[column] = values
    return columns


def _default_unit(p: Parameter) -> str:
    """The unit in which the default of a parameter is written."""
    return format_quantity(p.default, p.unit).partition(" ")[2] or "-"


def _read_csv(path: Path) -> tuple[list[str], np.ndarray, Callable[[int], str]]:
    """The header, the rows (designs, columns), and the place of a row as text."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        reader = csv.reader(file)
        header = [cell.strip() for cell in next(reader, [])]
        if not any(header):
            raise DesignError(f"{path}: is empty; the first line names the columns, such as `piston_clearance [um]`")
        if len(header) == 1 and ";" in header[0]:
            raise DesignError(f"{path}:1: columns must be separated by commas, not semicolons")
        rows, lines = [], []
        for row in reader:
            if not row:
                continue
            place = f"{path}:{reader.line_num}"
            if len(row) != len(header):
                raise DesignError(f"{place}: {len(row)} values where the header has {len(header)}")
            rows.append([_number(cell, place, name) for cell, name in zip(row, header, strict=True)])
            lines.append(reader.line_num)
    with path.open("rb") as file:
        file.seek(-1, 2)
        if rows and file.read(1) not in b"\r\n":
            # "20.5" cut off as "20." would be read as a valid number
            raise DesignError(f"{path}:{lines[-1]}: the last line has no end; the file seems to be cut off "
                              "(add a line end if it is complete)")  # fmt: skip
    return header, np.array(rows, float).reshape(len(rows), len(header)), lambda row: f":{lines[row]}"


def _number(text: str, place: str, name: str) -> float:
    if not text.strip():
        raise DesignError(f"{place}: column `{name}` has no value; every design needs one")
    try:
        value = float(text)
    except ValueError:
        raise DesignError(f'{place}: column `{name}`: "{text.strip()}" is not a number') from None
    if not math.isfinite(value):
        raise DesignError(f"{place}: column `{name}`: {text.strip()} is not a finite number")
    return value


def _read_parquet(path: Path) -> tuple[list[str], np.ndarray, Callable[[int], str]]:
    """The header, the rows (designs, columns), and the place of a row as text."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        data = pq.read_table(path)
    except (pa.ArrowException, ValueError):
        raise DesignError(f"{path}: is damaged or not a Parquet file") from None
    header, columns = [], []
    for i, field in enumerate(data.schema):
        unit = (field.metadata or {}).get(b"unit", b"").decode()
        header.append(field.name if "[" in field.name or unit in ("", "-") else f"{field.name} [{unit}]")
        if not (pa.types.is_floating(field.type) or pa.types.is_integer(field.type)):
            raise DesignError(f"{path}: column `{field.name}` must hold numbers")
        values = data.column(i).to_numpy().astype(float)
        if not np.isfinite(values).all():
            row = int(np.argmax(~np.isfinite(values))) + 1
            raise DesignError(f"{path}: row {row}: column `{field.name}` has a missing or infinite value")
        columns.append(values)
    rows = np.stack(columns, axis=1) if columns else np.zeros((0, 0))
    return header, rows, lambda row: f": row {row + 1}"
