"""A plot that is on the page only while it has something to show, and that can be saved."""

import json
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from typing import Any

from nicegui import ui

from edhas_jax.workbench.views.save import save_button, save_csv

PICTURE = """(async () => {{
  const plot = getHtmlElement({id}), {{ Plotly }} = await import('nicegui-plotly');
  const paper = getComputedStyle(document.body).backgroundColor;
  const layout = {{...plot.layout, paper_bgcolor: paper, plot_bgcolor: paper}};
  const size = {{width: plot.offsetWidth, height: plot.offsetHeight}};
  await Plotly.downloadImage({{data: plot.data, layout}}, {{format: {format}, filename: {name}, scale: 2, ...size}});
}})()"""


class Plot:
    """A place for one figure.

    Args:
        mark: its name in the page, and that of the files.
        handlers: called with the event, by name of the event of Plotly.
        samples: gives the head and the rows of the CSV file where the figure has not all samples; None where there are
            none.
    """

    def __init__(
        self, mark: str, handlers: Mapping[str, Callable] | None = None,
        samples: Callable[[], Awaitable[Sequence[Sequence[Any]] | None]] | None = None,
    ):  # fmt: skip
        self._mark, self._handlers, self._samples = mark, dict(handlers or {}), samples
        self._place = ui.column().classes("w-full gap-0 wb-plot")
        self._figure: dict[str, Any] = {}
        self.element: ui.plotly | None = None

    def show(self, figure: Mapping[str, Any]) -> None:
        """Draw a figure, in place of the last one; nothing where the view was built anew while it was calculated."""
        if self._place.is_deleted:  # what is added to it would stay in memory
            return
        self._figure = dict(figure)
        height = f"height: {figure['layout']['height']:.0f}px"  # which Plotly forgets where the window changes its size
        if self.element is not None:
            self.element.style(replace=height)
            self.element.update_figure(self._figure)
            return
        with self._place:
            self.element = ui.plotly(self._figure).classes("w-full").style(height).props(f"data-mark={self._mark}")
            formats = {"PNG": lambda: self._save_picture("png"), "SVG": lambda: self._save_picture("svg")}
            save_button(self._mark, formats | {"CSV": self._save_csv}).classes("wb-save")
        for name, handler in self._handlers.items():
            self.element.on(name, handler)

    def hide(self) -> None:
        """Take the figure from the page."""
        self._place.clear()
        self.element = None

    def bring_into_view(self) -> None:
        """Scroll the page to the figure."""
        if self.element is not None:
            where = "{behavior: 'smooth', block: 'start'}"
            ui.run_javascript(f"getHtmlElement({self.element.id})?.scrollIntoView({where})")

    def _save_picture(self, suffix: str) -> None:
        ui.run_javascript(
            PICTURE.format(id=self.element.id, format=json.dumps(suffix), name=json.dumps(self._mark))
        )

    async def _save_csv(self) -> None:
        rows = list(_points(self._figure)) if self._samples is None else await self._samples()
        if rows is not None:
            save_csv(self._mark, rows)


def _points(figure: Mapping[str, Any]) -> Iterator[Sequence[Any]]:
    """The points of all curves of a figure, or the cells of its heat map, below their head."""
    yield "curve", "x", "y", "value"
    for trace in figure["data"]:
        name = trace.get("name", "")
        if "z" in trace:
            for y, row in zip(trace["y"], trace["z"], strict=True):
                yield from ((name, x, y, value) for x, value in zip(trace["x"], row, strict=True))
        else:
            yield from ((name, x, y, None) for x, y in zip(trace["x"], trace["y"], strict=True))
