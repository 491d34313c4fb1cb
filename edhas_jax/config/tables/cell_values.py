"""The cells of a text or a sheet: where their table begins, names and units of its columns, and its numbers.

Decimal marks, separators of thousands, dates and clock times are as people and programs write them.
"""

import datetime
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.config.tables.table import Column, TableError, names_and_units
from edhas_jax.core.units import is_unit_of

Cell = str | float | datetime.datetime | datetime.time | datetime.timedelta | None
Row = tuple[int, Sequence[Cell]]  # line and cells
MAX_QUOTED = 40  # characters of a cell in a message
MAX_FAILING = 0.05  # share of the cells of a column; where more fail, the way in which it is read is wrong
SPACES = " '’\u00a0\u2009\u202f"  # that separate thousands, whatever the decimal mark is
OTHER = {".": ",", ",": "."}
NUMERIC = re.compile(rf"[+-]?(?:\d[\d.,{SPACES}]*|[.,]\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf|infinity)", re.IGNORECASE)
GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}[.,]\d{3}")  # a number that may have decimals or thousands
WITH_UNIT = re.compile(rf"{NUMERIC.pattern.partition('|[+-]?(?:nan')[0]}\s*[^\W\d].*")
# a date, a clock time with seconds, half of the day, difference to universal time
STAMP = re.compile(
    r"(?:(\d{1,4}[-./ ]\w{1,9}[-./ ]\d{1,4})[ T,]+)?(\d{1,2}):(\d{2})(?::(\d{2}))?(?:[.,:](\d*))?"
    r"\s*(?:([AP])\.?M\.?)?\s*(Z|[+-]\d{2}:?\d{2})?",
    re.IGNORECASE,
)
DAY = 86400.0  # s
MAX_ROWS_ABOVE = 3  # rows between the names of the columns and the first numbers
EXPECTED = "the first line names the columns, such as `time [s],voltage [V]`, then follow lines of numbers"
MEASURED_UNITS = ("s", "V", "A", "m", "m/s", "Pa", "m^3/s", "N", "K")


def looks_numeric(cell: Cell) -> bool:
    """Whether a cell holds a number, a date with its time, or a clock time."""
    if isinstance(cell, str):
        try:
            float(cell)
            return True
        except ValueError:
            text = cell.strip()
        return bool(NUMERIC.fullmatch(text) or STAMP.fullmatch(text))
    return cell is not None


def decimal_mark(cells: Sequence[Cell]) -> str:
    """The decimal mark of a file: a comma where more cells have one that cannot separate thousands than a point."""
    texts = [cell.strip() for cell in cells if isinstance(cell, str)]
    if not any("," in text for text in texts):
        return "."
    marks = {",": 0, ".": 0}
    for text in texts:
        for mark, other in OTHER.items():
            if mark in text and other not in text and NUMERIC.fullmatch(text) and not GROUPED.fullmatch(text):
                marks[mark] += text.count(mark) == 1
    return "," if marks[","] > marks["."] else "."


def read_column(
    name: str, unit: str, cells: Sequence[Cell], lines: np.ndarray, decimal: str, is_stated: bool
) -> Column:
    """Read the cells of a column.

    Args:
        name: its name, for messages.
        unit: its unit; dates and clock times become seconds since the first.
        cells: its cells (samples,).
        lines: their lines (samples,).
        decimal: decimal mark of the file.
        is_stated: whether the user has stated it.
    """
    texts = [cell.strip() if isinstance(cell, str) else cell for cell in cells]
    if any(isinstance(cell, datetime.datetime | datetime.time | datetime.timedelta) for cell in texts):
        unit, values = "s", _seconds_of_cells(texts)
    elif 2 * sum(isinstance(t, str) and STAMP.fullmatch(t) is not None for t in texts) > sum(map(_is_filled, texts)):
        unit, values = "s", _seconds_of_texts(texts)
    else:
        values, others = _numbers(texts, decimal, is_stated)
        if others is not None:
            k = int(np.flatnonzero((values != others) & ~np.isnan(values))[0])
            one, two = float(values[k]), float(others[k])
            sentence = (
                f'`{name[:MAX_QUOTED]}`: "{texts[k][:MAX_QUOTED]}" is {one!r} or {two!r}; say what stands before the '
                'decimals in this file: `decimal: "."` or `decimal: ","` in campaign.yaml'
            )
            return Column(unit, np.full(len(texts), np.nan), TableError(int(lines[k]), sentence))
    missing = np.isnan(values)
    failing = [k for k in np.flatnonzero(missing) if _is_filled(texts[k])]
    if not failing:
        return Column(unit, values)
    # a word says that there is no value; what has digits was meant as one
    numbers = [k for k in failing if re.search(r"\d", str(texts[k]))]
    is_fault = len(numbers) > MAX_FAILING * (len(numbers) + int((~missing).sum()))
    first = numbers[0] if is_fault else failing[0]
    text, more = str(texts[first]), f" (and {len(failing) - 1} more in this column)" if len(failing) > 1 else ""
    sentence = f'`{name[:MAX_QUOTED]}`: "{text[:MAX_QUOTED]}" is not a number{more}'
    if is_fault:
        return Column(unit, values, TableError(int(lines[first]), f"{sentence}; {_remedy(text, decimal)}"))
    return Column(unit, values, gap=TableError(int(lines[first]), sentence))


def _is_filled(cell: Cell) -> bool:
    return cell is not None and cell == cell and not (isinstance(cell, str) and cell.lower().strip("+-") in ("", "nan"))


