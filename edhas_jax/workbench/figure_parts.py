"""What the plots of the page share: layout, axes, texts and numbers for Plotly."""

import math
from typing import Any

import numpy as np

from edhas_jax.core.chart import Chart, Style, Tone
from edhas_jax.core.units import unit_text
from edhas_jax.workbench.plot_theme import Theme, theme

TOP, BOTTOM = 26.0, 46.0  # px, of a plot
# the buttons of Plotly would lie on the legend: one drags to zoom, clicks twice to go back, and saves beside the plot
CONFIG = {"displayModeBar": False, "responsive": True}


def base_layout(colours: Theme, height: float) -> dict[str, Any]:
    """The layout of a plot of a height [px]; axes, annotations and shapes are added."""
    return {
        "height": height, "margin": {"l": 62, "r": 16, "t": TOP, "b": BOTTOM}, "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)", "font": {"family": "system-ui, sans-serif", "size": 12, "color": colours.grey},
        "legend": {"orientation": "h", "x": 1.0, "xanchor": "right", "y": 1.0, "yanchor": "bottom",
                   "font": {"color": colours.ink}},
        "annotations": [], "shapes": [], "dragmode": "zoom",
        "hoverlabel": {"font": {"family": "system-ui, sans-serif"}},
    }  # fmt: skip


def x_axis(colours: Theme, title: str) -> dict[str, Any]:
    """A horizontal axis."""
    return {"title": {"text": title, "font": {"color": colours.ink}, "standoff": 8}, "gridcolor": colours.grid,
            "zeroline": False, "linecolor": colours.grid}  # fmt: skip


def y_axis(colours: Theme, domain: list[float], title: str) -> dict[str, Any]:
    """A vertical axis over a part of the height, 0 … 1."""
    return {"domain": domain, "title": {"text": title, "font": {"size": 11.5, "color": colours.ink}, "standoff": 4},
            "gridcolor": colours.grid, "zeroline": False, "fixedrange": False, "nticks": 6}  # fmt: skip


def axis_number(k: int) -> str:
    """The number of an axis as Plotly writes it: the first one has none."""
    return "" if k == 0 else str(k + 1)


def numbers(values) -> list[float | None]:
    """Numbers for JSON, which has no NaN."""
    return [float(v) if math.isfinite(v) else None for v in np.asarray(values, float)]


def plain(text: str) -> str:
    """A text that Plotly does not take for markup."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def title_of(name: str, unit: str) -> str:
    """The title of an axis."""
    return name.replace("_", " ") + (f", {unit_text(unit)}" if unit_text(unit) else "")


def chart_figure(chart: Chart, height: float, dark: bool) -> dict[str, Any]:
    """A chart as a figure of Plotly of a height [px]."""
    colours = theme(dark)
    of_tone = {Tone.DATA: colours.measured, Tone.MODEL: colours.model, Tone.BESIDE: colours.grey}
    layout, data = base_layout(colours, height), []
    for band in chart.bands:
        x, y = np.concatenate([band.x, band.x[::-1]]), np.concatenate([band.low, band.high[::-1]])
        data.append({"type": "scatter", "mode": "lines", "x": numbers(x), "y": numbers(y), "line": {"width": 0},
                     "fill": "toself", "fillcolor": of_tone[band.tone], "opacity": 0.22, "showlegend": False,
                     "hoverinfo": "skip"})  # fmt: skip
    for name, x, y, tone, style, error in chart.curves:
        mode = {Style.MARKS: "markers", Style.MARKED: "lines+markers"}.get(style, "lines")
        line = {"color": of_tone[tone], "width": 1.6, "dash": "dash" if style is Style.DASHED else "solid"}
        data.append({"type": "scatter", "mode": mode, "name": plain(name), "x": numbers(x), "y": numbers(y),
                     "line": line, "marker": {"size": 5, "color": of_tone[tone]}, "showlegend": bool(name),
                     "hovertemplate": "%{x:.5g}: %{y:.5g}<extra></extra>"})  # fmt: skip
        if error is not None:  # Plotly leaves space for error bars, even where there are none
            data[-1]["error_y"] = {"array": numbers(error), "thickness": 1, "width": 3}
    line = {"color": colours.model, "dash": "dot", "width": 1.2}
    layout["shapes"] = [
        {"type": "line", "line": line, f"{along}ref": "paper", f"{along}0": 0, f"{along}1": 1, f"{across}0": place,
         f"{across}1": place} for along, across, places in (("x", "y", chart.levels), ("y", "x", chart.stops))
        for place in places
    ]  # fmt: skip
    layout["xaxis"] = x_axis(colours, plain(chart.x_title))
    layout["yaxis"] = y_axis(colours, [0.0, 1.0], plain(chart.y_title))
    if chart.y_range is not None:
        layout["yaxis"]["range"] = list(chart.y_range)
    return {"data": data, "layout": layout, "config": CONFIG}
