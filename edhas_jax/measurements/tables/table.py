"""A table of measured numbers: columns with their units, and the line of the file that each sample was read from."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

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
    """A table.

    Args:
        columns: the columns by name.
        lines: line (text) or row (others, from 1) of each sample (samples,).
        header_line: line that names the columns, 0 where the format has none.
    """

    columns: dict[str, Column]
    lines: np.ndarray
    header_line: int = 0


def table_of_vectors(vectors: Mapping[str, tuple[str, np.ndarray]], report: Report) -> Table:
    """The table of vectors of equal length; those of another length than most are left out.

    Args:
        vectors: unit and values by name; a name may have its unit in brackets.
        report: called for what is left out.

    Raises:
        TableError: two vectors have the same name.
    """
    lengths = [len(values) for _, values in vectors.values()]
    count = max(lengths, key=lengths.count, default=0)
    columns, named = {}, names_and_units(list(vectors), [unit for unit, _ in vectors.values()])
    for (name, unit), (_, values) in zip(named, vectors.values(), strict=True):
        if len(values) == count:
            columns[name] = Column(unit, values)
        else:
            report(0, f"`{name}` has {len(values)} samples where others have {count}; it is left out")
    return Table(columns, np.arange(1, count + 1))


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
    names = [name for name, _ in columns]
    duplicate = next((name for name in names if name and names.count(name) > 1), None)
    if duplicate:
        raise TableError(line, f"has several columns `{duplicate}`; give each its own name")
    return columns