def _numbers(texts: Sequence[Cell], decimal: str, is_stated: bool) -> tuple[np.ndarray, np.ndarray | None]:
    """The numbers in cells (samples,), NaN where there is none; beside them others that are possible as well.

    The other mark separates thousands, or is the decimal mark of this column after all: what more cells allow.
    """
    other = OTHER[decimal]
    values = _with_mark(texts, decimal)
    strings = [text for text in texts if isinstance(text, str)]
    if is_stated or not any(other in text or text.count(decimal) > 1 for text in strings):
        return values, None
    others = _with_mark(texts, other)
    count, other_count = int(np.isnan(values).sum()), int(np.isnan(others).sum())
    if count == other_count and any(other in text for text in strings) and (values != others)[~np.isnan(values)].any():
        return values, others
    return others if other_count < count else values, None


def _with_mark(texts: Sequence[Cell], decimal: str) -> np.ndarray:
    """The numbers in cells (samples,), NaN where there is none, read with a decimal mark and groups of thousands."""
    group = OTHER[decimal] + SPACES
    pattern = re.compile(
        rf"[+-]?(?=[{decimal}]?\d)(?:[1-9]\d{{0,2}}([{group}])\d{{3}}(?:\1\d{{3}})*|\d*)(?:[{decimal}]\d*)?"
        r"(?:[eE][+-]?\d+)?|[+-]?(?i:inf|infinity)"
    )  # fmt: skip
    plain = str.maketrans({decimal: "."} | dict.fromkeys(group, ""))

    def number(cell: Cell) -> float:
        if isinstance(cell, str):
            return float(cell.translate(plain)) if pattern.fullmatch(cell) else np.nan
        return np.nan if cell is None else float(cell)

    return np.array([number(cell) for cell in texts], float)


def _remedy(text: str, decimal: str) -> str:
    """What to do about a cell that holds no number."""
    if WITH_UNIT.fullmatch(text):
        return "write numbers without their unit"
    if text.count(",") + text.count(".") > 1 or OTHER[decimal] in text:
        remedy = f'in a file with `{OTHER[decimal]}` write `decimal: "{OTHER[decimal]}"` in campaign.yaml'
        return f"`{decimal}` is taken for what stands before the decimals; {remedy}"
    return "write numbers only"


def _seconds_of_cells(cells: Sequence[Cell]) -> np.ndarray:
    """Seconds since the first of dates with times, times of day or durations (samples,); NaN for other cells."""
    zero = next(cell for cell in cells if isinstance(cell, datetime.datetime | datetime.time | datetime.timedelta))

    def seconds(cell: Cell) -> float:
        if type(cell) is not type(zero):
            return np.nan
        if isinstance(cell, datetime.time):
            return 3600.0 * cell.hour + 60.0 * cell.minute + cell.second + 1e-6 * cell.microsecond
        return (cell - zero).total_seconds()

    values = np.array([seconds(cell) for cell in cells])
    return _since_first(values, isinstance(zero, datetime.time))


def _seconds_of_texts(texts: Sequence[Cell]) -> np.ndarray:
    """Seconds since the first of dates with times, or of times of day (samples,); NaN for other cells."""
    found = [STAMP.fullmatch(text) if isinstance(text, str) else None for text in texts]
    days = _days({match[1] for match in found if match and match[1]})

    def seconds(match: re.Match | None) -> float:
        if match is None or (days and match[1] not in days):
            return np.nan
        day, hours, minutes, whole, fraction, half, zone = match.groups()
        if whole is None and fraction is not None:  # minutes and seconds
            hours, minutes, whole = "0", hours, minutes
        hour = int(hours) % 12 + 12 * (half in "pP") if half else int(hours)
        offset = 0.0
        if zone and zone not in "zZ":
            offset = float(f"{zone[0]}1") * (60.0 * int(zone[1:3]) + int(zone[-2:]))
        clock = 3600.0 * hour + 60.0 * (int(minutes) - offset) + float(f"{whole or 0}.{fraction or 0}")
        return days.get(day, 0.0) * DAY + clock

    return _since_first(np.array([seconds(match) for match in found]), not days)


def _days(dates: set[str]) -> dict[str, float]:
    """Days since the first of dates by their text; day or month first, whichever makes the record shorter."""
    import pandas as pd

    results = []
    for day_first in (True, False):
        try:
            stamps = {d: pd.to_datetime(d, dayfirst=day_first and not re.match(r"\d{4}", d)) for d in dates}
        except ValueError:
            continue
        zero = min(stamps.values(), default=None)
        results.append({date: (stamp - zero).total_seconds() / DAY for date, stamp in stamps.items()})
    return min(results, key=lambda days: max(days.values(), default=0.0), default={})


def _since_first(seconds: np.ndarray, is_time_of_day: bool) -> np.ndarray:
    """Seconds (samples,) since the first; a time of day that falls by more than half a day has passed midnight."""
    valid = np.flatnonzero(~np.isnan(seconds))
    values = seconds - seconds[valid[0]] if len(valid) else seconds
    if is_time_of_day:
        midnights = np.cumsum(np.diff(values[valid], prepend=0.0) < -0.5 * DAY)
        values[valid] += DAY * midnights
    return values


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
    return len(cells) == width and 2 * sum(map(_is_unit, texts)) > len(texts)


def _is_unit(text: str) -> bool:
    return text in ("-", "%") or any(is_unit_of(text, unit) for unit in MEASURED_UNITS)


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
