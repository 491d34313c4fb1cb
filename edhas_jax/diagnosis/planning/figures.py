"""Figures of a detectability plan: detection thresholds, and similarity of the signatures."""

import numpy as np

from edhas_jax.core.chart import style_axes
from edhas_jax.core.plot_style import COLOURS, GREY, INK
from edhas_jax.diagnosis.planning.detectability_plan import INDISTINGUISHABLE_COSINE, DetectabilityPlan

LOCATION_COLOURS = {
    "coil": COLOURS[1], "mover": COLOURS[4], "check_valves": COLOURS[3], "chamber": "#b83280", "outlet": COLOURS[0],
    "suction": COLOURS[2], "oil": "#7a9a01", "cylinder": "#4b5563", "sensor": "#9aa4af",
}  # fmt: skip
SHARE_RANGE = 1e-5, 5.0  # of the axis: threshold over the strongest plausible effect


def draw_thresholds(plan: DetectabilityPlan):
    """A matplotlib figure: detection threshold of each candidate as a share of the strongest plausible effect."""
    from edhas_jax.core.figure import Figure

    candidates = plan.candidates
    figure = Figure(figsize=(7.6, 1.2 + 0.21 * len(candidates)), layout="constrained")
    axes = figure.subplots()
    rows = np.arange(len(candidates))[::-1]
    shares = np.clip([s.threshold_share for s in candidates], SHARE_RANGE[0], 1.0)
    colours = [LOCATION_COLOURS.get(s.candidate.location, INK) for s in candidates]
    axes.hlines(rows, SHARE_RANGE[0], shares, color="#d8dee4", lw=0.8)  # leads the eye from the name to the dot
    axes.scatter(shares, rows, s=34, color=colours, zorder=3, clip_on=False)
    axes.axvline(1.0, color=INK, lw=1.0, ls="--")
    for row, s in zip(rows, candidates, strict=True):
        if not s.detectable:
            axes.annotate("not detectable", (1.15, row), va="center", fontsize=7.5, color=COLOURS[1])
    axes.set_xscale("log")
    axes.set_xlim(*SHARE_RANGE)
    axes.set_ylim(-0.8, len(candidates) - 0.2)
    style_axes(axes, "smallest detectable strength over the strongest plausible one (dashed)", grid="x")
    axes.set_yticks(rows, [s.candidate.name.replace("_", " ") for s in candidates], fontsize=7.5, color=INK)
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)
    present = {s.candidate.location for s in candidates}
    handles = [
        axes.barh([0], [0], color=colour, label=location.replace("_", " "))
        for location, colour in LOCATION_COLOURS.items() if location in present
    ]  # fmt: skip
    figure.legend(handles=handles, loc="outside upper left", ncols=len(handles), fontsize=8, frameon=False,
                  handlelength=1.0, columnspacing=1.2)  # fmt: skip
    return figure


def draw_similarity(plan: DetectabilityPlan):
    """A matplotlib figure: cosines between the signatures of detectable candidates, ordered by clustering."""
    from scipy.cluster.hierarchy import leaves_list, linkage
    from scipy.spatial.distance import squareform

    from edhas_jax.core.figure import Figure

    detectable = np.flatnonzero([s.detectable for s in plan.candidates])
    values = plan.cosines[np.ix_(detectable, detectable)]
    if len(detectable) > 2:
        distance = np.clip(1.0 - 0.5 * (values + values.T), 0.0, 1.0)
        np.fill_diagonal(distance, 0.0)
        order = leaves_list(linkage(squareform(distance, checks=False), "average"))
        detectable, values = detectable[order], values[np.ix_(order, order)]
    names = [plan.candidates[k].candidate.name.replace("_", " ") for k in detectable]
    side = 2.6 + 0.19 * len(names)
    figure = Figure(figsize=(side + 0.8, side + 0.3), layout="constrained")
    axes = figure.subplots()
    shown = np.where(np.triu(np.ones_like(values), 0) > 0, np.nan, values)
    image = axes.imshow(shown, cmap="YlOrRd", vmin=0.0, vmax=1.0, aspect="auto")
    for row, column in np.argwhere(np.nan_to_num(shown) > INDISTINGUISHABLE_COSINE):
        axes.plot(column, row, "s", ms=6, mfc="none", mec=INK, mew=1.2)
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=7, color=INK)
    axes.set_yticks(range(len(names)), names, fontsize=7, color=INK)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    bar = figure.colorbar(image, ax=axes, shrink=0.5, pad=0.01)
    bar.set_label("how alike, beyond what known parameters explain (1: the same)", fontsize=8, color=INK)
    bar.ax.tick_params(labelsize=7, colors=GREY)
    bar.outline.set_visible(False)
    axes.set_title(f"framed: above {INDISTINGUISHABLE_COSINE}, indistinguishable", fontsize=9, loc="left", color=INK)
    return figure
