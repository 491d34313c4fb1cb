"""The plots of the page, as figures of Plotly in plain data."""

import itertools
import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from edhas_jax.core.units import unit_text
from edhas_jax.measurements.residual_matrix import COLOUR_RANGE, COLOUR_STOPS, ERROR_LABEL
from edhas_jax.workbench.figure_parts import (
    BOTTOM,
    CONFIG,
    TOP,
    axis_number,
    base_layout,
    numbers,
    plain,
    title_of,
    x_axis,
    y_axis,
)
from edhas_jax.workbench.plot_theme import theme

PANEL, BELOW, BETWEEN = 150.0, 62.0, 26.0  # px: a signal, its residual, the space after them
STAGE, NAME_WIDTH = 64.0, 16  # of the staircase: px of a stage, characters of a line of its name
TICKS = [m * 10**k for k in range(5) for m in (1, 2, 5)]  # of its axis
ERROR = "error / noise"  # a title where ERROR_LABEL has no room
LEAST = 0.6  # residual over noise at the left end of the staircase: a little below 1, the noise of the sensors
WORSE = "#de4a1c"  # colour of an error that rises
SET_POINT = "set point"  # the name of the curve that is drawn as a band


def error_colour(value: float | None) -> tuple[str, str]:
    """Background and text colour of a residual over noise, those of the matrix in the reports."""
    if value is None or math.isnan(value):
        return "transparent", "inherit"
    low, high = map(math.log, COLOUR_RANGE)
    clipped = min(max(value, COLOUR_RANGE[0]), COLOUR_RANGE[1])
    at = (math.log(clipped) - low) / (high - low) * (len(COLOUR_STOPS) - 1)
    k = min(int(at), len(COLOUR_STOPS) - 2)
    mixed = [
        round(a + (at - k) * (b - a)) for a, b in zip(_rgb(COLOUR_STOPS[k]), _rgb(COLOUR_STOPS[k + 1]), strict=True)
    ]
    luminance = 0.299 * mixed[0] + 0.587 * mixed[1] + 0.114 * mixed[2]
    return "#{:02x}{:02x}{:02x}".format(*mixed), "#1b1f24" if luminance > 140 else "#ffffff"


def traces_figure(panels: Sequence[Mapping[str, Any]], dark: bool, shown: Sequence[float] | None) -> dict[str, Any]:
    """Measured and modelled for each panel, the residuals beneath in multiples of the noise; one time axis for all.

    Args:
        panels: from `CampaignCalculations.traces`.
        dark: whether the page is dark.
        shown: first and last time shown [s]; all of it by default.
    """
    colours = theme(dark)
    height = TOP + BOTTOM + len(panels) * (PANEL + BELOW + BETWEEN)
    whole = height - TOP - BOTTOM
    layout = base_layout(colours, height)
    data: list[dict] = []
    for k, panel in enumerate(panels):
        upper, lower = axis_number(2 * k), axis_number(2 * k + 1)
        start = 1.0 - (k * (PANEL + BELOW + BETWEEN) + BETWEEN) / whole
        layout[f"yaxis{upper}"] = y_axis(colours, [start - PANEL / whole, start], unit_text(panel["unit"]))
        end = start - PANEL / whole - 4.0 / whole
        layout[f"yaxis{lower}"] = y_axis(colours, [max(end - BELOW / whole, 0.0), end], ERROR) | {"nticks": 5}
        errors = " → ".join(f"{model['rms']:.2f}" for model in panel["models"].values())
        layout["annotations"].append({
            "text": f"<b>{plain(panel['run'])} · {panel['signal'].replace('_', ' ')}</b>   {errors} × noise",
            "xref": "paper", "yref": "paper", "x": 0.0, "y": start, "xanchor": "left", "yanchor": "bottom",
            "showarrow": False, "font": {"size": 12.5, "color": colours.ink},
        })  # fmt: skip
        layout["shapes"] += [
            {"type": "rect", "xref": "paper", "x0": 0, "x1": 1, "yref": f"y{lower}", "y0": -2, "y1": 2,
             "fillcolor": colours.good, "opacity": 0.13, "line": {"width": 0}, "layer": "below"}
        ]  # fmt: skip
        rows = [("measured", panel["measured"], upper, colours.measured, 1.6)]
        is_alone = len(panel["models"]) == 1
        series = (colours.model,) if is_alone else (colours.grey, colours.model)
        for colour, (name, model) in zip(series, panel["models"].items(), strict=True):
            of_residual = (ERROR_LABEL, colours.residual) if is_alone else (f"{name}: {ERROR_LABEL}", colour)
            rows.append((name, model, upper, colour, 1.4))
            rows.append((of_residual[0], model["residual"], lower, of_residual[1], 1.0))
        for name, row, axis, colour, width in rows:
            data.append({
                "type": "scatter", "mode": "lines", "name": plain(name), "x": row["x"].tolist(),
                "y": numbers(row["y"]), "yaxis": f"y{axis}", "line": {"color": colour, "width": width},
                "legendgroup": name.partition(":")[0], "showlegend": k == 0 and (axis == upper or is_alone),
                "hovertemplate": "%{y:.4g}<extra>" + plain(name) + "</extra>",
            })  # fmt: skip
    layout["xaxis"] = x_axis(colours, "time, s") | {"anchor": f"y{axis_number(2 * len(panels) - 1)}"}
    if shown is not None:
        layout["xaxis"]["range"] = list(shown)
    layout["hovermode"] = "x"
    return {"data": data, "layout": layout, "config": CONFIG}


