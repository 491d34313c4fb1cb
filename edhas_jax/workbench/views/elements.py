"""Elements in the look of the page, of which the views are made."""

import contextlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from nicegui import ui


class Head(ui.label, default_classes="wb-h"):
    """The heading of a part of a view."""


class Strong(ui.label, default_classes="font-semibold"):
    """A text that stands out."""


class Quiet(ui.label, default_classes="wb-quiet"):
    """A text that stays behind."""


class Block(ui.label, default_classes="wb-block"):
    """Lines of code, or what a command has printed."""


class Button(ui.button, default_props="no-caps flat dense"):
    """A button without a frame."""


class MainButton(ui.button, default_props="no-caps unelevated"):
    """The button for what a view is there for."""


class Choice(ui.select, default_props="dense options-dense outlined"):
    """A list of which one is chosen."""

    def follow(self, options: Sequence[str] | Mapping[str, str], *wanted: str | None) -> Any:
        """Offer other options, and choose the first of those that are wanted and offered; it is returned.

        A list that would be the same stays, so that it is not closed and what is typed in it is not lost.
        """
        value = next((name for name in wanted if name in options), None)
        if (options, value) != (self.options, self.value):
            self.set_options(options, value=value)
        return value


class Toggle(ui.toggle, default_props="no-caps dense unelevated size=sm padding='3px 10px'"):
    """A few of which one is chosen, side by side."""


def bullets(texts: Iterable[str], grey: Iterable[bool] = ()) -> None:
    """Build a list of texts; those that are grey stay behind."""
    rows = list(texts)
    with ui.element("ul").classes("wb-list"):
        for text, is_grey in zip(rows, list(grey) or [False] * len(rows), strict=True):
            with ui.element("li").classes("wb-grey" if is_grey else ""):
                ui.label(text)


@contextlib.contextmanager
def dialog(page, title: str, mark: str = "", is_wide: bool = False) -> Iterator[ui.dialog]:
    """Build a dialog below its title and open it; it goes when it is closed.

    Args:
        page: the window.
        title: what it is about.
        mark: its name in the page.
        is_wide: whether it is as wide as a plot.
    """
    with page.floor, ui.dialog() as found, ui.card().classes("wb-problems" if is_wide else "") as card:
        found.props["aria-label"] = title
        card.props["data-mark"] = mark
        Strong(title)
        yield found
    found.on("hide", found.delete)
    found.open()
