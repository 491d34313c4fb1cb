"""The pictures of a plan: from what size effects would be seen, and which look alike."""

import numpy as np

from edhas_jax.core.plot_style import COLOURS, INK, QUIET
from edhas_jax.diagnosis.planning.detectability_plan import ALIKE, Plan

PARTS = {
    "coil": "#d1490c", "mover": "#9a6700", "check_valves": "#8a3ffc", "chamber": "#b83280", "outlet": "#0b62c4",
    "suction": "#0e7490", "oil": "#1a7f4b", "cylinder": "#4b5563", "sensor": "#9aa4af",
}  # fmt: skip
SPAN = 1e-5, 3.0  # shares of the strongest plausible effect that are drawn


def draw_sizes(plan: Plan):
    """A matplotlib figure: the smallest strength that would be seen, as a share of the strongest plausible one."""
    from matplotlib.figure import Figure

    visible = plan.visible
    figure = Figure(figsize=(9.0, 1.2 + 0.21 * len(visible)), layout="constrained")
    axes = figure.subplots()
    rows = np.arange(len(visible))[::-1]
    shares = np.clip([v.share for v in visible], SPAN[0], 1.0)
    axes.barh(rows, 1.0 - shares, left=shares, height=0.7, color=[PARTS[v.suspect.where] for v in visible])
    axes.axvline(1.0, color=INK, lw=1.0, ls="--")
    for row, v in zip(rows, visible, strict=True):
        if not v.seen:
            axes.annotate("not seen", (1.15, row), va="center", fontsize=7.5, color=COLOURS[1])
    axes.set_xscale("log")
    axes.set_xlim(*SPAN)
    axes.set_ylim(-0.8, len(visible) - 0.2)
    axes.set_yticks(rows, [v.suspect.name.replace("_", " ") for v in visible], fontsize=7.5, color=INK)
    told = "strength over the strongest plausible one (dashed); coloured: would be seen"
    axes.set_xlabel(told, fontsize=9, color=INK)
    axes.grid(True, axis="x", color="#d8dee4", lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="x", colors=QUIET, labelsize=8)
    axes.tick_params(axis="y", length=0)
    present = dict.fromkeys(v.suspect.where for v in visible)
    handles = [axes.barh([0], [0], color=PARTS[p], label=p.replace("_", " ")) for p in PARTS if p in present]
    figure.legend(handles=handles, loc="outside upper left", ncols=len(handles), fontsize=8, frameon=False,
                  handlelength=1.0, columnspacing=1.2)  # fmt: skip
    return figure


def draw_overlaps(plan: Plan):
    """A matplotlib figure: how alike the suspects are that would be seen, ordered so that alike ones are neighbours."""
    from matplotlib.figure import Figure
    from scipy.cluster.hierarchy import leaves_list, linkage
    from scipy.spatial.distance import squareform

    seen = np.flatnonzero([v.seen for v in plan.visible])
    table = plan.overlap[np.ix_(seen, seen)]
    if len(seen) > 2:
        apart = np.clip(1.0 - 0.5 * (table + table.T), 0.0, 1.0)
        np.fill_diagonal(apart, 0.0)
        order = leaves_list(linkage(squareform(apart, checks=False), "average"))
        seen, table = seen[order], table[np.ix_(order, order)]
    names = [plan.visible[k].suspect.name.replace("_", " ") for k in seen]
    side = 2.6 + 0.19 * len(names)
    figure = Figure(figsize=(side + 0.8, side + 0.3), layout="constrained")
    axes = figure.subplots()
    shown = np.where(np.triu(np.ones_like(table), 0) > 0, np.nan, table)
    image = axes.imshow(shown, cmap="YlOrRd", vmin=0.0, vmax=1.0, aspect="auto")
    for row, column in np.argwhere(np.nan_to_num(shown) > ALIKE):
        axes.plot(column, row, "s", ms=6, mfc="none", mec=INK, mew=1.2)
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=7, color=INK)
    axes.set_yticks(range(len(names)), names, fontsize=7, color=INK)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    bar = figure.colorbar(image, ax=axes, shrink=0.5, pad=0.01)
    bar.set_label("cosine of what no known parameter imitates", fontsize=8, color=INK)
    bar.ax.tick_params(labelsize=7, colors=QUIET)
    bar.outline.set_visible(False)
    axes.set_title(f"framed: above {ALIKE}, not told apart", fontsize=9, loc="left", color=INK)
    return figure
