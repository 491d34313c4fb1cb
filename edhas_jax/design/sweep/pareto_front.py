"""Pareto front of a sweep: two metrics of all designs, with those that no other design dominates."""

from collections.abc import Sequence

import numpy as np

from edhas_jax.core.chart import add_title, style_axes
from edhas_jax.core.plot_style import COLOURS, GREY, INK
from edhas_jax.design.sweep.design_selection import (
    GRID_COLOUR,
    DesignSelection,
    FigureError,
    require_one_of,
    tick_label,
)

FRONT_COLOUR = COLOURS[1]
PUMP_OBJECTIVES = ("mean_flow:max", "mean_electrical_power:min")
ACTUATOR_OBJECTIVES = ("tracking_error:min", "mean_electrical_power:min")
FEW_DESIGNS = 5000
MOST_POINTS, PIXELS = 100_000, (900, 600)  # points that are all drawn; pixels of the diagram, roughly
MAX_TABLE_ROWS = 6  # designs of the front that are listed with their parameters


def non_dominated(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Indices of the rows that no other row dominates (larger is better in both), ascending in the first column."""
    if len(first) > 2 * FEW_DESIGNS:
        # the front of some designs rules most of the others out, of which sorting all would take long
        some = np.arange(0, len(first), len(first) // FEW_DESIGNS)
        best = some[non_dominated(first[some], second[some])]
        after = np.searchsorted(first[best], first, side="right")
        rival = np.append(second[best], -np.inf)[after]  # the best second value among those with a larger first one
        left = np.flatnonzero(~(rival > second))
        if len(left) <= len(first) // 2:
            return left[non_dominated(first[left], second[left])]
    order = np.lexsort((-second, -first))
    best = np.maximum.accumulate(second[order])
    keep = np.concatenate([[True], second[order][1:] > best[:-1]])
    return order[keep][::-1]


def _drawn(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Indices of the points to draw: where many lie on one pixel of the picture, one of them."""
    if len(x) <= MOST_POINTS:
        return np.arange(len(x))
    pixel = np.zeros(len(x), np.int64)
    for values, count in ((x, PIXELS[0]), (y, PIXELS[1])):
        span = np.ptp(values) or 1.0
        pixel = pixel * count + np.minimum((values - values.min()) / span * count, count - 1).astype(np.int64)
    first = np.full(PIXELS[0] * PIXELS[1], -1)
    first[pixel[::-1]] = np.arange(len(x))[::-1]
    return first[first >= 0]


def draw_pareto_front(selection: DesignSelection, objectives: Sequence[str] | None):
    """Draw two metrics of all designs against each other, with the Pareto front and a table of designs on it.

    Args:
        selection: the designs to show.
        objectives: two texts such as "mean_flow:max"; by default those of the machine.

    Returns:
        A matplotlib figure.

    Raises:
        FigureError: not two metrics of this sweep with directions, or every design has failed.
    """
    from edhas_jax.core.figure import Figure

    metrics = selection.result.metrics
    if objectives is None:
        objectives = PUMP_OBJECTIVES if "mean_flow" in metrics else ACTUATOR_OBJECTIVES
    names, signs = [], []
    for text in objectives:
        name, _, direction = text.partition(":")
        names.append(require_one_of(name, metrics, "no metric"))
        if direction not in ("max", "min"):
            raise FigureError(f"{text}: write {name}:max or {name}:min")
        signs.append(1.0 if direction == "max" else -1.0)
    if names[0] == names[1]:
        raise FigureError(f"two different metrics are needed; both are {names[0]}")
    finite = np.isfinite(selection.values(names[0])) & np.isfinite(selection.values(names[1]))
    good = np.flatnonzero(selection.ok & finite)
    if not len(good):
        raise FigureError("every design that would be shown has failed", missing=True)
    vertical, horizontal = selection.values(names[0])[good], selection.values(names[1])[good]
    front = non_dominated(signs[0] * vertical, signs[1] * horizontal)
    figure = Figure(figsize=(9.0, 7.6), layout="constrained")
    axes, below = figure.subplots(2, 1, height_ratios=(3.0, 1.0))
    size = 14 if len(good) < 1000 else 5
    drawn = _drawn(horizontal, vertical)
    axes.scatter(horizontal[drawn], vertical[drawn], s=size, color=COLOURS[0], alpha=0.45, lw=0, label="designs")
    axes.plot(horizontal[front], vertical[front], "-", color=FRONT_COLOUR, lw=1.0, zorder=3)
    axes.plot(horizontal[front], vertical[front], "o", color=FRONT_COLOUR, ms=5 if len(front) < 60 else 3, zorder=4,
              label=f"Pareto front: {len(front):,} non-dominated designs")  # fmt: skip
    listed = front[_spread(horizontal[front], vertical[front])]
    for number, i in enumerate(listed, 1):
        axes.annotate(str(number), (horizontal[i], vertical[i]), xytext=(-4, 9), textcoords="offset points", ha="right",
                      fontsize=9, weight="bold", color=FRONT_COLOUR, zorder=5,
                      bbox={"boxstyle": "circle,pad=0.2", "fc": "white", "ec": FRONT_COLOUR, "lw": 0.8})  # fmt: skip
    better = {1.0: "more is better", -1.0: "less is better"}
    titles = [f"{selection.label(name)} ({better[sign]})" for name, sign in zip(names, signs, strict=True)]
    style_axes(axes, titles[1], titles[0], size=10)
    axes.margins(0.06)
    axes.legend(frameon=False, fontsize=9, loc="lower right" if signs[0] * signs[1] < 0 else "upper right")
    columns = [names[0], names[1], *selection.varied()]
    rows = [[str(k), *(tick_label(selection.values(n)[good[i]]) for n in columns)] for k, i in enumerate(listed, 1)]
    below.axis("off")
    heads = ["design", *(_column_heading(selection.label(n)) for n in columns)]
    table = below.table(rows, colLabels=heads, loc="center", cellLoc="center", edges="horizontal")
    table.auto_set_font_size(False)
    table.set_fontsize(9)
    for (row, _), cell in table.get_celld().items():
        cell.set_edgecolor(GRID_COLOUR)
        cell.get_text().set_color(GREY if row == 0 else INK)
        cell.set_height(0.38 if row == 0 else 0.145)
    what = " against ".join(name.replace("_", " ") for name in names)
    add_title(figure, selection.title(what, "left out"))
    return figure


def _spread(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Indices of at most `MAX_TABLE_ROWS` points of a Pareto front, evenly spaced along it in the plot."""
    steps = np.hypot(*(np.diff(v) / (np.ptp(v) or 1.0) for v in (x, y)))
    along = np.concatenate([[0.0], np.cumsum(steps)])
    wanted = np.linspace(0.0, along[-1], min(MAX_TABLE_ROWS, len(x)))
    return np.unique([int(np.argmin(np.abs(along - w))) for w in wanted])


def _column_heading(label: str) -> str:
    """Heading of a column: the words, broken after the first if they are long, above the unit."""
    words, _, unit = label.partition(", ")
    return (words.replace(" ", "\n", 1) if len(words) > 16 else words) + (f"\n{unit}" if unit else "")
