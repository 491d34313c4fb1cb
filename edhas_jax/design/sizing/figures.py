"""Figures of a sizing: paths of all starts, and the Pareto front of two metrics."""

import numpy as np

from edhas_jax.core.chart import add_colour_bar, add_title, set_log_scale
from edhas_jax.core.literal_text import figure_text
from edhas_jax.core.plot_style import COLOURS, GREY, INK
from edhas_jax.core.units import display_unit, format_number, from_si
from edhas_jax.design.batch.experiment_design import Axis
from edhas_jax.design.sizing.config import SizingTask
from edhas_jax.design.sizing.optimiser import FEASIBILITY_TOLERANCE
from edhas_jax.design.sizing.size import SizingResult

BEST_COLOUR, START_COLOUR = COLOURS[1], COLOURS[0]


def draw_path(task: SizingTask, result: SizingResult):
    """A matplotlib figure: best feasible objective of each start, and each design variable, over the iterations."""
    from edhas_jax.core.figure import Figure

    names = [axis.name for axis in task.variables]
    columns = 1 + len(names)
    figure = Figure(figsize=(3.0 + 1.9 * columns, 3.8), layout="constrained")
    grid = figure.subplots(1, columns, width_ratios=[2.2] + [1.0] * len(names))
    last = result.path["iteration"].max()
    best_of_starts, final = [], result.machines[0].objective
    for _, rows in result.path.groupby("start"):
        rows = rows.sort_values("iteration")
        best = rows["objective"].where(rows["violation"] <= FEASIBILITY_TOLERANCE).cummax()
        best_of_starts.append(best.max())
        grid[0].plot(rows["iteration"], 100 * np.expm1(best - final), color=GREY, lw=0.8, alpha=0.6)
    grid[0].set_ylim(max(-60.0, 100 * np.expm1(np.nanmin(best_of_starts) - final) - 5), 3)
    grid[0].axhline(0.0, color=BEST_COLOUR, lw=1.2)
    grid[0].set(xlabel="iteration", ylabel="best feasible objective, % from the final one", xlim=(0, last))
    grid[0].set_title(f"{len(best_of_starts)} starts, {100 * result.share_near_best:.0f} % end within 1 %", fontsize=10)
    for axes, axis in zip(grid[1:], task.variables, strict=True):
        shown, convert = _shown(axis)
        for _, rows in result.path.groupby("start"):
            rows = _improvements(rows)
            axes.plot(rows["iteration"], convert(rows[axis.name].to_numpy()), color=GREY, lw=0.7, alpha=0.6)
        for sized in result.machines:
            axes.axhline(convert(sized.design[axis.name]), color=BEST_COLOUR, lw=1.4)
        low, high = map(convert, (axis.low, axis.high))
        axes.set_ylim(low - 0.03 * (high - low), high + 0.03 * (high - low))
        if axis.log:
            set_log_scale(axes.yaxis)
            axes.set_ylim(low * 0.95, high * 1.05)
        axes.set_title(f"{axis.name.replace('_', ' ')}\n{shown}", fontsize=8.5)
        axes.set_xlabel("iteration", fontsize=8)
        axes.tick_params(labelsize=7.5)
    for axes in grid:
        axes.spines[["top", "right"]].set_visible(False)
    title = f"{figure_text(task.name or 'sizing')}: every start (grey) and the result (red)"
    add_title(figure, title)
    return figure


def _improvements(rows):
    """The rows of one start that improve on all before: feasible before infeasible, then by the objective."""
    rows = rows.sort_values("iteration")
    rank = np.where(rows["violation"] <= FEASIBILITY_TOLERANCE, rows["objective"], -1e3 - rows["violation"])
    return rows[rank >= np.maximum.accumulate(np.nan_to_num(rank, nan=-np.inf))]


def _shown(axis: Axis):
    """The unit in which a design variable is shown, and a function that converts values (SI) to it."""
    shown = display_unit(axis.unit, axis.high)
    return shown, lambda value: from_si(value, axis.unit, shown)


def draw_front(task: SizingTask, result: SizingResult):
    """A matplotlib figure: the two metrics of the objective, averaged over the cases, and the designs on the front."""
    from edhas_jax.core.figure import Figure

    metrics, declared = list(task.weights), task.machine.metrics
    figure = Figure(figsize=(10.5, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1.2, 1.0])

    def mean(sized, metric):
        about = declared[metric]
        return from_si(float(sized.metrics[metric].mean()), about.unit, about.display_unit)

    feasible = [sized for sized in result.machines if sized.violation <= FEASIBILITY_TOLERANCE]
    x, y = ([mean(sized, m) for sized in feasible] for m in metrics)
    left.plot(x, y, "-o", color=BEST_COLOUR, ms=5, lw=1.2)
    for k, point in enumerate(zip(x, y, strict=True)):
        left.annotate(str(k + 1), point, (6, 4), textcoords="offset points", fontsize=8.5, color=INK)
    start = [mean(result.start, m) for m in metrics]
    label = "start" if result.start.violation <= FEASIBILITY_TOLERANCE else "start, infeasible"
    left.plot(*start, "s", color=START_COLOUR, ms=6)
    left.annotate(label, start, (7, -11), textcoords="offset points", fontsize=8.5, color=START_COLOUR)
    labels = [f"{m.replace('_', ' ')}, {declared[m].display_unit}, mean of the points" for m in metrics]
    left.set(xlabel=labels[0], ylabel=labels[1])
    left.margins(0.1)
    fractions = [[a.fraction_of(s.design[a.name]) for s in feasible] for a in task.variables]
    image = right.imshow(fractions, cmap="viridis", vmin=0, vmax=1, aspect="auto")
    labels = []
    for i, axis in enumerate(task.variables):
        shown, convert = _shown(axis)
        labels.append(f"{axis.name.replace('_', ' ')}, {shown}")
        for k, sized in enumerate(feasible):
            right.text(k, i, format_number(convert(sized.design[axis.name]), 3), ha="center", va="center",
                       fontsize=7.5, color="white" if fractions[i][k] < 0.6 else INK)  # fmt: skip
    right.set_yticks(range(len(task.variables)), labels, fontsize=8.5)
    right.set_xticks(range(len(feasible)), [str(k + 1) for k in range(len(feasible))])
    right.set_xlabel("design along the front")
    add_colour_bar(figure, image, right, "fraction of the range", aspect=25)
    left.spines[["top", "right"]].set_visible(False)
    right.spines[:].set_visible(False)
    add_title(figure, f"{figure_text(task.name or 'sizing')}: Pareto front")
    return figure
