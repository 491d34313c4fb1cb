"""A diagnosis in one figure: worst signal before and after, probabilities, and residual after each stage."""

import numpy as np

from edhas_jax.core.chart import add_title, style_axes
from edhas_jax.core.literal_text import figure_text
from edhas_jax.core.plot_style import COLOURS, INK, time_unit
from edhas_jax.diagnosis.report.conclusions import conclusions
from edhas_jax.diagnosis.report.residual_stages import USE_TITLES, draw_stages
from edhas_jax.diagnosis.search.result import Diagnosis
from edhas_jax.machine.parameters import get_parameter
from edhas_jax.measurements.campaign import BenchRun, Use
from edhas_jax.measurements.residuals import rms_over_noise

MAX_ANSWERS = 9  # shown with their probabilities
CYCLES_SHOWN = 1.5  # at the end of a run with a sinusoidal set point
CLOSER_SHARE = 0.12  # of the samples that are drawn: so few that a difference of a per cent is seen
OTHER_COLOUR = "#aab4be"


def draw_overview(diagnosis: Diagnosis):
    """Draw the worst signal of the held-out runs with both models, their errors, the probabilities and the stages.

    Returns:
        A matplotlib figure.
    """
    from edhas_jax.core.figure import Figure

    campaign = diagnosis.campaign
    runs = campaign.runs_for(Use.HOLDOUT) or campaign.runs
    residuals = diagnosis.calibrated.residuals
    run, signal = max(
        ((run, n) for run in runs for n in run.signals),
        key=lambda pair: rms_over_noise([residuals[pair[0].name][pair[1]]]),
    )
    figure = Figure(figsize=(12.5, 7.2), layout="constrained")
    grid = figure.add_gridspec(6, 2, width_ratios=[1.35, 1.0])
    panels = [figure.add_subplot(grid[row : row + 2, 0]) for row in (0, 2, 4)]
    shown = _shown_samples(diagnosis, run)
    _draw_signal(panels[0], diagnosis, run, signal, shown)
    closer = shown & _closer_samples(run, run.signals[signal], residuals[run.name][signal], shown)
    _draw_signal(panels[1], diagnosis, run, signal, closer)
    _draw_errors(panels[2], diagnosis, run, signal, shown)
    use = ", held out" if run.use is Use.HOLDOUT else ""
    headings = f"{signal.replace('_', ' ')}, {figure_text(run.name)}{use}", "the grey part, enlarged", "error"
    for axes, text in zip(panels, headings, strict=True):
        axes.set_title(text, fontsize=10, loc="left", color=INK)
    panels[0].legend(fontsize=8.5, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3)
    panels[0].axvspan(*panels[1].get_xlim(), color=OTHER_COLOUR, alpha=0.35, lw=0, zorder=0)
    panels[2].set_xlabel(f"time, {time_unit(float(runs[0].time[-1]))[1]}", fontsize=9, color=INK)
    answer_axes, stage_axes = figure.add_subplot(grid[:3, 1]), figure.add_subplot(grid[3:, 1])
    _draw_probabilities(answer_axes, diagnosis)
    draw_stages(stage_axes, diagnosis, runs[0].use)
    stage_axes.set_title(f"after each stage, {USE_TITLES[runs[0].use]}", fontsize=10, loc="left", color=INK)
    stage_axes.set_xlabel("residual over noise (dashed: the noise alone)", fontsize=9, color=INK)
    add_title(figure, figure_text(conclusions(diagnosis)[0]), 12)
    return figure


def _draw_signal(axes, diagnosis: Diagnosis, run: BenchRun, signal: str, shown: np.ndarray) -> None:
    """Some samples of a signal: measured, of the calibrated and of the final model, with the bench corrected."""
    about, noise = diagnosis.campaign.machine.signals[signal], diagnosis.campaign.channels[signal].noise
    time, measured = time_unit(float(run.time[-1]))[0] * run.time[shown], run.signals[signal][shown]
    dots = {"color": INK, "ms": 3.5, "zorder": 3, "label": "measured"}
    axes.plot(time, about.shown(measured), ".", **dots)
    for name, residuals, style in _models(diagnosis):
        model = measured - noise * residuals[run.name][signal][shown]
        axes.plot(time, about.shown(model), label=name, **style)
    style_axes(axes, "", about.display_unit)
    axes.margins(x=0.0)


