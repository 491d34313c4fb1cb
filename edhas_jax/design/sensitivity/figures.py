"""Pictures of a sensitivity analysis: parameters over operating points, the strongest on top."""

import numpy as np
import pandas as pd

from edhas_jax.core.units import format_number, format_quantity
from edhas_jax.design.sensitivity.analysis import Findings

INK, QUIET = "#1b1f24", "#6e7781"
MOST_ROWS = 18
TOLD = 0.05  # elasticities and indices from here on are written into their cells


def draw_local(findings: Findings, units: dict[str, str]):
    """Elasticities: a panel per metric, a row per parameter, a column per operating point; blue lowers, red raises.

    `units` are the SI units of the operating points' columns.
    """
    rows = findings.local
    values = {
        metric: rows[rows["metric"] == metric].pivot(index="parameter", columns="point", values="elasticity")
        for metric in rows["metric"].unique()
    }
    title = "Elasticity: per cent that a metric changes when a parameter grows by one per cent"
    return _panels(findings.points, units, values, title, "elasticity", signed=True)


def draw_sobol(findings: Findings, units: dict[str, str]):
    """Total Sobol indices in the same form."""
    rows = findings.sobol
    values = {
        output: rows[rows["output"] == output].pivot(index="parameter", columns="point", values="total")
        for output in rows["output"].unique()
    }
    title = "Total Sobol index: share of the variance over the ranges in which a parameter has a part"
    return _panels(findings.points, units, values, title, "total index", signed=False)


def draw_morris(findings: Findings):
    """Mean size of the effects with their confidence, and their spread; a panel per metric, mean over the points."""
    from matplotlib.figure import Figure

    outputs = list(findings.morris["output"].unique())
    tables = {
        output: findings.morris[findings.morris["output"] == output]
        .groupby("parameter")[["mu_star", "mu_star_conf", "sigma"]].mean() for output in outputs
    }  # fmt: skip
    order = pd.concat(tables.values())["mu_star"].groupby(level=0).max().sort_values().index
    figure = Figure(figsize=(2.2 + 3.4 * len(outputs), 1.6 + 0.36 * len(order)), layout="constrained")
    grid = figure.subplots(1, len(outputs), sharey=True, squeeze=False)[0]
    at = np.arange(len(order))
    for axes, (output, table) in zip(grid, tables.items(), strict=True):
        table = table.loc[order]
        bars = axes.barh(at, table["mu_star"], xerr=table["mu_star_conf"], color="#9ec5f4", ecolor=QUIET, height=0.62)
        dots = axes.plot(table["sigma"], at, "o", color=INK, ms=4, zorder=4)[0]
        axes.set_yticks(at, [n.replace("_", " ") for n in order], fontsize=8.5)
        axes.set_title(output.replace("_", " "), fontsize=10, color=INK)
        axes.set_xlabel("share of the metric over the range", fontsize=8.5)
        axes.spines[["top", "right", "left"]].set_visible(False)
        axes.tick_params(axis="y", length=0)
    grid[-1].legend([bars, dots], ["µ*: mean size, 95 %", "σ: curvature, interaction"], fontsize=8, frameon=False,
                    loc="lower right")  # fmt: skip
    figure.suptitle("Morris screening, mean over the operating points", x=0.01, ha="left", fontsize=11, color=INK)
    return figure


def _panels(points: pd.DataFrame, units, values: dict[str, pd.DataFrame], title: str, label: str, signed: bool):
    from matplotlib.colors import PowerNorm, SymLogNorm
    from matplotlib.figure import Figure

    strength = pd.concat(values.values()).abs().max(axis=1).groupby(level=0).max().sort_values(ascending=False)
    shown = list(strength[strength > 0.02].index[:MOST_ROWS]) or list(strength.index[:1])
    left = len(strength) - len(shown)
    order, columns = _ordered(points)
    width, height = max(2.6, 0.62 * len(order)), 0.34 * len(shown)
    figure = Figure(figsize=(2.6 + width * len(values), 2.0 + height), layout="constrained")
    grid = figure.subplots(1, len(values), sharey=True, squeeze=False)[0]
    top = max(1.0, float(np.ceil(strength.iloc[0])))
    norm = SymLogNorm(0.3, vmin=-top, vmax=top) if signed else PowerNorm(0.6, vmin=0.0, vmax=1.0)
    for axes, (metric, table) in zip(grid, values.items(), strict=True):
        cells = table.reindex(index=shown, columns=order).to_numpy(float)
        image = axes.imshow(cells, cmap="RdBu_r" if signed else "Blues", norm=norm, aspect="auto")
        for (i, j), value in np.ndenumerate(cells):
            if not np.isfinite(value):
                axes.text(j, i, "×", ha="center", va="center", fontsize=8, color=QUIET)
            elif abs(value) >= TOLD:
                dark = abs(norm(value) - (0.5 if signed else 0.0)) > (0.36 if signed else 0.6)
                axes.text(j, i, format_number(value, 2), ha="center", va="center", fontsize=7.5,
                          color="white" if dark else INK)  # fmt: skip
        axes.set_title(metric.replace("_", " "), fontsize=10, color=INK)
        axes.set_yticks(range(len(shown)), [n.replace("_", " ") for n in shown], fontsize=8.5)
        _label_points(axes, points, columns, order, units)
        axes.tick_params(length=0, colors=INK)
        axes.spines[:].set_visible(False)
    bar = figure.colorbar(image, ax=list(grid), pad=0.01, aspect=30)
    if signed:
        ticks = [t for t in (-5, -2, -1, -0.3, 0, 0.3, 1, 2, 5) if abs(t) <= top]
        bar.set_ticks(ticks, labels=[format_number(t) for t in ticks])
    bar.set_label(label, color=INK)
    bar.outline.set_visible(False)
    rest = f"; {left} weaker ones are left out" if left else ""
    figure.suptitle(title + f"\n{len(points)} operating points, strongest parameters on top{rest}",
                    x=0.01, ha="left", fontsize=10.5, color=INK)  # fmt: skip
    return figure


def _ordered(points: pd.DataFrame) -> tuple[list[int], list[str]]:
    """The points with the first column changing slowest, and the columns from the one that changes fastest."""
    columns = list(points.columns)
    order = list(points.sort_values(columns[::-1]).index) if columns else [0]
    return order, columns


def _label_points(axes, points: pd.DataFrame, columns: list[str], order: list[int], units: dict[str, str]) -> None:
    """The first parameter of the points at every column, the others once per group below, a line between groups."""
    if not columns:
        axes.set_xticks([0], ["as it stands"], fontsize=8)
        return
    first = [format_quantity(points[columns[0]][k], units[columns[0]]) for k in order]
    axes.set_xticks(range(len(order)), [t.split(" ")[0] for t in first], fontsize=8)
    unit = first[0].partition(" ")[2]
    pad = 16 if columns[1:] else 4
    axes.set_xlabel(f"{columns[0].replace('_', ' ')}, {unit}", fontsize=8.5, color=INK, labelpad=pad)
    groups: dict[str, list[int]] = {}
    for j, k in enumerate(order):
        told = ", ".join(format_quantity(points[n][k], units[n]) for n in columns[1:])
        groups.setdefault(told, []).append(j)
    for j, (told, members) in enumerate(groups.items() if columns[1:] else ()):
        axes.annotate(told, (np.mean(members), 0), (0, -17), xycoords=("data", "axes fraction"),
                      textcoords="offset points", ha="center", va="top", fontsize=8, color=QUIET)  # fmt: skip
        if j:
            axes.axvline(members[0] - 0.5, color="white", lw=3)
