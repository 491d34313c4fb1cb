"""A plot that is on the page only while it has something to show."""

from collections.abc import Callable, Mapping
from typing import Any

from nicegui import ui


class Plot:
    """A place for one figure.

    Args:
        mark: its name in the page.
        handlers: called with the event, by name of the event of Plotly.
    """

    def __init__(self, mark: str, handlers: Mapping[str, Callable] | None = None):
        self._mark, self._handlers = mark, dict(handlers or {})
        self._place = ui.column().classes("w-full gap-0")
        self.element: ui.plotly | None = None

    def show(self, figure: Mapping[str, Any]) -> None:
        """Draw a figure, in place of the last one."""
        height = f"height: {figure['layout']['height']:.0f}px"  # which Plotly forgets where the window changes its size
        if self.element is not None:
            self.element.style(replace=height)
            self.element.update_figure(dict(figure))
            return
        with self._place:
            self.element = ui.plotly(dict(figure)).classes("w-full").style(height).props(f"data-mark={self._mark}")
        for name, handler in self._handlers.items():
            self.element.on(name, handler)

    def hide(self) -> None:
        """Take the figure from the page."""
        self._place.clear()
        self.element = None
