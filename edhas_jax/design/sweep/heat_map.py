"""Heat maps of a sweep: a metric over two parameters, with panels for, or averages over, the other parameters."""

import numpy as np
import pandas as pd

from edhas_jax.core.chart import add_colour_bar, add_title, set_log_scale
from edhas_jax.core.plot_style import GREY, INK
from edhas_jax.design.sweep.design_selection import (
    COLOUR_MAP,
    FAILED_COLOUR,
    DesignSelection,
    FigureError,
    few_levels,
    require_one_of,
    tick_label,
)

MAX_PANEL_COLUMNS, MAX_PANEL_ROWS = 4, 3
DESIGNS_PER_CELL = 25  # intended, of sampled designs
MAX_EXACT_VALUES = 12  # distinct values of a parameter that get a cell each; more are binned
CANDIDATES = 6  # leading metrics among which a map looks for one that depends on two parameters
LEAST_SECOND_SHARE = 0.05  # of the variance that the first parameter explains: what the second one has to explain
VARIANCE_DESIGNS = 100_000  # evenly spread over the table, of which this share is calculated
VARIANCE_BINS = 10  # of a parameter, for the share of variance that it explains


def draw_heat_map(selection: DesignSelection, metric: str, x: str | None, y: str | None, average: bool):
    """Draw a metric over two parameters.

    Args:
        selection: the designs to show.
        metric: shown as colour.
        x: horizontal parameter; by default one of the two that explain most of the metric's variance.
        y: vertical parameter, likewise.
        average: whether further parameters of a grid are averaged instead of shown in panels of their own.

    Returns:
        A matplotlib figure.

    Raises:
        FigureError: fewer than two parameters vary, or `x` or `y` is none of them.
    """
    from edhas_jax.core.figure import Figure

    varied = selection.varied()
    if len(varied) < 2:
        raise FigureError("a heat map needs two parameters that vary", missing=True)
    for name in (x, y):
        if name is not None:
            require_one_of(name, varied, "no parameter that varies")
    by_influence = sorted(varied, key=lambda n: -_explained_variance(selection, metric, n))
    x = x or next(n for n in by_influence if n != y)
    y = y or next(n for n in by_influence if n != x)
    if x == y:
        raise FigureError(f"--x and --y are both {x}; name two parameters")
    others = [n for n in varied if n not in (x, y)] if selection.is_grid and not average else []
    columns = _panel_values(selection, others, 0, MAX_PANEL_COLUMNS)
    rows = _panel_values(selection, others, 1, MAX_PANEL_ROWS)
    # parameters beyond rows and columns are fixed at their middle value
    fixed = {n: (levels := _levels(selection, n))[len(levels) // 2] for n in others[2:]}
    figure = Figure(figsize=(1.6 + 3.4 * len(columns) + (2.6 if len(columns) == 1 else 0),
                             1.3 + 2.9 * len(rows) + (1.4 if len(rows) == 1 else 0)), layout="constrained")  # fmt: skip
    grid = figure.subplots(len(rows), len(columns), squeeze=False, sharex=True, sharey=True)
    cells = {(r, c): _cells(selection, metric, x, y, {**fixed, **row, **column})
             for r, row in enumerate(rows) for c, column in enumerate(columns)}  # fmt: skip
    finite = np.concatenate([mean[np.isfinite(mean)] for *_, mean, _ in cells.values()])
    if not len(finite):
        raise FigureError("every design that would be shown has failed", missing=True)
    low, high = finite.min(), finite.max()
    for (r, c), (x_edges, y_edges, mean, failed) in cells.items():
        axes = grid[r, c]
        image = axes.pcolormesh(x_edges, y_edges, mean, cmap=COLOUR_MAP, vmin=low, vmax=max(high, low + 1e-300))
        _hatch_failed(axes, x_edges, y_edges, failed)
        _label_axes(axes, selection, x, y, {**rows[r], **columns[c]}, last=r == len(rows) - 1, first=c == 0)
        if selection.is_grid and not failed.any():
            _draw_contours(axes, x_edges, y_edges, mean, (low, high))
    add_colour_bar(figure, image, grid, selection.label(metric))
    what = metric.replace("_", " ") + f" over {x.replace('_', ' ')} and {y.replace('_', ' ')}"
    what += "".join(f", {n.replace('_', ' ')} {selection.quantity(n, v)}" for n, v in fixed.items())
    averaged = [n for n in varied if n not in (x, y)] if not others else []
    if averaged:
        what += f", mean over {', '.join(n.replace('_', ' ') for n in averaged)}"
    add_title(figure, selection.title(what))
    return figure


def metric_of_two_parameters(selection: DesignSelection) -> str:
    """The most important metric that depends on at least two parameters; without one, that which comes nearest.

    A map of a metric that depends on one parameter alone has stripes.
    """
    shares = {}
    for metric in selection.result.leading[:CANDIDATES]:
        explained = sorted(_explained_variance(selection, metric, n) for n in selection.varied())
        shares[metric] = explained[-2] / explained[-1] if len(explained) > 1 and explained[-1] > 0.0 else 0.0
        if shares[metric] > LEAST_SECOND_SHARE:
            return metric
    return max(shares, key=shares.__getitem__)


def _explained_variance(selection: DesignSelection, metric: str, name: str) -> float:
    """The variance of the mean metric over bins of a parameter."""
    rows = np.flatnonzero(selection.ok)
    rows = rows[:: max(len(rows) // VARIANCE_DESIGNS, 1)]
    values, parameter = selection.values(metric)[rows], selection.values(name)[rows]
    if len(values) < 2:
        return 0.0
    order = values[np.argsort(parameter, kind="stable")]
    return float(np.var([part.mean() for part in np.array_split(order, min(VARIANCE_BINS, len(order)))]))


def _panel_values(selection: DesignSelection, others: list[str], position: int, limit: int) -> list[dict[str, float]]:
    """The values of the parameter at a position of `others`, a panel each: at most `limit`, spread over its range."""
    if len(others) <= position:
        return [{}]
    levels = _levels(selection, others[position])
    chosen = np.unique(np.linspace(0, len(levels) - 1, min(limit, len(levels))).round().astype(int))
    return [{others[position]: levels[i]} for i in chosen]


def _levels(selection: DesignSelection, name: str) -> np.ndarray:
    """The distinct values (SI) of a parameter among the selected designs, ascending."""
    return np.sort(pd.unique(selection.result.frame[name][selection.selected]))


def _cells(selection: DesignSelection, metric: str, x: str, y: str, fixed: dict[str, float]):
    """Edges of the cells in shown units, the mean of the metric per cell, and the cells where all designs failed."""
    inside = selection.selected.copy()
    for name, value in fixed.items():
        inside &= selection.result.frame[name].to_numpy() == value
    edges, columns = [], [selection.values(name) for name in (y, x)]
    for name, values in zip((y, x), columns, strict=True):
        chosen = values[selection.selected]
        levels = np.sort(pd.unique(chosen)) if selection.is_grid else few_levels(chosen, MAX_EXACT_VALUES)
        if levels is not None:
            edges.append(_cell_edges(levels, selection.is_log(name)))
        else:
            count = int(np.clip(np.sqrt(inside.sum() / DESIGNS_PER_CELL), 3, 40))
            spacing = np.geomspace if selection.is_log(name) else np.linspace
            edges.append(spacing(chosen.min(), chosen.max(), count + 1))

    def total(mask, weights=None):
        weights = None if weights is None else weights[mask]
        return np.histogram2d(*(column[mask] for column in columns), bins=edges, weights=weights)[0]

    good = inside & selection.ok
    count = total(good)
    mean = np.where(count > 0, total(good, selection.values(metric)) / np.maximum(count, 1), np.nan)
    return edges[1], edges[0], mean, (count == 0) & (total(inside & selection.failed) > 0)


def _cell_edges(levels: np.ndarray, log: bool) -> np.ndarray:
    """Edges of cells half way between ascending values."""
    z = np.log(levels) if log else levels
    if len(z) == 1:
        edges = np.array([z[0] - 0.5, z[0] + 0.5])
    else:
        middle = 0.5 * (z[1:] + z[:-1])
        edges = np.concatenate([[2 * z[0] - middle[0]], middle, [2 * z[-1] - middle[-1]]])
    return np.exp(edges) if log else edges


def _hatch_failed(axes, x_edges, y_edges, failed) -> None:
    if failed.any():
        from matplotlib.colors import ListedColormap

        axes.pcolor(
            x_edges, y_edges, np.ma.array(np.zeros(failed.shape), mask=~failed), cmap=ListedColormap([FAILED_COLOUR]),
            hatch="////", edgecolor=GREY, linewidth=0.0,
        )  # fmt: skip


def _draw_contours(axes, x_edges, y_edges, mean, span) -> None:
    if min(mean.shape) < 4 or np.isfinite(mean).sum() < 12 or not span[1] > span[0]:
        return
    from matplotlib.ticker import MaxNLocator

    x, y = 0.5 * (x_edges[1:] + x_edges[:-1]), 0.5 * (y_edges[1:] + y_edges[:-1])
    levels = [v for v in MaxNLocator(7).tick_values(*span) if span[0] < v < span[1]]
    lines = axes.contour(x, y, np.ma.masked_invalid(mean), levels=levels, colors="white", linewidths=0.8, alpha=0.9)
    axes.clabel(lines, fmt=tick_label, fontsize=8)


def _label_axes(
    axes, selection: DesignSelection, x: str, y: str, fixed: dict[str, float], last: bool, first: bool
) -> None:  # fmt: skip
    for name, axis in ((x, axes.xaxis), (y, axes.yaxis)):
        if selection.is_log(name):
            set_log_scale(axis)
    if fixed:
        title = ", ".join(f"{n.replace('_', ' ')} {selection.quantity(n, v)}" for n, v in fixed.items())
        axes.set_title(title, fontsize=9)
    axes.set_xlabel(selection.label(x) if last else "", color=INK)
    axes.set_ylabel(selection.label(y) if first else "", color=INK)
    axes.tick_params(colors=GREY, labelsize=8)
    axes.spines[:].set_visible(False)
