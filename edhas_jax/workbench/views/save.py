"""The button that saves what is beside it as a file, in one of several formats."""

import csv
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from nicegui import ui


def save_button(what: str, formats: Mapping[str, Callable]) -> ui.button:
    """Build the button with its menu.

    Args:
        what: the name of what is saved.
        formats: called for a file of a format, by its name.
    """
    button = ui.button(icon="download").props("flat round dense size=sm")
    button.props["aria-label"] = f"Save {what}"
    with button, ui.menu():
        for name, save in formats.items():
            ui.menu_item(name, on_click=save)
    return button


def csv_button(what: str, rows: Callable[[], Iterable[Sequence[Any]]]) -> ui.button:
    """Build the button that saves a table as CSV; `rows` gives its head and its rows."""
    return save_button(what, {"CSV": lambda: save_csv(what, rows())})


def save_csv(what: str, rows: Iterable[Sequence[Any]]) -> None:
    """Hand the browser a table as a file; None is an empty field."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    ui.download.content(text.getvalue(), f"{what.replace(' ', '_')}.csv")