def _draw_errors(axes, diagnosis: Diagnosis, run: BenchRun, signal: str, shown: np.ndarray) -> None:
    """What both models leave of a signal, in its unit, with a band of two standard deviations of the noise."""
    about = diagnosis.campaign.machine.signals[signal]
    scale = about.shown_difference(diagnosis.campaign.channels[signal].noise)
    axes.axhspan(-2 * scale, 2 * scale, color="#d8dee4", lw=0, label="± 2 noise")
    time = time_unit(float(run.time[-1]))[0] * run.time[shown]
    for name, residuals, style in _models(diagnosis):
        residual = residuals[run.name][signal]
        label = f"{name}: {rms_over_noise([residual]):.2f} × noise"
        axes.plot(time, scale * residual[shown], label=label, **style | {"lw": 1.0})
    style_axes(axes, "", f"measured − model, {about.display_unit}")
    axes.margins(x=0.0)
    axes.legend(fontsize=8.5, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3)


def _models(diagnosis: Diagnosis) -> list[tuple[str, dict, dict]]:
    """Name, residuals and line of the calibrated and the final model; of one alone where nothing was found."""
    before = "calibrated", diagnosis.calibrated.residuals, {"color": COLOURS[1], "lw": 1.5}
    after = "final model", diagnosis.after.residuals, {"color": COLOURS[0], "lw": 1.5}
    return [before, after] if diagnosis.posterior.best.members else [before]


def _closer_samples(run: BenchRun, measured: np.ndarray, residual: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """Mask of the samples of a run where one sees best how far a model is off: its error is large, the signal is not.

    Args:
        run: the run.
        measured: its signal (samples,).
        residual: (measured − model)/noise (samples,).
        shown: mask of the samples that are drawn (samples,).
    """
    time = run.time[shown]
    count = max(int(CLOSER_SHARE * len(time)), 2)
    windows = [np.lib.stride_tricks.sliding_window_view(np.nan_to_num(v[shown]), count) for v in (measured, residual)]
    spans = np.ptp(windows[0], axis=1)
    first = int(np.argmax(np.mean(np.abs(windows[1]), axis=1) / np.maximum(spans, np.finfo(float).tiny)))
    return (run.time >= time[first]) & (run.time <= time[first + count - 1])


def _shown_samples(diagnosis: Diagnosis, run: BenchRun) -> np.ndarray:
    """Mask of the samples that are drawn: the last cycles of a sine, otherwise all."""
    machine, start = diagnosis.campaign.machine_of(run), run.time[0]
    if machine.cycle is not None:
        start = run.time[-1] - CYCLES_SHOWN / float(get_parameter(machine, "frequency"))
    return run.time >= start


def _draw_probabilities(axes, diagnosis: Diagnosis) -> None:
    """The probabilities of the most probable names, of nothing and of an unknown cause."""
    shown = list(diagnosis.posterior.probabilities.items())[:MAX_ANSWERS]
    named = {diagnosis.first, *(c.name for c in diagnosis.named)}
    colours = [COLOURS[1] if name in named else OTHER_COLOUR for name, _ in shown]
    rows = np.arange(len(shown))
    axes.barh(rows, [p for _, p in shown], height=0.6, color=colours, zorder=3)
    for row, (_, p) in zip(rows, shown, strict=True):
        axes.annotate(f"{p:.2f}", (p, row), (4, 0), textcoords="offset points", va="center", fontsize=8.5, color=INK)
    axes.set_xlim(0.0, 1.1)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    style_axes(axes, grid="x")
    axes.set_yticks(rows, [name.replace("_", " ") for name, _ in shown], fontsize=8.5, color=INK)
    axes.set_title("probability to be missing (coloured: the answer)", fontsize=10, loc="left", color=INK)
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)
