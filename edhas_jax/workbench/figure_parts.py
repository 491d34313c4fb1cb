"""What the plots of the page are made of: colours on a light and on a dark page, axes, curves, numbers for Plotly."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from edhas_jax.core.chart import Chart, Style, Tone
from edhas_jax.core.plot_style import COLOURS
from edhas_jax.core.units import unit_text

TOP, BOTTOM = 26.0, 46.0  # px, of a plot
# the buttons of Plotly would lie on the legend: one drags to zoom, clicks twice to go back, and saves beside the plot
CONFIG = {"displayModeBar": False, "responsive": True}
FONT = "system-ui, sans-serif"
WORSE = "#de4a1c"  # colour of an error that rises, and of samples that are left out


@dataclasses.dataclass(frozen=True)
class Theme:
    """Colours of plots on a light or a dark page."""

    ink: str
    grey: str
    grid: str
    measured: str
    model: str
    residual: str
    good: str
    band: str
    runs: tuple[str, ...]


LIGHT_RUNS = (*COLOURS, "#bf3989", "#57606a", "#0a7ea4")
DARK_RUNS = ("#6cb6ff", "#ff9a5c", "#4fd1c5", "#c99bea", "#d9c6a5", "#ff8fc7", "#aab4bf", "#8fd14f")
LIGHT = Theme(
    "#1b1f24", "#59636e", "#e4e7eb", COLOURS[0], COLOURS[1], "#6e7781", COLOURS[2], "#c3cad1", LIGHT_RUNS
)  # fmt: skip
DARK = Theme("#e6edf3", "#9aa4af", "#30363d", "#6cb6ff", "#ff9a5c", "#9aa4af", "#57c78b", "#57606a", DARK_RUNS)


class Figure:
    """A figure of Plotly that grows: curves over one horizontal axis, in one panel or in several above each other.

    Args:
        dark: whether the page is dark.
        height: of the plot [px].
        x_title: of the horizontal axis.
        y_title: of the vertical axis.

    Attributes:
        colours: of the page.
        layout: of Plotly, as plain data; what Plotly needs beside it stands in its `template`.
        data: the traces.
    """

    def __init__(self, dark: bool, height: float, x_title: str = "", y_title: str = ""):
        self.colours = DARK if dark else LIGHT
        self.data: list[dict[str, Any]] = []
        self.layout: dict[str, Any] = {
            "template": {"layout": _usual_layout(self.colours)}, "height": height, "annotations": [], "shapes": [],
            "xaxis": {"title": {"text": x_title}}, "yaxis": {"title": {"text": y_title}},
        }  # fmt: skip

    @property
    def plain(self) -> dict[str, Any]:
        """The figure as Plotly takes it."""
        return {"data": self.data, "layout": self.layout, "config": CONFIG}

    def curve(self, name: str, x, y, colour: str, width: float = 1.6, **more: Any) -> None:
        """Draw a curve; `more` are further properties of its trace."""
        line = {"color": colour, "width": width}
        self.data.append({"type": "scatter", "mode": "lines", "name": plain(name), "x": numbers(x), "y": numbers(y),
                          "line": line, **more})  # fmt: skip

    def region(self, colour: str, opacity: float, *, x: Sequence[float] = (), y: Sequence[float] = (),
               axis: str = "y") -> None:  # fmt: skip
        """Shade what lies between two values of x, or of y (of a vertical axis), below the curves."""
        self._shape("rect", x, y, axis, fillcolor=colour, opacity=opacity, line={"width": 0}, layer="below")

    def line(self, colour: str, dash: str, width: float, *, x: Sequence[float] = (), y: Sequence[float] = ()) -> None:
        """Draw a line through the whole plot at each value of x and of y."""
        for value in x:
            self._shape("line", (value, value), (), "y", line={"color": colour, "dash": dash, "width": width})
        for value in y:
            self._shape("line", (), (value, value), "y", line={"color": colour, "dash": dash, "width": width})

    def _shape(self, kind: str, x: Sequence[float], y: Sequence[float], axis: str, **more: Any) -> None:
        """A shape between values of x and y; through the whole plot where there are none."""
        places = {"xref": "x" if x else "paper", "yref": axis if y else "paper"}
        places |= dict(zip(("x0", "x1", "y0", "y1"), (*(x or (0, 1)), *(y or (0, 1))), strict=True))
        self.layout["shapes"].append({"type": kind, **places, **more})

    def panels(self, places: Sequence[tuple[float, float]]) -> None:
        """Divide the plot into panels above each other, with the vertical axes `axis(0)`, `axis(1)` and so on.

        Args:
            places: space above and height of each panel [px].
        """
        whole = sum(map(sum, places))
        self.layout["height"], top = TOP + BOTTOM + whole, 0.0
        for k, (above, height) in enumerate(places):
            ends = 1.0 - (top + above + height) / whole, 1.0 - (top + above) / whole
            self.layout[f"yaxis{axis(k)[1:]}"] = {"domain": [max(ends[0], 0.0), ends[1]], "title": {}}
            top += above + height
        self.layout["xaxis"]["anchor"] = axis(len(places) - 1)

    def head(self, k: int, text: str, unit: str) -> None:
        """Write a text with markup above panel `k`, and its unit beside it."""
        panel = self.layout[f"yaxis{axis(k)[1:]}"]
        panel["title"]["text"] = unit_text(unit)
        self.layout["annotations"].append({
            "text": text, "xref": "paper", "yref": "paper", "x": 0.0, "y": panel["domain"][1], "xanchor": "left",
            "yanchor": "bottom", "showarrow": False, "font": {"size": 12.5, "color": self.colours.ink},
        })  # fmt: skip


def _usual_layout(colours: Theme) -> dict[str, Any]:
    """What Plotly takes for every plot of a page where the plot itself does not say otherwise."""
    ink = {"color": colours.ink}
    either = {"gridcolor": colours.grid, "zeroline": False}
    return {
        "margin": {"l": 62, "r": 16, "t": TOP, "b": BOTTOM}, "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)", "font": {"family": FONT, "size": 12, "color": colours.grey},
        "legend": {"orientation": "h", "x": 1.0, "xanchor": "right", "y": 1.0, "yanchor": "bottom", "font": ink},
        "dragmode": "zoom", "hoverlabel": {"font": {"family": FONT}},
        "xaxis": either | {"showline": True, "linecolor": colours.grid, "title": {"font": ink, "standoff": 8}},
        "yaxis": either | {"nticks": 6, "title": {"font": ink | {"size": 11.5}, "standoff": 4}},
    }  # fmt: skip


def axis(k: int) -> str:
    """The name of a vertical axis in a trace: the first one has no number."""
    return "y" if k == 0 else f"y{k + 1}"


def numbers(values) -> list[float | None]:
    """Numbers for JSON, which has no NaN."""
    values = np.asarray(values, float)
    return np.where(np.isfinite(values), values, None).tolist()


def plain(text: str) -> str:
    """A text that Plotly does not take for markup."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def title_of(name: str, unit: str) -> str:
    """The title of an axis."""
    return name.replace("_", " ") + (f", {unit_text(unit)}" if unit_text(unit) else "")


