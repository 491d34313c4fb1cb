"""A table of texts."""

from collections.abc import Collection, Iterable, Sequence

from nicegui import ui


def show_table(heads: Sequence[str], rows: Iterable[Sequence[str]], numbers: Collection[str] = ()) -> None:
    """Build a table.

    Args:
        heads: titles of the columns.
        rows: texts of the cells, row by row.
        numbers: titles of the columns that are aligned as numbers.
    """
    styles = ["n" if head in numbers else "" for head in heads]
    with ui.element("div").classes("wb-scroll"), ui.element("table").classes("wb-table"):
        for tag, texts in [("th", heads), *(("td", row) for row in rows)]:
            with ui.element("tr"):
                for style, text in zip(styles, texts, strict=True):
                    with ui.element(tag).classes(style):
                        ui.label(text)
