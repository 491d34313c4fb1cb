"""The pictures of a sweep: heat maps, parallel coordinates, Pareto front."""


from collections.abc import Sequence

import numpy as np

from edhas_jax.design.sweep.figure_selection import (
    COLOURS,
    FAILED,
    GRID,
    INK,
    QUIET,
    FigureError,
    View,
    metric_of,
    one_of,
    tick,
    view,
)
from edhas_jax.design.sweep.heat_map import heat
from edhas_jax.design.sweep.table import SweepResult

KINDS = ("heat", "parallel", "pareto")


def draw(
    result: SweepResult,
    kind: str,
    metric: str | None = None,
    x: str | None = None,
    y: str | None = None,
    slices: Sequence[str] = (),
    average: bool = False,
    objectives: Sequence[str] | None = None,
):
    """A matplotlib figure of one kind, in engineering units; failed designs are grey and counted in the title.

    `metric` is what the colour shows. Heat maps lie over the parameters `x` and `y`; further parameters of a grid are
    small multiples, or averaged with `average`; sampled designs are averaged in cells. `slices` such as
    "frequency=20 Hz" keep only designs there. `objectives` of a Pareto front are such as "mean_flow:max".

    Raises:
        FigureError: a name is unknown, or the result lacks what the picture needs.
    """
    shown = view(result, slices)
    if kind == "heat":
        return heat(shown, metric_of(result, metric), x, y, average)
    if kind == "parallel":
        return parallel(shown, metric_of(result, metric))
    one_of(kind, KINDS, "no picture")
    return pareto(shown, objectives)


__all__ = ["KINDS", "FigureError", "draw"]



MOST_LINES = 1500
FRONT = "#d1490c"
DEFAULT_OBJECTIVES = ("mean_flow:max", "mean_electrical_power:min")
BENCH_OBJECTIVES = ("tracking_error:min", "mean_electrical_power:min")
TOLD = 6  # designs of the front that are told with their parameters
BESIDE = ("mean_electrical_power", "overall_efficiency", "peak_voltage")


def parallel(view: View, metric: str):
    """A figure of parallel coordinates: a line per design through its parameters and metrics, coloured by one metric.

    Raises:
        FigureError: every design has failed.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import LineCollection
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    if not view.ok.any():
        raise FigureError("every design that would be shown has failed", missing=True)
    names = view.varied() + [n for n in BESIDE if n in view.result.metrics and n != metric] + [metric]
    rng = np.random.default_rng(0)
    good, bad = np.flatnonzero(view.ok), np.flatnonzero(view.failed)
    thinned = len(good) + len(bad) > MOST_LINES
    share = MOST_LINES / max(len(good) + len(bad), MOST_LINES)
    good, bad = (np.sort(rng.permutation(rows)[: int(np.ceil(share * len(rows)))]) for rows in (good, bad))
    colour = view.values(metric)
    good = good[np.argsort(colour[good])]
    figure = Figure(figsize=(2.6 + 1.75 * len(names), 6.0), layout="constrained")
    axes = figure.add_subplot()
    heights, ticks = [], []
    for name in names:
        height, marks = _scale(view, name)
        heights.append(height)
        ticks.append(marks)
    heights = np.stack(heights, axis=1)
    varied = len(view.varied())
    # what a failed design measured means nothing: its line ends with its parameters
    lines = [np.column_stack([np.arange(varied), heights[i, :varied]]) for i in bad]
    axes.add_collection(LineCollection(lines, colors=FAILED, linewidths=0.8, zorder=1))
    lines = [np.column_stack([np.arange(len(names)), heights[i]]) for i in good]
    norm = Normalize(colour[good].min(), colour[good].max())
    alpha = float(np.clip(120 / max(len(good), 1), 0.25, 0.9))
    axes.add_collection(
        LineCollection(lines, array=colour[good], cmap=COLOURS, norm=norm, linewidths=1.0, alpha=alpha, zorder=2)
    )
    for i, (name, marks) in enumerate(zip(names, ticks, strict=True)):
        axes.plot([i, i], [0.0, 1.0], color=INK, lw=1.0, zorder=3)
        for value, height in marks:
            axes.plot([i - 0.02, i + 0.02], [height, height], color=INK, lw=1.0, zorder=3)
            axes.annotate(tick(value), (i - 0.04, height), ha="right", va="center", fontsize=8, color=INK, zorder=4,
                          bbox={"boxstyle": "square,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.75})  # fmt: skip
        words, _, unit = view.label(name).partition(", ")
        axes.annotate(words.replace(" ", "\n", 1) + (f"\n{unit}" if unit else "\n"), (i, 1.03), ha="center",
                      va="bottom", fontsize=9, color=INK, weight="bold" if name == metric else "normal",
                      annotation_clip=False)  # fmt: skip
    axes.set(xlim=(-0.45, len(names) - 0.8), ylim=(-0.03, 1.17))
    axes.axis("off")
    bar = figure.colorbar(ScalarMappable(norm, COLOURS), ax=axes, pad=0.02, aspect=28)
    bar.set_label(view.label(metric), color=INK, fontsize=10)
    bar.outline.set_visible(False)
    what = f"parameters and what they give, coloured by {metric.replace('_', ' ')}"
    what += f" ({len(good) + len(bad):,} designs drawn, at random)" if thinned else ""
    figure.suptitle(view.title(what), x=0.01, ha="left", fontsize=11, color=INK)
    return figure


def _scale(view: View, name: str) -> tuple[np.ndarray, list[tuple[float, float]]]:
    """The height (0 … 1) of every design on one axis, and the marks (value, height) of that axis."""
    from matplotlib.ticker import LogLocator, MaxNLocator

    values = view.values(name)
    of = view.ok | (view.failed if name in view.result.parameters else False)
    low, high = values[of].min(), values[of].max()
    log = view.is_log(name)
    z, ends = (np.log(np.maximum(values, 1e-300)), np.log([low, high])) if log else (values, np.array([low, high]))
    width = max(ends[1] - ends[0], 1e-300)
    levels = np.unique(values[of])
    if len(levels) <= 8:
        marks = levels
    else:
        marks = (LogLocator(subs=(1.0, 2.0, 5.0)) if log else MaxNLocator(6)).tick_values(low, high)
    inside = [float(v) for v in marks if low <= v <= high]
    return (z - ends[0]) / width, [(v, float(((np.log(v) if log else v) - ends[0]) / width)) for v in inside]


def front_of(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The rows that no other row beats in both columns (larger is better), sorted by the first column."""
    order = np.lexsort((-second, -first))
    best = np.maximum.accumulate(second[order])
    keep = np.concatenate([[True], second[order][1:] > best[:-1]])
    return order[keep][::-1]


