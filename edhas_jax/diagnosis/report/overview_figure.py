"""A diagnosis in one figure: worst signal before and after, scores of the candidates, and residual after each stage."""

from collections.abc import Mapping

import numpy as np

from edhas_jax.core.literal_text import figure_text
from edhas_jax.core.plot_style import COLOURS, GREY, INK
from edhas_jax.core.units import from_si
from edhas_jax.diagnosis.report.residual_stages import USE_TITLES, draw_stages
from edhas_jax.diagnosis.search.conclusions import conclusions
from edhas_jax.diagnosis.search.result import Diagnosis
from edhas_jax.machine.components.set_points import Sine
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.parameters import get_parameter
from edhas_jax.machine.rigs import ActuatorSystem
from edhas_jax.measurements.campaign import BenchRun, Use
from edhas_jax.measurements.residuals import rms_over_noise

MAX_CANDIDATES = 9  # shown with their scores
CYCLES_SHOWN = 1.5  # at the end of a run with a sinusoidal set point
OTHER_COLOUR = "#aab4be"


def draw_overview(diagnosis: Diagnosis):
    """Draw the worst signal of the held-out runs with the calibrated and the final model, the scores and the stages.

    Returns:
        A matplotlib figure.
    """
    from matplotlib.figure import Figure

    campaign = diagnosis.campaign
    runs = campaign.runs_for(Use.HOLDOUT) or campaign.runs
    residuals = diagnosis.calibrated.residuals
    run, signal = max(
        ((run, n) for run in runs for n in run.signals),
        key=lambda pair: rms_over_noise([residuals[pair[0].name][pair[1]]]),
    )
    figure = Figure(figsize=(12.5, 7.2), layout="constrained")
    grid = figure.add_gridspec(6, 2, width_ratios=[1.35, 1.0])
    first_residual_axes = None
    for row, of_state, title in ((0, residuals, "calibrated"), (3, diagnosis.after.residuals, "after")):
        axes, residual_axes = figure.add_subplot(grid[row : row + 2, 0]), figure.add_subplot(grid[row + 2, 0])
        _draw_signal(axes, residual_axes, diagnosis, run, signal, of_state, title)
        first_residual_axes = residual_axes if first_residual_axes is None else first_residual_axes
        residual_axes.set_ylim(first_residual_axes.get_ylim())
    score_axes, stage_axes = figure.add_subplot(grid[:3, 1]), figure.add_subplot(grid[3:, 1])
    _draw_scores(score_axes, diagnosis)
    draw_stages(stage_axes, diagnosis, runs[0].use)
    stage_axes.set_title(f"residual over noise, {USE_TITLES[runs[0].use]}", fontsize=10, loc="left", color=INK)
    figure.suptitle(figure_text(conclusions(diagnosis)[0]), x=0.01, ha="left", fontsize=12, color=INK)
    return figure


def _draw_signal(
    axes, residual_axes, diagnosis: Diagnosis, run: BenchRun, signal: str,
    residuals: Mapping[str, Mapping[str, np.ndarray]], title: str,
) -> None:  # fmt: skip
    """One signal of one run, measured and by a model, and its residual over noise below."""
    machine = diagnosis.campaign.machine_of(run)
    start = run.time[0]
    if isinstance(machine.reference, Sine) and not isinstance(machine, ActuatorSystem):
        start = run.time[-1] - CYCLES_SHOWN / float(get_parameter(machine, "frequency"))
    shown = run.time >= start
    about, time = SIGNALS[signal], 1e3 * run.time[shown]
    noise = diagnosis.campaign.channels[signal].noise
    residual = residuals[run.name][signal]
    measured = run.signals[signal]
    modelled = (measured - noise * residual)[shown]
    model, half_width = (from_si(v, about.unit, about.display_unit) for v in (modelled, 2.0 * noise))
    points = from_si(measured[shown], about.unit, about.display_unit)
    axes.plot(time, points, ".", ms=3, color=COLOURS[0], label="measured")
    axes.fill_between(time, model - half_width, model + half_width, color=COLOURS[1], alpha=0.25, lw=0)
    axes.plot(time, model, color=COLOURS[1], lw=1.2, label="model ± 2 noise")
    use = ", held out" if run.use is Use.HOLDOUT else ""
    heading = f"{title}: {figure_text(run.name)}{use}, {rms_over_noise([residual]):.2f} × noise"
    axes.set_title(heading, fontsize=10, loc="left", color=INK)
    axes.set_ylabel(f"{signal.replace('_', ' ')}, {about.display_unit}", fontsize=9, color=INK)
    axes.tick_params(labelbottom=False)
    axes.legend(fontsize=8, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2, markerscale=2.0,
                handlelength=1.2, columnspacing=1.0)  # fmt: skip
    residual_axes.axhspan(-2, 2, color="#d8dee4", lw=0)
    residual_axes.plot(time, residual[shown], color=COLOURS[0], lw=0.8)
    residual_axes.set_ylabel("residual/noise", fontsize=9, color=INK)
    residual_axes.set_xlabel("time, ms", fontsize=9, color=INK)
    for panel in (axes, residual_axes):
        panel.grid(color="#e4e7eb", lw=0.6)
        panel.margins(x=0.0)
        panel.spines[["top", "right"]].set_visible(False)
        panel.tick_params(colors=GREY, labelsize=8)


def _draw_scores(axes, diagnosis: Diagnosis) -> None:
    """The predicted falls of χ² of the best candidates of the first round."""
    scores = sorted(diagnosis.rounds[0].scores, key=lambda score: -score.chi_square_fall)[:MAX_CANDIDATES]
    accepted = {t.candidate for t in diagnosis.accepted}
    falls = [max(score.chi_square_fall, 1.0) for score in scores]
    colours = [COLOURS[1] if score.candidate in accepted else OTHER_COLOUR for score in scores]
    rows = np.arange(len(scores))
    axes.barh(rows, falls, height=0.65, color=colours)
    axes.set_xscale("log")
    axes.set_xlim(1.0, 3.0 * max([*falls, 10.0]))
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_yticks(rows, [score.candidate.name.replace("_", " ") for score in scores], fontsize=8.5, color=INK)
    axes.set_title("candidates: predicted fall of χ² (coloured: accepted)", fontsize=10, loc="left", color=INK)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.tick_params(axis="x", colors=GREY, labelsize=8)