def residual_figure(found: Mapping[str, Any], signal: str, variable: str, dark: bool) -> dict[str, Any]:
    """The residual of a signal over a variable: points by run, and the mean in bins."""
    colours = theme(dark)
    layout = base_layout(colours, 330.0)
    data = [
        {"type": "scatter", "mode": "markers", "name": plain(run), "x": x.tolist(),
         "y": numbers(y), "marker": {"size": 3.2, "opacity": 0.45, "color": colours.runs[k % len(colours.runs)]},
         "hoverinfo": "skip"}
        for k, (run, x, y) in enumerate(found["runs"])
    ]  # fmt: skip
    x, y = found["bins"]
    data.append({"type": "scatter", "mode": "lines+markers", "name": "mean", "x": x.tolist(), "y": numbers(y),
                 "line": {"color": colours.ink, "width": 2}, "marker": {"size": 4},
                 "hovertemplate": "%{x:.4g}: %{y:.3g} × noise<extra></extra>"})  # fmt: skip
    what = variable if variable == "time" else f"{variable} of the model"
    layout["xaxis"] = x_axis(colours, title_of(what, found["unit"]))
    layout["yaxis"] = y_axis(colours, [0.0, 1.0], f"{signal.replace('_', ' ')}: {ERROR_LABEL}")
    return {"data": data, "layout": layout, "config": CONFIG}


def staircase_figure(stages: Mapping[str, Mapping[str, float]], dark: bool) -> dict[str, Any]:
    """Residual over noise after each stage, an arrow from the stage before; a row of dots for each use of the runs."""
    colours = theme(dark)
    layout, data = base_layout(colours, TOP + BOTTOM + STAGE * len(stages)), []
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
        data.append({
            "type": "scatter", "mode": "markers+text", "name": title, "x": [max(v, LEAST) for _, v in found],
            "y": [y for y, _ in found], "text": [f"{v:.2f}" for _, v in found], "textposition": side,
            "textfont": {"color": colours.ink}, "marker": {"color": colour, "size": 9}, "cliponaxis": False,
            "hovertemplate": "%{text} × noise<extra>" + title + "</extra>",
        })  # fmt: skip
    largest = max((v for row in stages.values() for v in row.values() if v is not None), default=1.0)
    layout["xaxis"] = x_axis(colours, "residual over noise") | {
        "type": "log", "range": [math.log10(LEAST), math.log10(1.6 * max(largest, 1.5))], "tickvals": TICKS,
        "fixedrange": True,
    }  # fmt: skip
    lines = [textwrap.wrap(name.replace("_", " "), NAME_WIDTH, break_long_words=False) for name in stages]
    names = ["<br>".join(map(plain, of_name)) for of_name in lines]
    layout["yaxis"] = {
        "range": [len(stages) - 0.5, -0.5], "tickvals": list(range(len(stages))), "ticktext": names, "automargin": True,
        "tickfont": {"color": colours.ink, "size": 12.5}, "showgrid": False, "zeroline": False, "fixedrange": True,
    }  # fmt: skip
    layout["margin"] |= {"l": 12}
    layout["showlegend"] = True  # Plotly names no series that is alone
    layout["shapes"] = [{"type": "line", "x0": 1, "x1": 1, "yref": "paper", "y0": 0, "y1": 1,
                         "line": {"color": colours.good, "dash": "dash", "width": 1.4}}]  # fmt: skip
    return {"data": data, "layout": layout, "config": CONFIG}


