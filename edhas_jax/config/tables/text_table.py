"""Read a table from text: values separated by commas, semicolons, tabs or spaces, and measurement files of LabVIEW.

A row that does not fit is left out; one sentence reports all of a kind.
"""

import csv
import io
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from edhas_jax.config.tables.cell_values import EXPECTED, decimal_mark, find_header, read_column
from edhas_jax.config.tables.table import Column, Layout, Report, Table, TableError, names_and_units, require_size
from edhas_jax.core.remark import Severity

SAMPLED_LINES = 400  # from which the delimiter, the decimal mark and the number of columns are found
MAX_LISTED = 3  # lines of one kind that are reported one by one
SPACES = re.compile(r"\s+(?!\[)")  # between columns; `time [ms]` is one name
NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?")
STATED_DELIMITER = re.compile(r"sep=(.)", re.IGNORECASE)  # a first line that spreadsheets understand
CONTROL_CODES = [chr(code) for code in range(32) if code not in b"\t\n\x0b\x0c\r"]  # that no text has
END_OF_HEADER = "***End_of_Header***"  # of a measurement file of LabVIEW
X_NAME = "X_Value"  # of a column with the time
COMMENT = "Comment"  # of the last column
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
    if lines[0].startswith("LabVIEW Measurement"):
        return _read_labview(lines, layout, report)
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
        _report_no_line_end(own[-1], report)
    return [_read_lines(body, own, header.names, header.line, delimiter, mark, bool(layout.decimal), report)]


