"""Read a measurement file of LabVIEW (`.lvm`): text with a header for the file and one for each segment of samples."""

import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from edhas_jax.measurements.tables.cell_values import read_column
from edhas_jax.measurements.tables.table import (
    Column,
    Layout,
    Report,
    Table,
    TableError,
    names_and_units,
    report_no_line_end,
)

END = "***End_of_Header***"
X_NAME = "X_Value"  # of a column with the time
COMMENT = "Comment"  # of the last column


def is_labview_text(line: str) -> bool:
    """Whether the first line of a text is that of a measurement file of LabVIEW."""
    return line.startswith("LabVIEW Measurement")


def read_labview_text(
    lines: Sequence[str], layout: Layout, report: Report, read_lines: Callable[..., Table]
) -> list[Table]:
    """Read a measurement file of LabVIEW.

    Segments of the same channels follow each other in time: by their X values where these go on, otherwise by the date
    and time in their headers. Channels with other X values are another table.

    Args:
        lines: the lines of the file.
        layout: its decimal mark, where the header does not state it.
        report: called for what is left out.
        read_lines: reads the lines of a segment.

    Raises:
        TableError: there is no segment of samples.
    """
    ends = [k for k, line in enumerate(lines) if line.startswith(END)]
    delimiter = "," if any(re.match(r"Separator[\t,]Comma", line) for line in lines[: ends[0] if ends else 0]) else "\t"
    file_header = _entries(lines[: ends[0] if ends else 0], delimiter)
    decimal = file_header.get("Decimal_Separator", layout.decimal)[0:1] or ["."]
    cut = len(lines) if lines[-1] else 0
    if cut and len(ends) > 1 and _is_whole(lines[-1], lines[ends[-1] + 1], delimiter):
        report_no_line_end(cut, report)
        cut = 0
    elif cut:
        report(cut, "the last line has no line end; the file seems to be truncated; line left out")
    stamps, segments = [], []
    for start, end, until in zip(ends, ends[1:], [*ends[2:], len(lines)], strict=False):
        header = _entries(lines[start + 1 : end], delimiter)
        names = [cell.strip() for cell in lines[end + 1].rstrip().split(delimiter)] if end + 1 < until else []
        own = [k for k in range(end + 2, until) if re.match(r"[-+ \d.,\t]*\d", lines[k]) and k + 1 != cut]
        width = len(names)
        body = [lines[k].rstrip(delimiter) if lines[k].count(delimiter) >= width else lines[k] for k in own]
        # X values occur several times; comments are not read
        unique = [("" if name == COMMENT and at == width - 1 else f"{at} {name}", "") for at, name in enumerate(names)]
        values = read_lines(body, [k + 1 for k in own], unique, end + 2, delimiter, decimal[0], True, report, width - 1)
        segments.append(_segment(names, header, values))
        stamps.append(" ".join(header.get(key, [""])[0] for key in ("Date", "Time")))
    if not segments:
        raise TableError(0, "holds no segment of samples, as a measurement file of LabVIEW does")
    seconds = read_column("", "", stamps, np.arange(len(stamps)), ".", True, lambda line, sentence: None).values
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
        table.columns[name] = Column(unit, columns[k].values[used], columns[k].fault)
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
        fault = next((f for table in tables if (f := table.columns[key].fault)), None)
        columns[key] = Column(first.unit, np.concatenate(own), fault)
    return Table(columns, np.concatenate([table.lines for table in tables]), tables[0].header_line, name)
