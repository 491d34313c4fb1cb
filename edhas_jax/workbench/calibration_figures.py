"""The plots of the view Calibrate, as figures of Plotly in plain data."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from edhas_jax.core.chart import Chart, Curve, Style, Tone
from edhas_jax.core.units import display_unit, from_si, unit_text
from edhas_jax.workbench.figure_parts import TOP, Figure, chart_figure, numbers, plain, title_of

HEIGHT = 300.0  # px
CELL, NAMES = 34.0, 150.0  # px of the correlations: a cell, the space for names
CHI2_95_OF_TWO = 5.991  # 95 % quantile of χ² with two degrees of freedom
MARGIN = 0.05  # share of the width of the ellipse beside it, as Plotly leaves above it
OUTSIDE = 0.22  # opacity of the samples that a window leaves out


def cost_figure(steps: Sequence[Mapping[str, Any]], dark: bool) -> dict[str, Any]:
    """½χ² after each step of the searches of a fit.

    Args:
        steps: by step `search`, `cost` and `residual_over_noise`, as of `FitStep`.
        dark: whether the page is dark.
    """
    figure = Figure(dark, HEIGHT, "step", "½ χ²")
    finite = [(k, step) for k, step in enumerate(steps, 1) if math.isfinite(step["cost"])]
    searches = dict.fromkeys(step["search"] for _, step in finite)
    for name, colour in zip(searches, (figure.colours.grey, figure.colours.model), strict=False):
        rows = [(k, step) for k, step in finite if step["search"] == name]
        figure.curve(
            name, [k for k, _ in rows], [step["cost"] for _, step in rows], colour, mode="lines+markers",
            marker={"size": 5}, customdata=[step["residual_over_noise"] for _, step in rows],
            hovertemplate="½χ² %{y:.5g}<br>residual over noise %{customdata:.3f}<extra></extra>",
        )  # fmt: skip
    figure.layout["xaxis"]["rangemode"] = "tozero"
    figure.layout["yaxis"] |= {"type": "log", "tickformat": ".3~s", "automargin": True}
    return figure.plain


def trajectory_figure(
    measured: Mapping[str, Any], curves: Mapping[str, Mapping[str, Any]], unit: str,
    window: tuple[float, float] | None, dark: bool, draws: bool,
) -> dict[str, Any]:  # fmt: skip
    """A signal of a run as it was measured and as the fit has it, with the time window that is used.

    Args:
        measured: `x` and `y`.
        curves: the same by name of the model, the one before first.
        unit: of the signal.
        window: first and last time that are used [s]; None for all.
        dark: whether the page is dark.
        draws: whether a drag draws the window; otherwise it zooms.
    """
    tones = (Tone.MODEL,) if len(curves) == 1 else (Tone.BESIDE, Tone.MODEL)
    rows = [Curve("measured", measured["x"], measured["y"])]
    rows += [Curve(n, row["x"], row["y"], tone) for (n, row), tone in zip(curves.items(), tones, strict=False)]
    figure = chart_figure(Chart("time, s", unit_text(unit), tuple(rows)), HEIGHT, dark)
    first, last = float(measured["x"][0]), float(measured["x"][-1])
    if window is not None:
        for side in ((first, min(window[0], last)), (max(window[1], first), last)):
            if side[1] > side[0]:
                figure.region(figure.colours.grey, OUTSIDE, x=side)
    figure.layout |= {"hovermode": "x"} | ({"dragmode": "select", "selectdirection": "h"} if draws else {})
    return figure.plain


def correlation_figure(correlation: Mapping[str, Mapping[str, float | None]], dark: bool) -> dict[str, Any]:
    """The correlations of the estimates as a matrix."""
    figure = Figure(dark, TOP + NAMES + CELL * len(correlation))
    values = [[math.nan if v is None else v for v in row.values()] for row in correlation.values()]
    shown = [["" if math.isnan(v) else f"{v:+.2f}" for v in row] for row in values]
    either = {"tickfont": {"color": figure.colours.ink, "size": 11.5}, "showgrid": False, "showline": False,
              "fixedrange": True, "automargin": True}  # fmt: skip
    labels = [plain(name.replace("_", " ")) for name in correlation]
    figure.layout["xaxis"] = either | {"tickangle": -40}
    figure.layout["yaxis"] = either | {"autorange": "reversed"}
    figure.layout["margin"] = {"l": 20, "r": 16, "t": 8, "b": 40}
    figure.data.append({
        "type": "heatmap", "x": labels, "y": labels, "z": [numbers(row) for row in values], "zmin": -1, "zmax": 1,
        "colorscale": [[0, "#2166ac"], [0.5, "#f7f7f7" if not dark else "#30363d"], [1, "#b2182b"]],
        "showscale": False, "text": shown, "texttemplate": "%{text}", "textfont": {"size": 11},
        "hovertemplate": "%{y}, %{x}: %{z:.3f}<extra></extra>", "xgap": 1, "ygap": 1,
    })  # fmt: skip
    return figure.plain


def ellipse_figure(fit: Mapping[str, Any], one: str, other: str, dark: bool) -> dict[str, Any]:
    """The ellipse in which two parameters lie together with a probability of 95 %, by their covariance.

    Args:
        fit: the content of `fit.json`.
        one: parameter of the horizontal axis.
        other: parameter of the vertical axis.
        dark: whether the page is dark.
    """
    rows = [fit["calibrated"][name] for name in (one, other)]
    correlation = fit["correlation"][one][other]
    units = [display_unit(row["unit"], row["value"]) for row in rows]
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    circle = math.sqrt(CHI2_95_OF_TWO) * np.array([np.cos(angle), np.sin(angle)])
    across = correlation * circle[0] + math.sqrt(max(1.0 - correlation**2, 0.0)) * circle[1]
    x, y = (
        from_si(row["value"] + row["std"] * part, row["unit"], unit)
        for row, part, unit in zip(rows, (circle[0], across), units, strict=True)
    )
    centre = [np.array([from_si(row["value"], row["unit"], unit)]) for row, unit in zip(rows, units, strict=True)]
    curves = Curve("95 % of both together", x, y), Curve("estimate", *centre, Tone.MODEL, Style.MARKS)
    figure = chart_figure(Chart(*map(title_of, (one, other), units), curves), HEIGHT, dark)
    figure.layout["xaxis"]["range"] = [float(x.min() - MARGIN * np.ptp(x)), float(x.max() + MARGIN * np.ptp(x))]
    return figure.plain


def autocorrelation_figure(found: Mapping[str, Any], dark: bool) -> dict[str, Any]:
    """The autocorrelation of a residual with the band of white noise, see `FitCalculations.autocorrelation`."""
    figure = Figure(dark, HEIGHT, "lag, ms", "autocorrelation")
    colours, band = figure.colours, found["band"]
    lag, value = np.asarray(found["lag"])[1:], np.asarray(found["value"])[1:]
    figure.data.append({
        "type": "bar", "name": "autocorrelation", "x": lag.tolist(), "y": numbers(value),
        "marker": {"color": [colours.model if abs(v) > band else colours.measured for v in value]},
        "hovertemplate": "%{x:.4g} ms: %{y:.3f}<extra></extra>", "showlegend": False,
    })  # fmt: skip
    figure.region(colours.good, 0.18, y=(-band, band))
    reach = 1.1 * max(float(np.nanmax(np.abs(value), initial=0.0)), 2.0 * band)
    figure.layout["yaxis"] |= {"range": [-reach, reach], "zeroline": True}
    return figure.plain