def _read_lines(
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
    _report_left_out([(lines[k], "a quotation mark is not closed") for k in np.flatnonzero(counts == 0)], "are", report)
    unfitting = []
    for k in np.flatnonzero(~fits & (counts > 0)):
        truncated = "; the file seems to be truncated" if lines[k] == lines[-1] else ""
        unfitting.append((lines[k], f"{counts[k]} values where the header has {width}{truncated}"))
    _report_left_out(unfitting, "have", report)
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
            column = read_column(name, unit, cells, kept, decimal, is_stated)
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


def _report_left_out(found: Sequence[tuple[int, str]], verb: str, report: Report) -> None:
    """Report lines with what is wrong with each; of many the first alone, with `verb` for what the others are."""
    if len(found) > MAX_LISTED:
        (line, problem), others = found[0], f"{len(found) - 1} more lines up to line {found[-1][0]}"
        report(line, f"{problem}; so {verb} {others}", outcome="these lines are left out")
        return
    for line, problem in found:
        report(line, problem, outcome="line left out")


def _report_no_line_end(line: int, report: Report) -> None:
    """Note that the last line of a text, which is used, has no line end: "0.0123" cut to "0.0" passes as a number."""
    outcome = "it is used; if the file was cut off, its last value may be wrong"
    report(line, "the last line has no line end", Severity.NOTE, outcome)


def _read_labview(lines: Sequence[str], layout: Layout, report: Report) -> list[Table]:
    """Read a measurement file of LabVIEW (`.lvm`): a header for the file and one for each segment of samples.

    Segments of the same channels follow each other in time: by their X values where these go on, otherwise by the date
    and time in their headers. Channels with other X values are another table.

    Raises:
        TableError: there is no segment of samples.
    """
    ends = [k for k, line in enumerate(lines) if line.startswith(END_OF_HEADER)]
    top = lines[: ends[0] if ends else 0]
    delimiter = "," if any(re.match(r"Separator[\t,]Comma", line) for line in top) else "\t"
    file_header = _entries(top, delimiter)
    decimal = file_header.get("Decimal_Separator", layout.decimal)[0:1] or ["."]
    cut = len(lines) if lines[-1] else 0
    if cut and len(ends) > 1 and _is_whole(lines[-1], lines[ends[-1] + 1], delimiter):
        _report_no_line_end(cut, report)
        cut = 0
    elif cut:
        report(cut, "the last line has no line end; the file seems to be truncated", outcome="line left out")
    stamps, segments = [], []
    for start, end, until in zip(ends, ends[1:], [*ends[2:], len(lines)], strict=False):
        header = _entries(lines[start + 1 : end], delimiter)
        names = [cell.strip() for cell in lines[end + 1].rstrip().split(delimiter)] if end + 1 < until else []
        own = [k for k in range(end + 2, until) if re.match(r"[-+ \d.,\t]*\d", lines[k]) and k + 1 != cut]
        width = len(names)
        body = [lines[k].rstrip(delimiter) if lines[k].count(delimiter) >= width else lines[k] for k in own]
        # X values occur several times; comments are not read
        unique = [("" if name == COMMENT and at == width - 1 else f"{at} {name}", "") for at, name in enumerate(names)]
        own_lines = [k + 1 for k in own]
        values = _read_lines(body, own_lines, unique, end + 2, delimiter, decimal[0], True, report, width - 1)
        segments.append(_segment(names, header, values))
        stamps.append(" ".join(header.get(key, [""])[0] for key in ("Date", "Time")))
    if not segments:
        raise TableError(0, "holds no segment of samples, as a measurement file of LabVIEW does")
    seconds = read_column("", "", stamps, np.arange(len(stamps)), ".", True).values
    series: dict[tuple[str, ...], list[tuple[Table, float]]] = {}
    for tables, start in zip(segments, seconds, strict=True):
        for table in tables:
            series.setdefault(tuple(table.columns), []).append((table, float(start)))
    return [_in_sequence(parts, str(k + 1) if len(series) > 1 else "") for k, parts in enumerate(series.values())]


def _is_whole(line: str, header: str, delimiter: str) -> bool:
    """Whether a line has a value of every channel; a comment at its end may be missing."""
    names = [cell.strip() for cell in header.rstrip().split(delimiter)]
    return line.count(delimiter) + 1 >= len(names) - (names[-1] == COMMENT)


def _entries(lines: Sequence[str], delimiter: str) -> dict[str, list[str]]:
    """The entries of a header: the cells behind each key."""
    rows = [[cell.strip() for cell in line.split(delimiter)] for line in lines]
    return {cells[0]: cells[1:] for cells in rows if len(cells) > 1}


def _segment(names: Sequence[str], header: Mapping[str, Sequence[str]], values: Table) -> list[Table]:
    """The tables of a segment: one for all channels with the same X values."""

    def stated(key: str, channel: int, default: str) -> str:
        cells = header.get(key, ())
        return cells[channel] if channel < len(cells) and cells[channel] else default

    columns = {int(name.split()[0]): column for name, column in values.columns.items()}
    at = [k for k, name in enumerate(names) if name not in ("", X_NAME) and (name, k) != (COMMENT, len(names) - 1)]
    units = [stated("Y_Unit_Label", channel, "") for channel in range(len(at))]
    tables: dict[bytes, Table] = {}
    empty = np.full(len(values.lines), np.nan)
    for channel, (k, (name, unit)) in enumerate(zip(at, names_and_units([names[k] for k in at], units), strict=True)):
        x = next((columns[j].values for j in range(k - 1, -1, -1) if names[j] == X_NAME), empty)
        if not np.isfinite(x).any():
            first, step, count = (stated(key, channel, default) for key, default in
                                  (("X0", "0"), ("Delta_X", "1"), ("Samples", str(len(x)))))  # fmt: skip
            x = float(first.replace(",", ".")) + float(step.replace(",", ".")) * np.arange(len(x))
            x[int(float(count)) :] = np.nan
        used = np.isfinite(x)
        unit_of_x = "s" if stated("X_Dimension", channel, "Time") == "Time" else ""
        new = Table({X_NAME: Column(unit_of_x, x[used])}, values.lines[used], values.header_line)
        table = tables.setdefault(x.tobytes(), new)
        table.columns[name] = Column(unit, columns[k].values[used], columns[k].fault, columns[k].gap)
    return list(tables.values())


def _in_sequence(parts: Sequence[tuple[Table, float]], name: str) -> Table:
    """Tables of the same channels, and when each began [s], as one."""
    tables = [table for table, _ in parts]
    times: list[np.ndarray] = []
    for table, start in parts:
        x = table.columns[X_NAME].values
        goes_on = not times or not len(x) or not len(times[-1]) or x[0] > times[-1][-1] or np.isnan(start)
        times.append(x if goes_on else x + start - parts[0][1])
    columns = {}
    for key, first in tables[0].columns.items():
        own = times if key == X_NAME else [table.columns[key].values for table in tables]
        fault, gap = (
            next((found for table in tables if (found := getattr(table.columns[key], kind))), None)
            for kind in ("fault", "gap")
        )
        columns[key] = Column(first.unit, np.concatenate(own), fault, gap)
    return Table(columns, np.concatenate([table.lines for table in tables]), tables[0].header_line, name)
