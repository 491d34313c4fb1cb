"""Figures of a sensitivity analysis: parameters over operating points, the most influential on top."""

import numpy as np
import pandas as pd

from edhas_jax.core.chart import add_colour_bar, add_title
from edhas_jax.core.plot_style import GREY, INK
from edhas_jax.core.units import format_number, format_quantity
from edhas_jax.design.sensitivity.analysis import SensitivityResult

MAX_ROWS = 12
ROW, COLUMN = 0.26, 0.52  # inches of a cell: its number stays legible on a page of 800 pixels
LEAST_WIDTH = 7.6  # inches, for the title
MIN_SHOWN = 0.02  # largest elasticity or index of a parameter, below which its row is left out
MIN_ANNOTATED = 0.05  # elasticity or index from which a cell shows its value


def draw_local(result: SensitivityResult, units: dict[str, str]):
    """Draw elasticities: a panel per metric, one below the other, a row per parameter, a column per operating point.

    Args:
        result: the tables of the analysis.
        units: SI units of the columns of the operating points.

    Returns:
        A matplotlib figure; blue is negative, red positive.
    """
    title = "Elasticity: per cent that a metric changes when a parameter grows by one per cent"
    values = _by_point(result.local, "metric", "elasticity")
    return _panels(result.points, units, values, title, "elasticity", signed=True)


def draw_sobol(result: SensitivityResult, units: dict[str, str]):
    """Draw total Sobol indices in the same form as `draw_local`."""
    title = "Total Sobol index: share of the variance that involves a parameter"
    values = _by_point(result.sobol, "output", "total")
    return _panels(result.points, units, values, title, "total index", signed=False)


def _by_point(rows: pd.DataFrame, panel: str, value: str) -> dict[str, pd.DataFrame]:
    """For each panel the values of parameters × operating points."""
    return {n: of.pivot(index="parameter", columns="point", values=value) for n, of in rows.groupby(panel, sort=False)}


def draw_morris(result: SensitivityResult):
    """Draw magnitude (with confidence) and deviation of the elementary effects, averaged over the operating points."""
    from edhas_jax.core.figure import Figure

    columns = ["mu_star", "mu_star_conf", "sigma"]
    tables = {n: of.groupby("parameter")[columns].mean() for n, of in result.morris.groupby("output", sort=False)}
    order = pd.concat(tables.values())["mu_star"].groupby(level=0).max().sort_values().index
    figure = Figure(figsize=(2.2 + 3.4 * len(tables), 1.6 + 0.36 * len(order)), layout="constrained")
    grid = figure.subplots(1, len(tables), sharey=True, squeeze=False)[0]
    at = np.arange(len(order))
    for axes, (output, table) in zip(grid, tables.items(), strict=True):
        table = table.loc[order]
        bars = axes.barh(at, table["mu_star"], xerr=table["mu_star_conf"], color="#9ec5f4", ecolor=GREY, height=0.62)
        dots = axes.plot(table["sigma"], at, "o", color=INK, ms=4, zorder=4)[0]
        axes.set_yticks(at, [n.replace("_", " ") for n in order], fontsize=8.5)
        axes.set_title(output.replace("_", " "), fontsize=10, color=INK)
        axes.set_xlabel("share of the metric over the range", fontsize=8.5)
        axes.spines[["top", "right", "left"]].set_visible(False)
        axes.tick_params(axis="y", length=0)
    grid[-1].legend([bars, dots], ["µ*: mean magnitude, 95 %", "σ: curvature, interaction"], fontsize=8, frameon=False,
                    loc="lower right")  # fmt: skip
    add_title(figure, "Morris screening, mean over the operating points")
    return figure


