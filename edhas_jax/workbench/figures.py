"""The plots of the page, as figures of Plotly in plain data."""

import itertools
import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from edhas_jax.core.units import unit_text
from edhas_jax.measurements.residual_matrix import COLOUR_RANGE, COLOUR_STOPS, ERROR_LABEL
from edhas_jax.workbench.figure_parts import BOTTOM, TOP, WORSE, Figure, axis, numbers, plain, title_of

PANEL, BELOW, BETWEEN = 150.0, 62.0, 26.0  # px: a signal, its residual with some space above it, the space after them
STAGE, NAME_WIDTH = 64.0, 16  # of the staircase: px of a stage, characters of a line of its name
TICKS = [m * 10**k for k in range(5) for m in (1, 2, 5)]  # of its axis
ERROR = "error / noise"  # a title where ERROR_LABEL has no room
LEAST = 0.6  # residual over noise at the left end of the staircase: a little below 1, the noise of the sensors
SET_POINT = "set point"  # the name of the curve that is drawn as a band


def error_colour(value: float | None) -> tuple[str, str]:
    """Background and text colour of a residual over noise, those of the matrix in the reports."""
    if value is None or math.isnan(value):
        return "transparent", "inherit"
    low, high = map(math.log, COLOUR_RANGE)
    clipped = min(max(value, COLOUR_RANGE[0]), COLOUR_RANGE[1])
    at = (math.log(clipped) - low) / (high - low) * (len(COLOUR_STOPS) - 1)
    k = min(int(at), len(COLOUR_STOPS) - 2)
    ends = ([int(stop[i : i + 2], 16) for i in (1, 3, 5)] for stop in COLOUR_STOPS[k : k + 2])
    mixed = [round(a + (at - k) * (b - a)) for a, b in zip(*ends, strict=True)]
    luminance = 0.299 * mixed[0] + 0.587 * mixed[1] + 0.114 * mixed[2]
    return "#{:02x}{:02x}{:02x}".format(*mixed), "#1b1f24" if luminance > 140 else "#ffffff"


def traces_figure(panels: Sequence[Mapping[str, Any]], dark: bool, shown: Sequence[float] | None) -> dict[str, Any]:
    """Measured and modelled for each panel, the residuals beneath in multiples of the noise; one time axis for all.

    Args:
        panels: from `CampaignCalculations.traces`.
        dark: whether the page is dark.
        shown: first and last time shown [s]; all of it by default.
    """
    figure = Figure(dark, 0.0, "time, s")
    colours = figure.colours
    figure.panels([(BETWEEN, PANEL), (4.0, BELOW - 4.0)] * len(panels))
    for k, panel in enumerate(panels):
        errors = " → ".join(f"{model['rms']:.2f}" for model in panel["models"].values())
        title = f"<b>{plain(panel['run'])} · {panel['signal'].replace('_', ' ')}</b>   {errors} × noise"
        figure.head(2 * k, title, panel["unit"])
        upper, lower = axis(2 * k), axis(2 * k + 1)
        figure.layout[f"yaxis{lower[1:]}"] |= {"title": {"text": ERROR}, "nticks": 5}
        figure.region(colours.good, 0.13, y=(-2, 2), axis=lower)
        rows = [("measured", panel["measured"], upper, colours.measured, 1.6)]
        is_alone = len(panel["models"]) == 1
        series = (colours.model,) if is_alone else (colours.grey, colours.model)
        for colour, (name, model) in zip(series, panel["models"].items(), strict=True):
            of_residual = (ERROR_LABEL, colours.residual) if is_alone else (f"{name}: {ERROR_LABEL}", colour)
            rows.append((name, model, upper, colour, 1.4))
            rows.append((of_residual[0], {"x": model["x"]} | model["residual"], lower, of_residual[1], 1.0))
        for name, row, of_axis, colour, width in rows:
            figure.curve(name, row["x"], row["y"], colour, width, yaxis=of_axis, legendgroup=name.partition(":")[0],
                         showlegend=k == 0 and (of_axis == upper or is_alone),
                         hovertemplate="%{y:.4g}<extra>" + plain(name) + "</extra>")  # fmt: skip
    if shown is not None:
        figure.layout["xaxis"]["range"] = list(shown)
    figure.layout["hovermode"] = "x"
    return figure.plain


def residual_figure(found: Mapping[str, Any], signal: str, variable: str, dark: bool) -> dict[str, Any]:
    """The residual of a signal over a variable: points by run, and the mean in bins."""
    what = variable if variable == "time" else f"{variable} of the model"
    figure = Figure(dark, 330.0, title_of(what, found["unit"]), f"{signal.replace('_', ' ')}: {ERROR_LABEL}")
    runs = figure.colours.runs
    for k, (run, x, y) in enumerate(found["runs"]):
        marker = {"size": 3.2, "opacity": 0.45, "color": runs[k % len(runs)]}
        figure.curve(run, x, y, runs[k % len(runs)], mode="markers", marker=marker, hoverinfo="skip")
    figure.curve("mean", *found["bins"], figure.colours.ink, 2, mode="lines+markers", marker={"size": 4},
                 hovertemplate="%{x:.4g}: %{y:.3g} × noise<extra></extra>")  # fmt: skip
    return figure.plain