def chart_figure(chart: Chart, height: float, dark: bool) -> Figure:
    """A chart as a figure of Plotly of a height [px]."""
    figure = Figure(dark, height, plain(chart.x_title), plain(chart.y_title))
    colours = figure.colours
    of_tone = {Tone.DATA: colours.measured, Tone.MODEL: colours.model, Tone.BESIDE: colours.grey}
    for band in chart.bands:
        x, y = np.concatenate([band.x, band.x[::-1]]), np.concatenate([band.low, band.high[::-1]])
        colour = of_tone[band.tone]
        figure.curve("", x, y, colour, 0, fill="toself", fillcolor=colour, opacity=0.22, showlegend=False,
                     hoverinfo="skip")  # fmt: skip
    modes = {Style.MARKS: "markers", Style.MARKED: "lines+markers"}
    for name, x, y, tone, style, error in chart.curves:
        # Plotly leaves space for error bars even where there are none
        bars = {} if error is None else {"error_y": {"array": numbers(error), "thickness": 1, "width": 3}}
        figure.curve(name, x, y, of_tone[tone], mode=modes.get(style, "lines"), showlegend=bool(name),
                     marker={"size": 5, "color": of_tone[tone]}, hovertemplate="%{x:.5g}: %{y:.5g}<extra></extra>",
                     **bars)  # fmt: skip
        figure.data[-1]["line"]["dash"] = "dash" if style is Style.DASHED else "solid"
    figure.line(colours.model, "dot", 1.2, x=chart.stops, y=chart.levels)
    if chart.y_range is not None:
        figure.layout["yaxis"]["range"] = list(chart.y_range)
    return figure
