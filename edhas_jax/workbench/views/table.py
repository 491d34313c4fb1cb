"""Tables of texts, and of boxes and fields that are edited."""

from collections.abc import Awaitable, Callable, Collection, Iterable, Sequence
from typing import Any

from nicegui import ui


class ChoiceTables:
    """What is chosen in tables with boxes and fields; `_build` of a subclass builds them from `_state`.

    Args:
        page: the window.
        on_choice: called after something was chosen.
        mark: name of the tables in the page.
    """

    def __init__(self, page, on_choice: Callable[[], Awaitable[None]], mark: str):
        self._page, self._on_choice = page, on_choice
        self._shown: Any = None  # all that the tables are made of
        self._body = ui.column().classes("w-full gap-1").props(f"data-mark={mark}")

    def refresh(self) -> None:
        """Follow the folder; tables that would be the same stay, so that no text that is typed is lost."""
        if self._state() == self._shown:
            return
        self._shown = self._state()
        self._body.clear()
        if self._page.summary is not None:
            self._build()

    async def _changed(self) -> None:
        """Tell that something was chosen, which the tables show already."""
        self._shown = self._state()
        await self._on_choice()


def show_table(heads: Sequence[str], rows: Iterable[Sequence[str]], numbers: Collection[str] = ()) -> None:
    """Build a table.

    Args:
        heads: titles of the columns.
        rows: texts of the cells, row by row.
        numbers: titles of the columns that are aligned as numbers.
    """
    with table_of(*heads, numbers=numbers):
        for row in rows:
            with ui.element("tr"):
                for head, text in zip(heads, row, strict=True):
                    cell(text, "n" if head in numbers else "")


def table_of(*heads: str, numbers: Collection[str] = ()) -> ui.element:
    """A table with titles, whose rows are added inside it."""
    with ui.element("div").classes("wb-scroll"):
        table = ui.element("table").classes("wb-table")
    with table, ui.element("tr"):
        for head in heads:
            cell(head, "n" if head in numbers else "", "th")
    return table


def field_table(*heads: str) -> ui.element:
    """A table with titles and with fields, whose rows are added inside it."""
    return table_of(*heads).classes("wb-fields")


def cell(text: str, style: str = "", tag: str = "td") -> ui.label:
    """Build a cell with a text, which is returned."""
    with ui.element(tag).classes(style):
        return ui.label(text)


def check_box(label: str, value: bool, on_change: Callable, *arguments: str) -> ui.checkbox:
    """A box in a cell; `on_change` is called with the arguments."""
    box = ui.checkbox(value=value, on_change=lambda: on_change(*arguments)).props("dense")
    box.props["aria-label"] = label
    return box


def text_field(label: str, text: object, hint: str, on_change: Callable, *arguments: str) -> ui.input:
    """A field in a cell, with a hint where it is empty; `on_change` is called with the arguments once it is left."""
    field = ui.input(value=str(text), placeholder=hint).props("dense borderless")
    field.props["aria-label"] = label
    for event in ("blur", "keydown.enter"):
        field.on(event, lambda: on_change(*arguments))
    return field
