"""What the plots of the page share: layout, axes, texts and numbers for Plotly."""

import math
from typing import Any

import numpy as np

from edhas_jax.workbench.plot_theme import Theme

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
