"""Find the table in the rows of a text or a sheet: lines before it, names and units of its columns."""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from edhas_jax.core.units import UnitError, to_si
from edhas_jax.measurements.tables.cell_values import Cell, looks_numeric
from edhas_jax.measurements.tables.table import TableError, names_and_units

MAX_ROWS_ABOVE = 3  # rows between the names of the columns and the first numbers
EXPECTED = "the first line names the columns, such as `time [s],voltage [V]`, then follows a line for each sample"
MEASURED_UNITS = ("s", "V", "A", "m", "m/s", "Pa", "m^3/s", "N", "K")

Row = tuple[int, Sequence[Cell]]  # line and cells


class Header(NamedTuple):
    """What stands above the numbers of a table.

    Attributes:
        names: name and unit of each column.
        line: the line that names them.
        first: how many rows stand above the first row of numbers.
    """

    names: list[tuple[str, str]]
    line: int
    first: int


def find_header(rows: Iterable[Row], sample: Sequence[Sequence[Cell]], delimiter: str) -> Header:
    """Find the first row of numbers and the names of the columns.

    The names are in the last row above the numbers, or in the row before that one where it holds nothing but units. The
    row above the names completes them: it has the names that are missing, and the groups of those that occur twice
    (`group/name`). Rows above are notes of the logger.

    Args:
        rows: every row that is not empty, from the top; read no further than needed.
        sample: cells of rows from all over the file.
        delimiter: what separates the cells in the file.

    Raises:
        TableError: there are no numbers, no names, or more values than names.
    """
    widths = Counter(len(cells) for cells in sample if _is_numeric(cells))
    if not widths:
        raise TableError(0, f"holds no table of numbers; {EXPECTED}")
    width = widths.most_common(1)[0][0]
    above: list[Row] = []
    start: Row | None = None
    for row in rows:
        if start is not None:
            if any(map(looks_numeric, row[1])):
                break
            above.append(start)  # numbers above words are a note, such as a date with its time
        start = row if len(row[1]) == width and _is_numeric(row[1]) else None
        if start is None:
            above.append(row)
    if start is None:
        raise TableError(0, f"holds no table of numbers; {EXPECTED}")
    first = len(above)
    for k in range(first - 1, max(first - 1 - MAX_ROWS_ABOVE, -1), -1):
        cells = _padded(above[k][1], width)
        if k > 0 and _are_units(cells, width) and (names := _names(above, k - 1, width)):
            units = [cell.strip("[]() ") for cell in cells]
            return Header(names_and_units(names, units, above[k - 1][0]), above[k - 1][0], first)
        if names := _names(above, k, width):
            return Header(names_and_units(names, [""] * width, above[k][0]), above[k][0], first)
    raise _header_error(above, start[0], sample, width, delimiter)


def _names(rows: Sequence[Row], k: int, width: int) -> list[str]:
    """The names of the columns in row k, completed by the row above it; empty where these are no names."""
    names = _padded(rows[k][1], width)
    if len(names) != width or _is_numeric(rows[k][1]):
        return []
    counts = Counter(name for name in names if name)
    if k > 0 and (len(counts) < width or max(counts.values()) > 1):
        above = _padded(rows[k - 1][1], width)
        if len(above) == width and not _is_numeric(rows[k - 1][1]):
            group = ""
            for at, (name, cell) in enumerate(zip(names, above, strict=True)):
                group = cell or group
                names[at] = f"{group}/{name}" if counts[name] > 1 and group else name or cell
    # where every line ends with a delimiter, one column is nameless
    return names if sum(map(bool, names)) >= max(1, width - 1) else []


def _padded(cells: Sequence[Cell], width: int) -> list[str]:
    """The cells of a header as text, with or without an empty one at the end where that makes `width` of them."""
    texts = ["" if cell is None else str(cell).strip() for cell in cells]
    if len(texts) == width + 1 and not texts[-1]:
        return texts[:-1]
    return [*texts, ""] if len(texts) == width - 1 > 0 else texts


def _are_units(cells: Sequence[str], width: int) -> bool:
    """Whether most cells of a row hold units, bare or in brackets."""
    texts = [text for cell in cells if (text := cell.strip("[]() "))]
    return len(cells) == width and 2 * sum(text in ("-", "%") or _is_unit(text) for text in texts) > len(texts)


def _is_unit(text: str) -> bool:
    for unit in MEASURED_UNITS:
        try:
            to_si(f"1 {text}", unit)
        except UnitError:
            continue
        return True
    return False


def _is_numeric(cells: Sequence[Cell]) -> bool:
    """Whether most cells of a row that are not empty hold numbers, dates or clock times."""
    filled = [cell for cell in cells if cell is not None and str(cell).strip()]
    numbers = sum(map(looks_numeric, filled))
    return numbers > 0 and 2 * numbers > len(filled)


def _header_error(
    rows: Sequence[Row], line: int, sample: Sequence[Sequence[Cell]], width: int, delimiter: str
) -> TableError:
    """The error for a table whose first row of numbers has no names of as many columns above it."""
    above = [(number, cells) for number, cells in rows if len(cells) > 1 and not _is_numeric(cells)]
    if not above:
        return TableError(line, f"the columns have no names above their numbers; {EXPECTED}")
    header_line, names = above[-1]
    count = len(names)
    has_points = any("." in str(cell) for cells in sample if _is_numeric(cells) for cell in cells)
    if delimiter == "," and count < width <= 2 * count and not has_points:
        sentence = (
            f"numbers have decimal commas, and commas separate the columns too ({count} names, up to {width} values in "
            "a line); export with decimal points, or with semicolons between the columns"
        )
        return TableError(header_line, sentence)
    remedy = "name every column" if count < width else "write one value for each name"
    return TableError(line, f"{width} values where line {header_line} names {count} columns; {remedy}")
