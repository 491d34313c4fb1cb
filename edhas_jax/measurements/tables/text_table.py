"""Read a table from text: values separated by commas, semicolons, tabs or spaces, as data loggers write them."""

import csv
import io
import re
from collections import Counter
from pathlib import Path

from edhas_jax.measurements.tables.row_table import EXPECTED, MAX_LISTED, Cell, table_from_rows
from edhas_jax.measurements.tables.table import Report, Table, TableError

SAMPLED_LINES = 400  # from which the delimiter is found
SPACES = re.compile(r"\s+(?!\[)")  # between columns; `time [ms]` is one name
NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?")
STATED_DELIMITER = re.compile(r"sep=(.)", re.IGNORECASE)  # a first line that spreadsheets understand


def read_text_tables(path: Path, report: Report) -> list[Table]:
    """Read a table from a text file.

    Args:
        path: the file.
        report: called for what is left out.

    Raises:
        TableError: it is no text, or holds no table.
    """
    text = _decode(path.read_bytes())
    lines = io.StringIO(text, newline=None).read().split("\n")
    stated = STATED_DELIMITER.fullmatch(lines[0].strip())
    if stated:
        lines[0] = ""
    filled = [(number, line) for number, line in enumerate(lines, 1) if line.strip()]
    if not filled:
        raise TableError(0, f"is empty; {EXPECTED}")
    delimiter = stated[1] if stated else _delimiter([line for _, line in filled])
    rows, unreadable = [], []
    for number, line in filled:
        cells = _cells(line, delimiter)
        if cells is None:
            unreadable.append(number)
        else:
            rows.append((number, cells))
    is_cut = text[-1] not in "\r\n" and rows and rows[-1][0] == len(lines)
    last = rows.pop() if is_cut and len(rows) > 1 else None
    table = table_from_rows(rows, delimiter, report)
    if last is not None and len(last[1]) == len(rows[-1][1]):
        # "0.0123" truncated to "0.0" would pass as a number
        report(last[0], "the last line has no line end; the file seems to be truncated; line left out")
    elif last is not None:
        found = f"{len(last[1])} values where the header has {len(rows[-1][1])}"
        report(last[0], f"{found}; the file seems to be truncated; line left out")
    _report_unreadable(unreadable, report)
    return [table]


def _decode(data: bytes) -> str:
    """The text of a file in UTF-8, in UTF-16 with a byte order mark, or in the Western European code of Windows.

    Raises:
        TableError: it is no text.
    """
    for encoding in ("utf-16",) if data[:2] in (b"\xff\xfe", b"\xfe\xff") else ("utf-8-sig", "cp1252"):
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if not re.search(r"[\x00-\x08\x0e-\x1f]", text):
            return text
        break
    raise TableError(0, "is not a text file; a table is needed, as CSV, Parquet, MATLAB or Excel file")


def _delimiter(lines: list[str]) -> str:
    """What separates the columns: a tab, a semicolon, spaces between numbers, otherwise a comma."""
    sample = lines[:: max(1, len(lines) // SAMPLED_LINES)]
    for delimiter in "\t;":
        count, times = Counter(line.count(delimiter) for line in sample).most_common(1)[0]
        if count > 0 and 2 * times > len(sample):
            return delimiter
    numbers = [line for line in sample if len(SPACES.split(line.strip())) > 1 and _are_numbers(line)]
    return " " if 2 * len(numbers) > len(sample) else ","


def _are_numbers(line: str) -> bool:
    return all(NUMBER.fullmatch(cell) for cell in SPACES.split(line.strip()))


def _cells(line: str, delimiter: str) -> list[Cell] | None:
    """The cells of a line; None where a quotation mark is not closed."""
    if delimiter == " ":
        return SPACES.split(line.strip())
    if '"' not in line:
        return line.split(delimiter)
    try:
        # a quotation mark never joins lines: a stray one damages its own line only
        return next(csv.reader([line], delimiter=delimiter, strict=True))
    except csv.Error:
        return None


def _report_unreadable(unreadable: list[int], report: Report) -> None:
    """Report the lines with a quotation mark that is not closed."""
    if len(unreadable) > MAX_LISTED:
        others = f"so are {len(unreadable) - 1} more lines up to line {unreadable[-1]}"
        report(unreadable[0], f"a quotation mark is not closed; {others}; these lines are left out")
        return
    for line in unreadable:
        report(line, "a quotation mark is not closed; line left out")
