"""A chart, described once: matplotlib draws it in files (`draw_chart`), the page in the browser with Plotly."""

import enum
from typing import NamedTuple

import numpy as np

from edhas_jax.core.plot_style import COLOURS, GREY, GRID, INK
from edhas_jax.core.units import format_number

LOG_TICKS = (1.0, 2.0, 5.0)  # within a decade of a logarithmic axis


class Tone(enum.Enum):
    """What a part of a chart shows; its value is the colour on white."""

    DATA = COLOURS[0]
    MODEL = COLOURS[1]
    BESIDE = GREY


class Style(enum.Enum):
    """How a curve is drawn."""

    LINE = "-"
    DASHED = "--"
    MARKS = "o"
    MARKED = "o-"


class Curve(NamedTuple):
    """A curve: name in the legend, "" for none, values (n,) across and up, half the length of error bars (n,)."""

    name: str
    x: np.ndarray
    y: np.ndarray
    tone: Tone = Tone.DATA
    style: Style = Style.LINE
    error: np.ndarray | None = None


class Band(NamedTuple):
    """An area between two curves over the same values (n,)."""

    x: np.ndarray
    low: np.ndarray
    high: np.ndarray
    tone: Tone = Tone.DATA


class Chart(NamedTuple):
    """Curves over one axis.

    Attributes:
        x_title: of the horizontal axis, with its unit.
        y_title: of the vertical axis, with its unit.
        curves: drawn in this order.
        bands: drawn below them.
        levels: heights of dotted lines across the chart.
        stops: places of dotted lines from bottom to top.
        y_range: lower and upper end of the vertical axis; None: as the curves need.
    """

    x_title: str
    y_title: str
    curves: tuple[Curve, ...]
    bands: tuple[Band, ...] = ()
    levels: tuple[float, ...] = ()
    stops: tuple[float, ...] = ()
    y_range: tuple[float, float] | None = None


def draw_chart(axes, chart: Chart) -> None:
    """Draw a chart into axes of matplotlib; the legend is left to the figure."""
    for band in chart.bands:
        axes.fill_between(band.x, band.low, band.high, color=band.tone.value, alpha=0.2, lw=0)
    for curve in chart.curves:
        axes.errorbar(curve.x, curve.y, curve.error, fmt=curve.style.value, color=curve.tone.value, lw=1.6, ms=4,
                      capsize=2, elinewidth=1.0, label=curve.name or None)  # fmt: skip
    for draw, places in ((axes.axhline, chart.levels), (axes.axvline, chart.stops)):
        for place in places:
            draw(place, color=Tone.MODEL.value, lw=0.9, ls=":")
    axes.set_ylim(chart.y_range)
    style_axes(axes, chart.x_title, chart.y_title)


def style_axes(axes, x_title: str = "", y_title: str = "", grid: str = "both", size: float = 9) -> None:
    """Give axes of matplotlib their titles in a size [pt], a grid ("both", or of the axis "x" alone), and no frame.

    Ticks with texts are set after it.
    """
    axes.set_xlabel(x_title, fontsize=size, color=INK)
    axes.set_ylabel(y_title, fontsize=size, color=INK)
    axes.grid(axis=grid, color=GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=GREY, labelsize=size - 1)


def add_colour_bar(figure, drawn, axes, label: str, aspect: float = 28, pad: float = 0.02):
    """Add a bar of the colours of what was `drawn` into axes of matplotlib, without a frame; returns it."""
    bar = figure.colorbar(drawn, ax=axes, pad=pad, aspect=aspect)
    bar.set_label(label, color=INK)
    bar.outline.set_visible(False)
    return bar


def add_title(figure, text: str, size: float = 11) -> None:
    """Add a title above all axes of a figure of matplotlib, in a size [pt], from its left edge."""
    figure.suptitle(text, x=0.01, ha="left", fontsize=size, color=INK)


def set_log_scale(axis) -> None:
    """Give an axis of matplotlib, such as `axes.xaxis`, a logarithmic scale with ticks at 1, 2, 5, 10, …."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.axes.set(**{f"{axis.axis_name}scale": "log"})
    axis.set_major_locator(LogLocator(subs=LOG_TICKS))
    axis.set_major_formatter(FuncFormatter(lambda value, _: format_number(value, 3)))
    axis.set_minor_formatter(NullFormatter())
