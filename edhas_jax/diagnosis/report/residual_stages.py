"""The residual over noise after each stage of a diagnosis, as a table and as a chart."""

from collections.abc import Mapping

import numpy as np

from edhas_jax.core.plot_style import COLOURS, GREY, INK
from edhas_jax.diagnosis.search.result import Diagnosis
from edhas_jax.measurements.campaign import Campaign, Use
from edhas_jax.measurements.residuals import OVERALL, rms_by_signal

USE_TITLES = {Use.FIT: "fitted runs", Use.HOLDOUT: "held-out runs"}
AXIS_START = 0.7  # lower end of the logarithmic axis
TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
REMAINING_COLOUR, FALL_COLOUR, RISE_COLOUR = "#aab4be", COLOURS[2], COLOURS[1]


def residual_stages(diagnosis: Diagnosis) -> dict[str, dict[Use, float]]:
    """Rms residual over noise after each stage, by use of the runs.

    The stages are the model as given, the calibrated model, and the model with each further member of the best set.
    """
    campaign, growth = diagnosis.campaign, diagnosis.growth()
    out = {
        "present model": _overall_rms(campaign, diagnosis.before),
        "calibrated": _overall_rms(campaign, diagnosis.calibrated.residuals),
    }
    before: frozenset[str] = frozenset()
    for of in growth:
        if of.members:
            added = " + ".join(c.title for c in of.members if c.name not in before)
            model = diagnosis.after if of is growth[-1] else of.evaluated
            out[f"+ {added}"] = _overall_rms(campaign, model.residuals)
        before = of.key
    return out


def _overall_rms(campaign: Campaign, residuals: Mapping[str, Mapping[str, np.ndarray]]) -> dict[Use, float]:
    found = {use: rms_by_signal(campaign, residuals, use) for use in Use}
    return {use: row[OVERALL] for use, row in found.items() if OVERALL in row}


def draw_waterfall(diagnosis: Diagnosis):
    """Draw the residual over noise after each stage, one panel for the fitted runs and one for the held-out runs.

    Returns:
        A matplotlib figure.
    """
    from edhas_jax.core.figure import Figure

    table = residual_stages(diagnosis)
    uses = [use for use in Use if all(use in row for row in table.values())]
    figure = Figure(figsize=(6.2, 0.8 + (0.6 + 0.34 * len(table)) * len(uses)), layout="constrained")
    panels = figure.subplots(len(uses), 1, squeeze=False, sharex=True)[:, 0]
    for axes, use in zip(panels, uses, strict=True):
        draw_stages(axes, diagnosis, use)
        axes.set_title(USE_TITLES[use], fontsize=9, loc="left", color=INK)
    panels[-1].set_xlabel("residual over noise; arrow: change by a stage; dashed: the noise", fontsize=8.5, color=INK)
    return figure


def draw_stages(axes, diagnosis: Diagnosis, use: Use) -> None:
    """Draw the stages of the runs of one use into matplotlib axes; values are cut off at the last tick.

    A dot is the residual of a stage and an arrow the way to it from the one before: on a logarithmic axis the length of
    a bar would mean nothing.
    """
    table = residual_stages(diagnosis)
    names, values = list(table), [min(row[use], TICKS[-1]) for row in table.values()]
    largest = min(max(value for row in table.values() for value in row.values()), TICKS[-1])
    for k, value in enumerate(values):
        before = value if k == 0 else values[k - 1]
        colour = FALL_COLOUR if before >= value else RISE_COLOUR
        if before != value:
            arrow = {"arrowstyle": "-|>", "color": colour, "lw": 2.5, "shrinkA": 5, "shrinkB": 5}
            axes.annotate("", (value, k), (before, k), arrowprops=arrow)
            axes.plot(before, k, "o", ms=6, mfc="white", mec=REMAINING_COLOUR, mew=1.5, zorder=3)
        axes.plot(value, k, "o", ms=9, color=INK, zorder=4)
        text = f"{value:.2f}" if value < TICKS[-1] else f"{value:.0f} or more"
        axes.annotate(text, (value, k), (0, 9), textcoords="offset points", ha="center", fontsize=9, color=INK)
    axes.axvline(1.0, color=COLOURS[0], lw=1.2, ls="--")
    axes.set_xscale("log")
    axes.set_xlim(AXIS_START, 1.7 * max(largest, 1.5))
    axes.set_ylim(len(names) - 0.5, -0.7)
    shown = [t for t in TICKS if t <= 1.7 * largest] or [1]
    axes.set_xticks(shown, [f"{t}" for t in shown], fontsize=8, color=GREY)
    axes.minorticks_off()
    axes.set_yticks(range(len(names)), [name.replace("_", " ") for name in names], fontsize=9, color=INK)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(length=0)
