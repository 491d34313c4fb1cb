"""A table of measured numbers: columns with their units, and the line of the file that each sample was read from."""

import dataclasses
from collections import Counter
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

TIME = "time"  # the name of the time stamps that a file keeps apart from its channels
MAX_NAMES = 8  # columns that a message names
Report = Callable[[int, str], None]  # called with the line, 0 for the file as a whole, and a sentence


class TableError(ValueError):
    """A file cannot be used at all; `line` is the line at fault, 0 for the file as a whole."""

    def __init__(self, line: int, sentence: str):
        super().__init__(sentence)
        self.line = line


@dataclasses.dataclass(frozen=True)
class Column:
    """The values (samples,) of a column as in the file, and the unit stated there ("" without one)."""

    unit: str
    values: np.ndarray


@dataclasses.dataclass(frozen=True)
class Table:
    """A table: columns over one time axis.

    Args:
        columns: the columns by name.
        lines: line (text) or row (others, from 1) of each sample (samples,).
        header_line: line that names the columns, 0 where the format has none.
        name: the group of channels in the file, "" where it has none.
    """

    columns: dict[str, Column]
    lines: np.ndarray
    header_line: int = 0
    name: str = ""

    def own_name(self, name: str) -> str | None:
        """The name of the column that `name` or `group/name` means; None if this table does not hold it."""
        if name in self.columns:
            return name
        own = name.removeprefix(f"{self.name}/")
        return own if self.name and own in self.columns else None


class Vector(NamedTuple):
    """A channel of a file: its group ("" without one), its name, which may have the unit in brackets, unit, values."""

    group: str
    name: str
    unit: str
    values: np.ndarray


def tables_of_vectors(vectors: Sequence[Vector]) -> list[Table]:
    """The tables of the channels of a file: one for each group and number of samples.

    Raises:
        TableError: two channels of a group have the same name.
    """
    names = {}
    for group in dict.fromkeys(vector.group for vector in vectors):
        own = [vector for vector in vectors if vector.group == group]
        names[group] = iter(names_and_units([vector.name for vector in own], [vector.unit for vector in own]))
    tables: dict[tuple[str, int], Table] = {}
    for vector in vectors:
        (name, unit), count = next(names[vector.group]), len(vector.values)
        table = tables.setdefault((vector.group, count), Table({}, np.arange(1, count + 1), name=vector.group))
        table.columns[name] = Column(unit, vector.values)
    return list(tables.values())


def joined(tables: Sequence[Table], report: Report) -> Table:
    """All tables that have as many samples as most columns, and the same time stamps, as one.

    A name that several of them have is `group/name`, unless the columns are the same.

    Args:
        tables: at least one table.
        report: called for what is left out.
    """
    if len(tables) == 1:
        return tables[0]
    counts = [len(table.lines) for table in tables for _ in table.columns]
    count = max(counts, key=counts.count, default=0)
    alike = [table for table in tables if len(table.lines) == count]
    main = max(alike, key=lambda table: len(table.columns))
    columns: dict[str, Column] = {}
    for table in tables:
        names = ", ".join(f"`{name}`" for name in list(table.columns)[:MAX_NAMES])
        verb, it = ("has", "it is") if len(table.columns) == 1 else ("have", "they are")
        if len(table.lines) != count:
            report(0, f"{names} {verb} {len(table.lines)} samples where others have {count}; {it} left out")
            continue
        if not _same(main.columns.get(TIME), table.columns.get(TIME)):
            report(0, f"{names} {verb} other time stamps than most channels; {it} left out")
            continue
        for name, column in table.columns.items():
            others = [other.columns[name] for other in alike if other is not table and name in other.columns]
            own = name if all(_same(column, other) for other in others) else f"{table.name}/{name}"
            columns.setdefault(own, column)
    return Table(columns, main.lines)


def _same(one: Column | None, other: Column | None) -> bool:
    """Whether two columns are equal, or one is absent."""
    return one is None or other is None or np.array_equal(one.values, other.values, equal_nan=True)


def names_and_units(cells: Sequence[str], units: Sequence[str], line: int = 0) -> list[tuple[str, str]]:
    """Name and unit of every column.

    Args:
        cells: the names, with or without a unit: `name [unit]`.
        units: the units of names without one.
        line: line of the names, for the message.

    Raises:
        TableError: two columns have the same name.
    """
    parts = [cell.partition("[") for cell in cells]
    columns = [
        (name.strip(), inner.rstrip("] ").strip() or unit) for (name, _, inner), unit in zip(parts, units, strict=True)
    ]
    counts = Counter(name for name, _ in columns)
    duplicate = next((name for name, count in counts.items() if name and count > 1), None)
    if duplicate:
        raise TableError(line, f"has several columns `{duplicate}`; give each its own name")
    return columns