def staircase_figure(stages: Mapping[str, Mapping[str, float]], dark: bool) -> dict[str, Any]:
    """Residual over noise after each stage, an arrow from the stage before; a row of dots for each use of the runs."""
    figure = Figure(dark, TOP + BOTTOM + STAGE * len(stages), "residual over noise")
    colours, layout = figure.colours, figure.layout
    series = {
        "fit": ("runs used", colours.residual, -0.1, "top center"),
        "holdout": ("runs not used", colours.measured, 0.1, "bottom center"),
    }
    series = {use: row for use, row in series.items() if any(stage.get(use) is not None for stage in stages.values())}
    for use, (title, colour, below, side) in series.items():
        found = [(k + below, row[use]) for k, row in enumerate(stages.values()) if row.get(use) is not None]
        for (_, old), (y, value) in itertools.pairwise(found):
            ends = [math.log10(max(v, LEAST)) for v in (old, value)]
            if ends[0] != ends[1]:
                layout["annotations"].append({
                    "x": ends[1], "ax": ends[0], "y": y, "ay": y, "axref": "x", "ayref": "y", "text": "",
                    "showarrow": True, "arrowhead": 2, "arrowwidth": 2, "standoff": 6,
                    "arrowcolor": colours.good if value < old else WORSE,
                })  # fmt: skip
        figure.curve(
            title, [max(v, LEAST) for _, v in found], [y for y, _ in found], colour, mode="markers+text",
            text=[f"{v:.2f}" for _, v in found], textposition=side, textfont={"color": colours.ink},
            marker={"color": colour, "size": 9}, cliponaxis=False,
            hovertemplate="%{text} × noise<extra>" + title + "</extra>",
        )  # fmt: skip
    largest = max((v for row in stages.values() for v in row.values() if v is not None), default=1.0)
    layout["xaxis"] |= {
        "type": "log", "range": [math.log10(LEAST), math.log10(1.6 * max(largest, 1.5))], "tickvals": TICKS,
        "fixedrange": True,
    }  # fmt: skip
    lines = [textwrap.wrap(name.replace("_", " "), NAME_WIDTH, break_long_words=False) for name in stages]
    names = ["<br>".join(map(plain, of_name)) for of_name in lines]
    layout["yaxis"] = {
        "range": [len(stages) - 0.5, -0.5], "tickvals": list(range(len(stages))), "ticktext": names, "automargin": True,
        "tickfont": {"color": colours.ink, "size": 12.5}, "showgrid": False, "fixedrange": True,
    }  # fmt: skip
    layout["margin"] = {"l": 12}
    layout["showlegend"] = True  # Plotly names no series that is alone
    figure.line(colours.good, "dash", 1.4, x=(1,))
    return figure.plain


def lines_figure(
    panels: Sequence[tuple[str, str, Sequence[tuple[str, np.ndarray, np.ndarray]]]], x_title: str, dark: bool
) -> dict[str, Any]:
    """Curves in panels above each other over one axis.

    Args:
        panels: title, unit and curves (name, x, y) of each panel.
        x_title: title of the axis.
        dark: whether the page is dark.
    """
    figure = Figure(dark, 0.0, x_title)
    colours = figure.colours
    figure.panels([(BETWEEN, PANEL)] * len(panels))
    named: set[str] = set()  # in the legend
    for k, (title, unit, curves) in enumerate(panels):
        figure.head(k, f"<b>{plain(title)}</b>", unit)
        series = itertools.cycle((colours.measured, colours.model, colours.good, colours.grey))
        for name, x, y in curves:  # the set point is a band, which the curve upon it does not hide
            colour, width = (colours.band, 6.0) if name == SET_POINT else (next(series), 1.6)
            figure.curve(name, x, y, colour, width, yaxis=axis(k), legendgroup=plain(name),
                         showlegend=len(curves) > 1 and name not in named)  # fmt: skip
            named.add(name)
    return figure.plain


def heat_map_figure(
    x: np.ndarray, y: np.ndarray, z: np.ndarray, labels: tuple[str, str, str], dark: bool
) -> dict[str, Any]:
    """A metric over two parameters of a grid.

    Args:
        x: values of the horizontal parameter (m,).
        y: values of the vertical parameter (n,).
        z: the metric (n, m); NaN where a design has failed.
        labels: titles of x, y and z with units.
        dark: whether the page is dark.
    """
    figure = Figure(dark, 430.0, *labels[:2])
    bar = {"title": {"text": labels[2], "side": "right"}, "outlinewidth": 0, "thickness": 14}
    figure.data.append({"type": "heatmap", "x": x.tolist(), "y": y.tolist(), "z": [numbers(row) for row in z],
                        "colorscale": "Viridis", "colorbar": bar, "hoverongaps": False,
                        "hovertemplate": "%{x:.4g}, %{y:.4g}: %{z:.4g}<extra></extra>"})  # fmt: skip
    return figure.plain


def record_figure(found: Mapping[str, Any], dark: bool) -> dict[str, Any]:
    """A record with what is left out of it, see `DataCalculations.record`."""
    figure = Figure(dark, 280.0, "time, s", unit_text(found["unit"]))
    colours = figure.colours
    for gap in found["gaps"]:
        figure.region(colours.grey, 0.3, x=gap)
    figure.line(colours.grey, "dash", 1, y=found["limits"])
    figure.curve("recorded", found["x"], found["y"], colours.measured, 1.2, showlegend=False)
    x, y = found["left_out"]
    marker = {"color": WORSE, "size": 7, "symbol": "x"}
    figure.curve("left out", x, y, WORSE, mode="markers", marker=marker, showlegend=len(x) > 0)
    return figure.plain
