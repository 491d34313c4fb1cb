"""Read a table from text: values separated by commas, semicolons, tabs or spaces, as data loggers write them.

A row that does not fit is left out; one sentence reports all of a kind.
"""

import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from edhas_jax.measurements.tables.cell_values import decimal_mark, read_column
from edhas_jax.measurements.tables.labview_text import is_labview_text, read_labview_text
from edhas_jax.measurements.tables.row_table import EXPECTED, find_header
from edhas_jax.measurements.tables.table import (
    Column,
    Layout,
    Report,
    Table,
    TableError,
    report_no_line_end,
    require_size,
)

SAMPLED_LINES = 400  # from which the delimiter, the decimal mark and the number of columns are found
MAX_LISTED = 3  # lines of one kind that are reported one by one
SPACES = re.compile(r"\s+(?!\[)")  # between columns; `time [ms]` is one name
NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?")
STATED_DELIMITER = re.compile(r"sep=(.)", re.IGNORECASE)  # a first line that spreadsheets understand
CONTROL_CODES = [chr(code) for code in range(32) if code not in b"\t\n\x0b\x0c\r"]  # that no text has
MISSING = ["", "nan", "NaN", "NAN", "-nan"]  # cells that state that there is no value


def read_text_tables(path: Path, layout: Layout, report: Report) -> list[Table]:
    """Read a table from a text file.

    Args:
        path: the file.
        layout: its decimal mark, where that is stated.
        report: called for what is left out.

    Raises:
        TableError: it is no text, or holds no table.
    """
    text = _decode(path.read_bytes())
    lines = io.StringIO(text, newline=None).read().split("\n")
    is_cut = text[-1:] not in ("\r", "\n", "")
    del text
    if is_labview_text(lines[0]):
        return read_labview_text(lines, layout, report, read_lines)
    stated = STATED_DELIMITER.fullmatch(lines[0].strip())
    if stated:
        lines[0] = ""
    numbers = [number for number, line in enumerate(lines, 1) if line and not line.isspace()]
    filled = [lines[number - 1] for number in numbers]
    if not filled:
        raise TableError(0, f"is empty; {EXPECTED}")
    sampled = filled[:: max(1, len(filled) // SAMPLED_LINES)]
    delimiter = stated[1] if stated else _delimiter(sampled)
    sample = [cells for line in sampled if (cells := _cells(line, delimiter)) is not None]
    rows = zip(numbers, (_cells(line, delimiter) or [] for line in filled), strict=True)
    header = find_header(rows, sample, delimiter)
    mark = layout.decimal or decimal_mark([cell for cells in sample for cell in cells])
    del lines
    body, own = filled[header.first :], numbers[header.first :]
    if is_cut and body and len(_cells(body[-1], delimiter) or []) == len(header.names):
        report_no_line_end(own[-1], report)
    return [read_lines(body, own, header.names, header.line, delimiter, mark, bool(layout.decimal), report)]


def read_lines(
    body: Sequence[str], lines: Sequence[int], names: Sequence[tuple[str, str]], header_line: int, delimiter: str,
    decimal: str, is_stated: bool, report: Report, optional: int = 0,
) -> Table:  # fmt: skip
    """Read the lines with the values of a table.

    Args:
        body: the lines.
        lines: their numbers.
        names: name and unit of each column; a column without a name is not read.
        header_line: the line with the names.
        delimiter: what separates the columns.
        decimal: decimal mark.
        is_stated: whether the user has stated it.
        report: called for what is left out.
        optional: how many cells may be missing at the end of a line.
    """
    import pandas as pd

    width = len(names)
    require_size(width * len(body))
    if delimiter == " ":
        body, delimiter = [re.sub(r"\s+", "\t", line.strip()) for line in body], "\t"
    # 0 where a quotation mark is not closed
    counts = np.array(
        [line.count(delimiter) + 1 if '"' not in line else len(_cells(line, delimiter) or []) for line in body], int
    )
    fits = (counts <= width) & (counts >= width - optional)
    _report_unreadable([lines[k] for k in np.flatnonzero(counts == 0)], report)
    unfitting = [(lines[k], int(counts[k])) for k in np.flatnonzero(~fits & (counts > 0))]
    _report_unfitting(unfitting, width, lines[-1] if lines else 0, report)
    kept = np.array(lines, int)[fits]
    text = "\n".join(body if fits.all() else [body[k] for k in np.flatnonzero(fits)])
    try:
        frame = pd.read_csv(
            io.StringIO(text), sep=delimiter, header=None, names=range(width), index_col=False, skip_blank_lines=False,
            skipinitialspace=True, keep_default_na=False, na_values=MISSING, low_memory=False,
            decimal="." if decimal == delimiter else decimal,
        ) if len(kept) else pd.DataFrame(columns=range(width), dtype=float)  # fmt: skip
    except pd.errors.ParserError as error:
        raise TableError(0, f"cannot be read as a table: {error}") from None
    del text
    is_number = [dtype.kind in "fiu" for dtype in frame.dtypes]
    numbers = iter((frame if all(is_number) else frame.loc[:, is_number]).to_numpy(float).T.copy())
    columns = {}
    for at, ((name, unit), is_done) in enumerate(zip(names, is_number, strict=True)):
        if is_done:
            column = Column(unit, next(numbers))
        elif name:
            cells = frame[at].astype(object)
            cells = cells.where(cells.notna(), None).map(lambda cell: cell if cell is None else str(cell)).to_list()
            column = read_column(name, unit, cells, kept, decimal, is_stated, report)
        if name:
            columns[name] = column
    return Table(columns, kept, header_line)


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
        if not any(code in text for code in CONTROL_CODES):
            return text
        break
    raise TableError(0, "is not a text file; a table is needed, as CSV, Parquet, MATLAB or Excel file")


def _delimiter(sample: list[str]) -> str:
    """What separates the columns: a tab, a semicolon, spaces between numbers, otherwise a comma."""
    for delimiter in "\t;":
        count, times = Counter(line.count(delimiter) for line in sample).most_common(1)[0]
        if count > 0 and 2 * times > len(sample):
            return delimiter
    numbers = [line for line in sample if len(SPACES.split(line.strip())) > 1 and _are_numbers(line)]
    return " " if 2 * len(numbers) > len(sample) else ","


def _are_numbers(line: str) -> bool:
    return all(NUMBER.fullmatch(cell) for cell in SPACES.split(line.strip()))


def _cells(line: str, delimiter: str) -> list[str] | None:
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
