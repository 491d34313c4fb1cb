"""Parallel coordinates of a sweep: a line per design through its parameters and metrics."""

import numpy as np

from edhas_jax.core.chart import LOG_TICKS, add_colour_bar, add_title
from edhas_jax.core.plot_style import INK
from edhas_jax.design.sweep.design_selection import (
    COLOUR_MAP,
    FAILED_COLOUR,
    DesignSelection,
    FigureError,
    few_levels,
    tick_label,
)

MAX_LINES = 1500
FURTHER_METRICS = 3  # shown beside the chosen metric, the most important ones first
MAX_EXACT_TICKS = 8  # distinct values of a column that get a tick each


def draw_parallel_coordinates(selection: DesignSelection, metric: str):
    """Draw a line per design through its parameters and metrics, coloured by one metric.

    Args:
        selection: the designs to show; at most `MAX_LINES` of them are drawn, at random.
        metric: shown as colour.

    Returns:
        A matplotlib figure.

    Raises:
        FigureError: every design has failed.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import LineCollection
    from matplotlib.colors import Normalize

    from edhas_jax.core.figure import Figure

    if not selection.ok.any():
        raise FigureError("every design that would be shown has failed", missing=True)
    context = [n for n in selection.result.leading if n != metric][:FURTHER_METRICS]
    names = [*selection.varied(), *context, metric]
    rng = np.random.default_rng(0)
    good, failed = np.flatnonzero(selection.ok), np.flatnonzero(selection.failed)
    thinned = len(good) + len(failed) > MAX_LINES
    share = MAX_LINES / max(len(good) + len(failed), MAX_LINES)
    good, failed = (np.sort(rng.permutation(rows)[: int(np.ceil(share * len(rows)))]) for rows in (good, failed))
    colour = selection.values(metric)
    good = good[np.argsort(colour[good])]
    figure = Figure(figsize=(2.6 + 1.75 * len(names), 6.0), layout="constrained")
    axes = figure.add_subplot()
    heights, ticks = zip(*(_axis_scale(selection, name) for name in names), strict=True)
    heights = np.stack(heights, axis=1)
    varied = len(selection.varied())
    # the metrics of a failed design are meaningless: its line ends with its parameters
    lines = [np.column_stack([np.arange(varied), heights[i, :varied]]) for i in failed]
    axes.add_collection(LineCollection(lines, colors=FAILED_COLOUR, linewidths=0.8, zorder=1))
    lines = [np.column_stack([np.arange(len(names)), heights[i]]) for i in good]
    norm = Normalize(colour[good].min(), colour[good].max())
    alpha = float(np.clip(120 / max(len(good), 1), 0.25, 0.9))
    axes.add_collection(
        LineCollection(lines, array=colour[good], cmap=COLOUR_MAP, norm=norm, linewidths=1.0, alpha=alpha, zorder=2)
    )
    for i, (name, marks) in enumerate(zip(names, ticks, strict=True)):
        axes.plot([i, i], [0.0, 1.0], color=INK, lw=1.0, zorder=3)
        for value, height in marks:
            axes.plot([i - 0.02, i + 0.02], [height, height], color=INK, lw=1.0, zorder=3)
            box = {"boxstyle": "square,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.75}
            axes.annotate(tick_label(value), (i - 0.04, height), ha="right", va="center", fontsize=8, color=INK,
                          zorder=4, bbox=box)  # fmt: skip
        words, _, unit = selection.label(name).partition(", ")
        axes.annotate(words.replace(" ", "\n", 1) + (f"\n{unit}" if unit else "\n"), (i, 1.03), ha="center",
                      va="bottom", fontsize=9, color=INK, weight="bold" if name == metric else "normal",
                      annotation_clip=False)  # fmt: skip
    axes.set(xlim=(-0.45, len(names) - 0.8), ylim=(-0.03, 1.17))
    axes.axis("off")
    add_colour_bar(figure, ScalarMappable(norm, COLOUR_MAP), axes, selection.label(metric))
    what = f"parameters and metrics, coloured by {metric.replace('_', ' ')}"
    what += f" ({len(good) + len(failed):,} designs drawn, at random)" if thinned else ""
    add_title(figure, selection.title(what))
    return figure


def _axis_scale(selection: DesignSelection, name: str) -> tuple[np.ndarray, list[tuple[float, float]]]:
    """The heights (0 … 1) of all designs on one axis, and its ticks (value, height)."""
    from matplotlib.ticker import LogLocator, MaxNLocator

    values = selection.values(name)
    shown = selection.ok | (selection.failed if name in selection.result.parameters else False)
    low, high = values[shown].min(), values[shown].max()
    log = selection.is_log(name)
    z, ends = (np.log(np.maximum(values, 1e-300)), np.log([low, high])) if log else (values, np.array([low, high]))
    width = max(ends[1] - ends[0], 1e-300)
    marks = few_levels(values[shown], MAX_EXACT_TICKS)
    if marks is None:
        marks = (LogLocator(subs=LOG_TICKS) if log else MaxNLocator(6)).tick_values(low, high)
    inside = [float(v) for v in marks if low <= v <= high]
    return (z - ends[0]) / width, [(v, float(((np.log(v) if log else v) - ends[0]) / width)) for v in inside]
