"""What a result says of itself: sentences and tables, as plain text, as HTML for notebooks and reports, and as JSON."""

import dataclasses
import enum
import html
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from edhas_jax.core.literal_text import one_line


class Tone(enum.Enum):
    """How a text is to be taken; where there are colours it has one."""

    GOOD = "good"
    CAUTION = "caution"
    BAD = "bad"
    HEAD = "head"
    QUIET = "quiet"


class Toned(NamedTuple):
    """A text with its tone."""

    text: str
    tone: Tone


Text = str | Toned
TONE_COLOURS = {
    Tone.GOOD: "#1a7f4b", Tone.CAUTION: "#9a6700", Tone.BAD: "#b42318", Tone.HEAD: "inherit", Tone.QUIET: "#6e7781",
}  # fmt: skip


def plain(text: Text) -> str:
    """The text without its tone."""
    return text.text if isinstance(text, Toned) else text


@dataclasses.dataclass(frozen=True)
class SummaryTable:
    """A table of texts.

    Attributes:
        name: what it holds, a key of the JSON output.
        columns: heads of the columns.
        rows: the texts, a row each.
        records: the same as plain data, numbers in SI; None: the texts by column.
        title: shown above it; empty: none.
        caption: shown below it; empty: none.
    """

    name: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Text, ...], ...]
    records: tuple[Mapping[str, Any], ...] | None = None
    title: str = ""
    caption: str = ""

    @classmethod
    def of(cls, name: str, columns: Sequence[str], rows, records=None, title: str = "", caption: str = ""):
        """A table from any sequences."""
        records = None if records is None else tuple(records)
        return cls(name, tuple(columns), tuple(map(tuple, rows)), records, title, caption)

    def as_json(self) -> list[dict[str, Any]]:
        """A mapping per row; numbers that are not finite are None."""
        if self.records is not None:
            return [jsonable(record) for record in self.records]
        return [dict(zip(self.columns, map(plain, row), strict=True)) for row in self.rows]

    def __str__(self) -> str:
        rows = [[one_line(plain(text)) for text in row] for row in self.rows]
        widths = [max(map(len, column)) for column in zip(self.columns, *rows, strict=True)]
        lines = ["  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
                 for row in (self.columns, *rows)]  # fmt: skip
        return "\n".join(filter(None, (self.title, lines[0], "-" * len(lines[0]), *lines[1:], self.caption)))

    def _repr_html_(self) -> str:
        title = f"<caption style='text-align:left'><b>{html.escape(self.title)}</b></caption>" if self.title else ""
        head = "".join(f"<th style='text-align:left'>{html.escape(c)}</th>" for c in self.columns)
        rows = "".join(
            "<tr>" + "".join(f"<td style='text-align:left'>{_html(t)}</td>" for t in row) + "</tr>" for row in self.rows
        )
        below = f"<p>{html.escape(self.caption)}</p>" if self.caption else ""
        return f"<table>{title}<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>{below}"


@dataclasses.dataclass(frozen=True)
class Summary:
    """The summary of a result; `print` it, or let a notebook show it.

    Attributes:
        title: what was done, in one line.
        parts: tables and sentences, in the order in which they are read.
    """

    title: str
    parts: tuple[Text | SummaryTable, ...] = ()

    @property
    def tables(self) -> dict[str, SummaryTable]:
        """The tables by name."""
        return {part.name: part for part in self.parts if isinstance(part, SummaryTable)}

    @property
    def sentences(self) -> list[str]:
        """The sentences, without their tone."""
        return [plain(part) for part in self.parts if not isinstance(part, SummaryTable)]

    def __str__(self) -> str:
        texts = [str(p) if isinstance(p, SummaryTable) else plain(p) for p in self.parts]
        return "\n\n".join([self.title, *texts])

    def __repr__(self) -> str:
        return str(self)

    def _repr_html_(self) -> str:
        parts = [p._repr_html_() if isinstance(p, SummaryTable) else f"<p>{_html(p)}</p>" for p in self.parts]
        return f"<div><p><b>{html.escape(self.title)}</b></p>{''.join(parts)}</div>"

    def as_json(self) -> dict[str, Any]:
        """Title, sentences and tables as plain data, numbers in SI."""
        tables = {name: table.as_json() for name, table in self.tables.items()}
        return {"title": self.title, "sentences": self.sentences, **tables}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> "Summary":
        """The summary that `as_json` has written; its tables show the plain data.

        Raises:
            ValueError: the data are not those of a summary.
        """
        try:
            tables = [(n, rows) for n, rows in data.items() if n not in ("title", "sentences")]
            parts = []
            for name, rows in tables:
                columns = tuple(dict.fromkeys(key for row in rows for key in row))
                texts = tuple(tuple(_shown(row.get(c)) for c in columns) for row in rows)
                parts.append(SummaryTable(name, columns, texts, tuple(rows), title=name.replace("_", " ")))
            return cls(str(data["title"]), (*parts, *map(str, data["sentences"])))
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"not the summary of a result: {error!r}") from None


def _html(text: Text) -> str:
    escaped = html.escape(plain(text))
    if not isinstance(text, Toned):
        return escaped
    return f"<span style='color:{TONE_COLOURS[text.tone]};font-weight:600'>{escaped}</span>"


def _shown(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.6g}"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def jsonable(value: Any) -> Any:
    """Nested data as JSON has them: numbers of NumPy become plain ones, those that are not finite None."""
    if isinstance(value, Mapping):
        return {str(k): jsonable(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [jsonable(v) for v in value]
    if hasattr(value, "tolist"):
        return jsonable(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
