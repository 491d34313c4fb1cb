"""The first look at a comparison: runs × signals, coloured by residual over noise."""

from collections.abc import Mapping

import numpy as np

from edhas_jax.campaign import Campaign, Use
from edhas_jax.figures import INK, QUIET
from edhas_jax.parameters import find_parameter
from edhas_jax.units import format_quantity

SCALE = (0.7, 30.0)  # residual over noise from the palest to the darkest colour
LADDER = ("#f3f6f4", "#fdf3d0", "#f9c76a", "#ea7a2e", "#b3261e", "#5a0f14")


def draw_matrix(panels: Mapping[str, Mapping[str, Mapping[str, float]]], notes: Mapping[str, str] | None = None):
    """A matplotlib figure with one matrix a panel: {title: {run: {signal: residual over noise}}}.

    `notes` are what is written beside the runs, such as their conditions. 1 means that only the sensor's noise is left.
    """
    from matplotlib.colors import LinearSegmentedColormap, LogNorm
    from matplotlib.figure import Figure

    runs = list(next(iter(panels.values())))
    signals = list(dict.fromkeys(n for table in panels.values() for row in table.values() for n in row))
    notes = notes or {}
    side = 0.075 * max((len(_label(run, notes)) for run in runs), default=4)
    size = 1.2 + side + 1.25 * len(signals) * len(panels), 1.3 + 0.38 * len(runs)
    figure = Figure(figsize=size, layout="constrained")
    colours = LinearSegmentedColormap.from_list("misfit", LADDER)
    grid = figure.subplots(1, len(panels), squeeze=False, sharey=True)[0]
    for axes, (title, table) in zip(grid, panels.items(), strict=True):
        values = np.array([[table[run].get(n, np.nan) for n in signals] for run in runs])
        shown = np.clip(np.where(np.isposinf(values), SCALE[1], values), *SCALE)
        image = axes.imshow(shown, cmap=colours, norm=LogNorm(*SCALE), aspect="auto")
        _write(axes, values)
        axes.set_xticks(range(len(signals)), [n.replace("_", "\n") for n in signals], fontsize=9, color=INK)
        axes.set_yticks(range(len(runs)), [_label(run, notes) for run in runs], fontsize=9, color=INK)
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
        axes.set_title(title, loc="left", fontsize=10, color=INK)
    bar = figure.colorbar(image, ax=grid, pad=0.01, aspect=22, ticks=[1, 2, 5, 10, 20])
    bar.ax.set_yticklabels(["1", "2", "5", "10", "20"], fontsize=8, color=QUIET)
    bar.ax.minorticks_off()
    bar.set_label("residual over noise", fontsize=9, color=INK)
    bar.outline.set_visible(False)
    return figure


def _label(run: str, notes: Mapping[str, str]) -> str:
    return f"{run}   {notes[run]}" if notes.get(run) else run


def _write(axes, values: np.ndarray) -> None:
    for (row, column), value in np.ndenumerate(values):
        if np.isnan(value):
            continue
        text = "fails" if np.isinf(value) else f"{value:.2f}" if value < 10 else f"{value:.0f}"
        axes.text(column, row, text, ha="center", va="center", fontsize=9, color="white" if value > 7 else INK)


def notes_of(campaign: Campaign) -> dict[str, str]:
    """The conditions of each run in a few words, and whether it is held out."""
    out = {}
    for run in campaign.runs:
        units = {name: find_parameter(campaign.machine, name)[0].unit for name in run.conditions}
        words = [format_quantity(value, units[name]) for name, value in run.conditions.items()]
        out[run.name] = ", ".join(words + (["held out"] if run.use is Use.HOLDOUT else []))
    return out
