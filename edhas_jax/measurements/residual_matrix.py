"""Draw the residuals of a campaign as a colour matrix with one cell per run and signal."""

from collections.abc import Mapping

import numpy as np

from edhas_jax.core.literal_text import figure_text
from edhas_jax.core.plot_style import GREY, INK
from edhas_jax.core.units import format_quantity
from edhas_jax.machine.parameters import find_parameter
from edhas_jax.measurements.campaign import Campaign, Use

ERROR_LABEL = "(measured − model) / noise"  # of residuals wherever they are shown
RESIDUAL = "residual over noise"  # title of a matrix
COLOUR_RANGE = (0.7, 30.0)  # residual over noise at the palest and at the darkest colour
COLOUR_STOPS = ("#f3f6f4", "#fdf3d0", "#f9c76a", "#ea7a2e", "#b3261e", "#5a0f14")
WHITE_TEXT_ABOVE = 7.0  # residual over noise from which the cell is too dark for dark text


def draw_residual_matrix(
    panels: Mapping[str, Mapping[str, Mapping[str, float]]], notes: Mapping[str, str] | None = None
):
    """Draw one matrix of runs and signals per panel.

    Args:
        panels: residual over noise by title of the panel, run and signal; 1 is pure sensor noise, inf a failed run.
        notes: text beside each run, such as its conditions.

    Returns:
        A matplotlib figure.
    """
    from matplotlib.colors import LinearSegmentedColormap, LogNorm

    from edhas_jax.core.figure import Figure

    runs = list(next(iter(panels.values())))
    signals = list(dict.fromkeys(n for table in panels.values() for row in table.values() for n in row))
    notes = notes or {}
    label_width = 0.075 * max((len(_label(run, notes)) for run in runs), default=4)
    size = 1.2 + label_width + 1.25 * len(signals) * len(panels), 1.3 + 0.38 * len(runs)
    figure = Figure(figsize=size, layout="constrained")
    colours = LinearSegmentedColormap.from_list("residuals", COLOUR_STOPS)
    grid = figure.subplots(1, len(panels), squeeze=False, sharey=True)[0]
    for axes, (title, table) in zip(grid, panels.items(), strict=True):
        values = np.array([[table[run].get(n, np.nan) for n in signals] for run in runs])
        clipped = np.clip(np.where(np.isposinf(values), COLOUR_RANGE[1], values), *COLOUR_RANGE)
        image = axes.imshow(clipped, cmap=colours, norm=LogNorm(*COLOUR_RANGE), aspect="auto")
        _write_values(axes, values)
        axes.set_xticks(range(len(signals)), [n.replace("_", "\n") for n in signals], fontsize=9, color=INK)
        axes.set_yticks(range(len(runs)), [_label(run, notes) for run in runs], fontsize=9, color=INK)
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
        axes.set_title(title, loc="left", fontsize=10, color=INK)
    bar = figure.colorbar(image, ax=grid, pad=0.01, aspect=22, ticks=[1, 2, 5, 10, 20])
    bar.ax.set_yticklabels(["1", "2", "5", "10", "20"], fontsize=8, color=GREY)
    bar.ax.minorticks_off()
    bar.set_label(RESIDUAL, fontsize=9, color=INK)
    bar.outline.set_visible(False)
    return figure


def error_text(value: float) -> str:
    """A residual over noise as it stands in a cell."""
    if not np.isfinite(value):
        return "fails"
    return f"{value:.2f}" if value < 10 else f"{value:.0f}"


def run_descriptions(campaign: Campaign) -> dict[str, str]:
    """The conditions of each run with their units, and whether it is held out, as a short text by run."""
    descriptions = {}
    for run in campaign.runs:
        units = {name: find_parameter(campaign.machine, name)[0].unit for name in run.conditions}
        words = [format_quantity(value, units[name]) for name, value in run.conditions.items()]
        descriptions[run.name] = ", ".join(words + (["held out"] if run.use is Use.HOLDOUT else []))
    return descriptions


def _label(run: str, notes: Mapping[str, str]) -> str:
    return figure_text(f"{run}   {notes[run]}" if notes.get(run) else run)


def _write_values(axes, values: np.ndarray) -> None:
    for (row, column), value in np.ndenumerate(values):
        if np.isnan(value):
            continue
        colour = "white" if value > WHITE_TEXT_ABOVE else INK
        axes.text(column, row, error_text(value), ha="center", va="center", fontsize=9, color=colour)
