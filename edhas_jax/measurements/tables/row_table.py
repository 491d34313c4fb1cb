"""Find the table in the rows of a text or a sheet: lines before it, names and units of its columns, its numbers.

A row that does not fit and a cell that is no number are left out; one sentence reports all of a kind.
"""

import re
from collections import Counter
from collections.abc import Sequence

import numpy as np

from edhas_jax.core.units import UnitError, to_si
from edhas_jax.measurements.tables.table import Column, Report, Table, TableError, names_and_units

Cell = str | float | None
MAX_LISTED = 3  # rows of one kind that are reported one by one
MAX_ROWS_ABOVE = 3  # rows between the names of the columns and the first numbers
SAMPLED_ROWS = 400  # in which the number of columns is counted
EXPECTED = "the first line names the columns, such as `time [s],voltage [V]`, then follows a line for each sample"
MAX_QUOTED = 40  # characters of a cell in a message
MEASURED_UNITS = ("s", "V", "A", "m", "m/s", "Pa", "m^3/s", "N", "K")
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d*(?:[eE][+-]?\d+)?")


def table_from_rows(rows: Sequence[tuple[int, list[Cell]]], delimiter: str, report: Report) -> Table:
    """Find the table in rows of cells.

    The names of the columns are in the last row above the first row of numbers, or in the row before that one where it
    holds nothing but units. Rows above them are notes of the logger.

    Args:
        rows: line and cells of every row that is not empty.
        delimiter: what separates the cells in the file; numbers may have decimal commas unless this is a comma.
        report: called for what is left out.

    Raises:
        TableError: there are no numbers, no names, or more values than names.
    """
    comma = delimiter != ","
    sampled = rows[:: max(1, len(rows) // SAMPLED_ROWS)]
    widths = Counter(len(cells) for _, cells in sampled if _is_numeric(cells, comma))
    if not widths:
        raise TableError(0, f"holds no table of numbers; {EXPECTED}")
    width = widths.most_common(1)[0][0]
    first = next(k for k, (_, cells) in enumerate(rows) if _is_numeric(cells, comma) and len(cells) == width)
    above = range(first - 1, max(first - 1 - MAX_ROWS_ABOVE, -1), -1)
    header = next((k for k in above if _fits(rows[k][1], width) and not _is_numeric(rows[k][1], True)), None)
    if header is None:
        raise _header_error(rows, first, width, delimiter)
    cells = _padded(rows[header][1], width)
    units = [""] * width
    if header > 0 and _are_units(cells) and _fits(rows[header - 1][1], width):
        units = [cell.strip("[]() ") for cell in cells]
        header -= 1
        cells = _padded(rows[header][1], width)
    header_line = rows[header][0]
    named = names_and_units(cells, units, header_line)
    values, lines, not_numbers = [], [], {}
    unfitting = []
    for line, row in rows[first:]:
        if len(row) != width:
            unfitting.append((line, len(row)))
            continue
        values.append([_number(cell, comma, not_numbers, (line, at)) for at, cell in enumerate(row)])
        lines.append(line)
    _report_unfitting(unfitting, width, rows[-1][0], report)
    for at, (name, _) in enumerate(named):
        bad = [(line, cell) for (line, column), cell in not_numbers.items() if column == at]
        if bad:
            more = f" (and {len(bad) - 1} more in this column)" if len(bad) > 1 else ""
            hint = " (write decimal points)" if DECIMAL_COMMA.fullmatch(bad[0][1]) else ""
            what = f'`{name[:MAX_QUOTED]}`: "{bad[0][1][:MAX_QUOTED]}" is not a number'
            report(bad[0][0], f"{what}{hint}{more}; taken as missing")
    array = np.array(values, float).reshape(len(values), width)
    columns = {name: Column(unit, array[:, at]) for at, (name, unit) in enumerate(named) if name}
    return Table(columns, np.array(lines, int), header_line)


def _fits(cells: Sequence[Cell], width: int) -> bool:
    """Whether a row can hold the names of so many columns; where every line ends with a delimiter, one is nameless."""
    texts = _padded(cells, width)
    return len(texts) == width and sum(map(bool, texts)) >= max(1, width - 1)


def _padded(cells: Sequence[Cell], width: int) -> list[str]:
    """The cells of a header as text, with or without an empty one at the end where that makes `width` of them."""
    texts = ["" if cell is None else str(cell).strip() for cell in cells]
    if len(texts) == width + 1 and not texts[-1]:
        return texts[:-1]
    return [*texts, ""] if len(texts) == width - 1 > 0 else texts


def _are_units(cells: Sequence[str]) -> bool:
    """Whether a row holds nothing but units, bare or in brackets."""
    texts = [cell.strip("[]() ") for cell in cells]
    return any(texts) and all(text in ("", "-", "%") or _is_unit(text) for text in texts) and any(map(_is_unit, texts))


def _is_unit(text: str) -> bool:
    for unit in MEASURED_UNITS:
        try:
            to_si(f"1 {text}", unit)
        except UnitError:
            continue
        return True
    return False


def _is_numeric(cells: Sequence[Cell], comma: bool) -> bool:
    """Whether most cells of a row that are not empty hold numbers."""
    filled = [cell for cell in cells if cell is not None and str(cell).strip()]
    numbers = sum(not np.isnan(_number(cell, comma, {}, (0, 0))) for cell in filled)
    return numbers > 0 and 2 * numbers > len(filled)


def _number(cell: Cell, comma: bool, not_numbers: dict[tuple[int, int], str], place: tuple[int, int]) -> float:
    """The number in a cell; NaN for an empty one, and for one that holds none, which is added to `not_numbers`."""
    if cell is None or isinstance(cell, float):
        return np.nan if cell is None else cell
    text = cell.strip()
    try:
        return float(text) if text else np.nan
    except ValueError:
        pass
    if comma and DECIMAL_COMMA.fullmatch(text):
        try:
            return float(text.replace(",", "."))
        except ValueError:
            pass
    not_numbers[place] = text
    return np.nan


def _header_error(rows: Sequence[tuple[int, list[Cell]]], first: int, width: int, delimiter: str) -> TableError:
    """The error for a table whose first row of numbers has no names of as many columns above it."""
    above = [(line, cells) for line, cells in rows[:first] if len(cells) > 1 and not _is_numeric(cells, True)]
    line = rows[first][0]
    if not above:
        return TableError(line, f"the columns have no names above their numbers; {EXPECTED}")
    header_line, names = above[-1]
    count = len(names)
    has_points = any("." in str(cell) for _, cells in rows[first : first + SAMPLED_ROWS] for cell in cells)
    if delimiter == "," and count < width <= 2 * count and not has_points:
        sentence = (
            f"numbers have decimal commas, and commas separate the columns too ({count} names, up to {width} values in "
            "a line); export with decimal points, or with semicolons between the columns"
        )
        return TableError(header_line, sentence)
    return TableError(line, f"{width} values where line {header_line} names {count} columns; name every column")


def _report_unfitting(unfitting: list[tuple[int, int]], width: int, last: int, report: Report) -> None:
    """Report the rows with another number of values than the header."""
    if len(unfitting) > MAX_LISTED:
        (line, count), (until, _) = unfitting[0], unfitting[-1]
        others = f"so have {len(unfitting) - 1} more lines up to line {until}"
        report(line, f"{count} values where the header has {width}; {others}; these lines are left out")
        return
    for line, count in unfitting:
        truncated = "; the file seems to be truncated" if line == last else ""
        report(line, f"{count} values where the header has {width}{truncated}; line left out")
