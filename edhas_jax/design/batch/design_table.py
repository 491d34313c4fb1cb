"""Tables of designs: names of their columns, and files of parameter values."""

from pathlib import Path

import numpy as np

from edhas_jax.config.tables.table import TableError
from edhas_jax.config.tables.table_reader import CompleteTable
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
    """Read the designs in a table: a column `name [unit]` per parameter, a row per design.

    Args:
        path: the file: CSV, Parquet, Excel or another format of a recorder.
        machine: the machine that owns the parameters.

    Returns:
        By parameter a column of values (SI), shape (designs,).

    Raises:
        DesignError: no such file, a column that is no parameter of this machine, a missing value, or one outside the
            allowed span.
    """
    path = Path(path)
    try:
        table = CompleteTable(path)
        table.require_all_columns()
        found = [(name, unit, table.values(name)) for name, unit in table.units.items()]
    except TableError as error:
        raise DesignError(error.at(path)) from None
    if not len(table):
        raise DesignError(f"{path}: has no rows")
    if len(table) > MAX_DESIGNS:
        raise DesignError(f"{path}: has {len(table):,} designs; at most {MAX_DESIGNS:,}")
    columns: dict[str, np.ndarray] = {}
    for name, unit, values in found:
        cell = table.header(name)
        try:
            p, column = resolve_parameter(machine, name)
            usual = format_quantity(p.default, p.unit).partition(" ")[2] or "-"
            one = to_si(f"1 {unit}", p.unit, f"{name} [{usual}]")
            zero = to_si(f"0 {unit}", p.unit)
        except (ParameterError, UnitError) as error:
            raise DesignError(f"{path}: column `{cell}`: {error}") from None
        if column in columns:
            raise DesignError(f"{path}: column `{cell}`: {column} has a column already")
        scale = one - zero
        # division by the integer gives the same floating-point number as the literal 20e-6 for 20 µm; a product may not
        values = values / round(1 / scale) if scale < 0.7 and not zero else zero + values * scale
        low, high = p.span
        invalid = ~((low <= values) & (values <= high))
        if invalid.any():
            row = int(np.argmax(invalid))
            got = format_quantity(values[row], p.unit)
            raise DesignError(f"{table.place(row)}: {column} must lie in {format_span(p)} ({p.doc}); got {got}")
        columns[column] = values
    return columns