def pareto(view: View, objectives: list[str] | tuple[str, ...] | None):
    """A figure of two metrics against each other, with the designs that no other beats in both.

    Raises:
        FigureError: not two metrics of this sweep with directions, or every design has failed.
    """
    from matplotlib.figure import Figure

    have = view.result.metrics
    if objectives is None:
        objectives = DEFAULT_OBJECTIVES if "mean_flow" in have else BENCH_OBJECTIVES
    names, signs = [], []
    for text in objectives:
        name, _, direction = text.partition(":")
        names.append(one_of(name, have, "no metric"))
        if direction not in ("max", "min"):
            raise FigureError(f"{text}: write {name}:max or {name}:min")
        signs.append(1.0 if direction == "max" else -1.0)
    if names[0] == names[1]:
        raise FigureError(f"two different metrics are needed; both are {names[0]}")
    good = np.flatnonzero(view.ok & np.isfinite(view.values(names[0])) & np.isfinite(view.values(names[1])))
    if not len(good):
        raise FigureError("every design that would be shown has failed", missing=True)
    up, right = view.values(names[0])[good], view.values(names[1])[good]
    front = front_of(signs[0] * up, signs[1] * right)
    figure = Figure(figsize=(9.0, 7.6), layout="constrained")
    axes, below = figure.subplots(2, 1, height_ratios=(3.0, 1.0))
    axes.scatter(right, up, s=14 if len(good) < 1000 else 5, color="#0b62c4", alpha=0.45, lw=0, label="designs")
    axes.plot(right[front], up[front], "-", color=FRONT, lw=1.0, zorder=3)
    axes.plot(right[front], up[front], "o", color=FRONT, ms=5 if len(front) < 60 else 3, zorder=4,
              label=f"Pareto front: {len(front):,} designs that no other beats in both")  # fmt: skip
    told = front[np.unique(np.linspace(0, len(front) - 1, min(TOLD, len(front))).round().astype(int))]
    for number, i in enumerate(told, 1):
        axes.annotate(str(number), (right[i], up[i]), xytext=(-4, 9), textcoords="offset points", ha="right",
                      fontsize=9, weight="bold", color=FRONT, zorder=5,
                      bbox={"boxstyle": "circle,pad=0.2", "fc": "white", "ec": FRONT, "lw": 0.8})  # fmt: skip
    better = {1.0: "more is better", -1.0: "less is better"}
    axes.set_xlabel(f"{view.label(names[1])} ({better[signs[1]]})", color=INK)
    axes.set_ylabel(f"{view.label(names[0])} ({better[signs[0]]})", color=INK)
    axes.margins(0.06)
    axes.grid(True, color=GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=QUIET, labelsize=9)
    axes.legend(frameon=False, fontsize=9, loc="lower right" if signs[0] * signs[1] < 0 else "upper right")
    columns = [names[0], names[1], *view.varied()]
    rows = [[str(k), *(tick(view.values(n)[good[i]]) for n in columns)] for k, i in enumerate(told, 1)]
    below.axis("off")
    heads = ["design", *(_head(view.label(n)) for n in columns)]
    made = below.table(rows, colLabels=heads, loc="center", cellLoc="center", edges="horizontal")
    made.auto_set_font_size(False)
    made.set_fontsize(9)
    for (row, _), cell in made.get_celld().items():
        cell.set_edgecolor(GRID)
        cell.get_text().set_color(QUIET if row == 0 else INK)
        cell.set_height(0.38 if row == 0 else 0.145)
    figure.suptitle(view.title(f"{names[0].replace('_', ' ')} against {names[1].replace('_', ' ')}", "left out"),
                    x=0.01, ha="left", fontsize=11, color=INK)  # fmt: skip
    return figure


def _head(label: str) -> str:
    """The head of a column: words, broken after the first when they are long, above the unit."""
    words, _, unit = label.partition(", ")
    return (words.replace(" ", "\n", 1) if len(words) > 16 else words) + (f"\n{unit}" if unit else "")
