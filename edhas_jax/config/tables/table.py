"""A table of measured numbers: columns with their units, and the line of the file that each sample was read from."""

import dataclasses
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from edhas_jax.core.remark import Remark, Severity

TIME = "time"  # the name of the time stamps that a file keeps apart from its channels
# bytes of a file, and of its numbers in memory, where several copies of them must fit
MAX_BYTES = 1_000_000_000


class Report(Protocol):
    """Called for what is left out of a table, or worth a note.

    Args:
        line: the line, 0 for the file as a whole.
        sentence: what is there.
        severity: a note where nothing is left out.
        outcome: what is done about it.
    """

    def __call__(
        self, line: int, sentence: str, severity: Severity = Severity.ERROR, outcome: str = ""
    ) -> None: ...


class TableError(ValueError):
    """A file cannot be used at all; `line` is the line at fault, 0 for the file as a whole."""

    def __init__(self, line: int, sentence: str):
        super().__init__(sentence)
        self.line = line

    def at(self, path: Path) -> str:
        """The sentence behind the file and the line at fault."""
        return str(Remark(Severity.ERROR, path, self.line, str(self)))


@dataclasses.dataclass(frozen=True)
class Column:
    """A column.

    Args:
        unit: the unit stated in the file, "" without one.
        values: the values (samples,) as in the file.
        fault: why the column cannot be used; to be raised where it is needed.
        gap: the first cell that holds something else than a number and is NaN; None without one.
    """

    unit: str
    values: np.ndarray
    fault: TableError | None = None
    gap: TableError | None = None


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


class Layout(NamedTuple):
    """What a campaign states about a file, "" where it does not.

    Attributes:
        decimal: what stands before the decimals in a text: "." or ",".
        sheet: the sheet of an Excel file.
    """

    decimal: str = ""
    sheet: str = ""


def require_size(values: int) -> None:
    """Check that the numbers of a file fit into the memory, before they are read.

    Args:
        values: their count.

    Raises:
        TableError: they do not.
    """
    if 8 * values > MAX_BYTES:
        limit = f"unpacks to more than {MAX_BYTES / 1e9:g} GB, the most that is read"
        raise TableError(0, f"{limit}; export fewer channels or a shorter time")


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