def _panels(points: pd.DataFrame, units, values: dict[str, pd.DataFrame], title: str, label: str, signed: bool):
    from matplotlib.colors import PowerNorm, SymLogNorm

    from edhas_jax.core.figure import Figure

    strength = pd.concat(values.values()).abs().max(axis=1).groupby(level=0).max().sort_values(ascending=False)
    shown = list(strength[strength > MIN_SHOWN].index[:MAX_ROWS]) or list(strength.index[:1])
    omitted = len(strength) - len(shown)
    columns = list(points.columns)
    # the last column changes slowest
    order = list(points.sort_values(columns[::-1]).index) if columns else [0]
    size = max(LEAST_WIDTH, 2.6 + COLUMN * len(order)), 1.5 + (0.35 + ROW * len(shown)) * len(values)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(len(values), 1, sharex=True, squeeze=False)[:, 0]
    top = max(1.0, float(np.ceil(strength.iloc[0])))
    norm = SymLogNorm(0.3, vmin=-top, vmax=top) if signed else PowerNorm(0.6, vmin=0.0, vmax=1.0)
    for axes, (metric, table) in zip(grid, values.items(), strict=True):
        cells = table.reindex(index=shown, columns=order).to_numpy(float)
        image = axes.imshow(cells, cmap="RdBu_r" if signed else "Blues", norm=norm, aspect="auto")
        for (i, j), value in np.ndenumerate(cells):
            if not np.isfinite(value):
                axes.text(j, i, "×", ha="center", va="center", fontsize=8, color=GREY)
            elif abs(value) >= MIN_ANNOTATED:
                dark = abs(norm(value) - (0.5 if signed else 0.0)) > (0.36 if signed else 0.6)
                axes.text(j, i, format_number(value, 2), ha="center", va="center", fontsize=7.5,
                          color="white" if dark else INK)  # fmt: skip
        axes.set_title(metric.replace("_", " "), fontsize=10, loc="left", color=INK)
        axes.set_yticks(range(len(shown)), [n.replace("_", " ") for n in shown], fontsize=8.5)
        _label_points(axes, points, columns, order, units, axes is grid[-1])
        axes.tick_params(length=0, colors=INK)
        axes.spines[:].set_visible(False)
    bar = add_colour_bar(figure, image, list(grid), label, aspect=60, pad=0.01)
    if signed:
        ticks = [t for t in (-5, -2, -1, -0.3, 0, 0.3, 1, 2, 5) if abs(t) <= top]
        bar.set_ticks(ticks, labels=[format_number(t) for t in ticks])
    bar.ax.minorticks_off()
    note = f"; {omitted} weaker ones are left out" if omitted else ""
    note += f"\ncells without a number are below {MIN_ANNOTATED:g}"
    note += "; ×: no value" if any(table.isna().to_numpy().any() for table in values.values()) else ""
    add_title(figure, title + f"\n{len(points)} operating points, strongest parameters on top{note}", size=10.5)
    return figure


def _label_points(
    axes, points: pd.DataFrame, columns: list[str], order: list[int], units: dict[str, str], is_last: bool
) -> None:
    """Part the groups of columns by the other parameters of the points; below the last panel, label all of them."""
    if not columns:
        axes.set_xticks([0], ["as configured"], fontsize=8)
        return
    first = [format_quantity(points[columns[0]][k], units[columns[0]]) for k in order]
    axes.set_xticks(range(len(order)), [t.split(" ")[0] for t in first], fontsize=8)
    unit = first[0].partition(" ")[2]
    pad = 16 if columns[1:] else 4
    if is_last:
        axes.set_xlabel(f"{columns[0].replace('_', ' ')}, {unit}", fontsize=8.5, color=INK, labelpad=pad)
    groups: dict[str, list[int]] = {}
    for j, k in enumerate(order):
        label = ", ".join(format_quantity(points[n][k], units[n]) for n in columns[1:])
        groups.setdefault(label, []).append(j)
    for j, (label, members) in enumerate(groups.items() if columns[1:] else ()):
        if is_last:
            axes.annotate(label, (np.mean(members), 0), (0, -17), xycoords=("data", "axes fraction"),
                          textcoords="offset points", ha="center", va="top", fontsize=8, color=GREY)  # fmt: skip
        if j:
            axes.axvline(members[0] - 0.5, color="white", lw=3)