def lines_figure(
    panels: Sequence[tuple[str, str, Sequence[tuple[str, np.ndarray, np.ndarray]]]], x_title: str, dark: bool
) -> dict[str, Any]:
    """Curves in panels above each other over one axis.

    Args:
        panels: title, unit and curves (name, x, y) of each panel.
        x_title: title of the axis.
        dark: whether the page is dark.
    """
    colours = theme(dark)
    height = TOP + BOTTOM + len(panels) * (PANEL + BETWEEN)
    whole = height - TOP - BOTTOM
    layout, data = base_layout(colours, height), []
    named: set[str] = set()  # in the legend
    for k, (title, unit, curves) in enumerate(panels):
        axis = axis_number(k)
        start = 1.0 - (k * (PANEL + BETWEEN) + BETWEEN) / whole
        layout[f"yaxis{axis}"] = y_axis(colours, [max(start - PANEL / whole, 0.0), start], unit_text(unit))
        layout["annotations"].append({
            "text": f"<b>{plain(title)}</b>", "xref": "paper", "yref": "paper", "x": 0.0, "y": start,
            "xanchor": "left", "yanchor": "bottom", "showarrow": False, "font": {"size": 12.5, "color": colours.ink},
        })  # fmt: skip
        series = itertools.cycle((colours.measured, colours.model, colours.good, colours.grey))
        for name, x, y in curves:
            if name == SET_POINT:  # a band, which the curve upon it does not hide
                line = {"color": colours.band, "width": 6.0}
            else:
                line = {"color": next(series), "width": 1.6}
            data.append({
                "type": "scatter", "mode": "lines", "name": plain(name), "x": np.asarray(x).tolist(),
                "y": numbers(y), "yaxis": f"y{axis}", "line": line, "legendgroup": plain(name),
                "showlegend": len(curves) > 1 and name not in named,
            })  # fmt: skip
            named.add(name)
    layout["xaxis"] = x_axis(colours, x_title) | {"anchor": f"y{axis_number(len(panels) - 1)}"}
    return {"data": data, "layout": layout, "config": CONFIG}


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
    colours = theme(dark)
    layout = base_layout(colours, 430.0)
    layout["xaxis"], layout["yaxis"] = x_axis(colours, labels[0]), y_axis(colours, [0.0, 1.0], labels[1])
    bar = {"title": {"text": labels[2], "side": "right"}, "outlinewidth": 0, "thickness": 14}
    data = [{"type": "heatmap", "x": x.tolist(), "y": y.tolist(), "z": [numbers(row) for row in z],
             "colorscale": "Viridis", "colorbar": bar, "hoverongaps": False,
             "hovertemplate": "%{x:.4g}, %{y:.4g}: %{z:.4g}<extra></extra>"}]  # fmt: skip
    return {"data": data, "layout": layout, "config": CONFIG}


def _rgb(colour: str) -> tuple[int, ...]:
    return tuple(int(colour[k : k + 2], 16) for k in (1, 3, 5))


def record_figure(found: Mapping[str, Any], dark: bool) -> dict[str, Any]:
    """A record with what is left out of it, see `DataCalculations.record`."""
    colours = theme(dark)
    layout = base_layout(colours, 280.0)
    layout["xaxis"], layout["yaxis"] = x_axis(colours, "time, s"), y_axis(colours, [0.0, 1.0], unit_text(found["unit"]))
    layout["shapes"] = [
        {"type": "rect", "x0": first, "x1": last, "yref": "paper", "y0": 0, "y1": 1, "fillcolor": colours.grey,
         "opacity": 0.3, "line": {"width": 0}} for first, last in found["gaps"]
    ] + [
        {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": level, "y1": level,
         "line": {"color": colours.grey, "dash": "dash", "width": 1}} for level in found["limits"]
    ]  # fmt: skip
    x, y = found["left_out"]
    data = [
        {"type": "scatter", "mode": "lines", "name": "recorded", "x": found["x"].tolist(), "y": numbers(found["y"]),
         "line": {"color": colours.measured, "width": 1.2}, "showlegend": False},
        {"type": "scatter", "mode": "markers", "name": "left out", "x": x.tolist(), "y": numbers(y),
         "marker": {"color": "#de4a1c", "size": 7, "symbol": "x"}, "showlegend": len(x) > 0},
    ]  # fmt: skip
    return {"data": data, "layout": layout, "config": CONFIG}
