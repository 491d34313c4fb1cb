"""A diagnosis in one picture: the model before, the suspects, the model after, and how the error fell."""

import numpy as np

from edhas_jax.core.plot_style import COLOURS, GREY, INK
from edhas_jax.core.units import from_si
from edhas_jax.diagnosis.report.figures import TITLES, draw_stages
from edhas_jax.diagnosis.search.result import Diagnosis
from edhas_jax.machine.components.set_points import Sine
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.parameters import get_parameter
from edhas_jax.machine.rigs import ActuatorSystem
from edhas_jax.measurements.campaign import BenchRun, Use
from edhas_jax.measurements.residuals import rms_over_noise

SUSPECTS = 9
CYCLES = 1.5


def draw_story(diagnosis: Diagnosis):
    """A matplotlib figure: measured against the calibrated model, the suspects, measured against the model after."""
    from matplotlib.figure import Figure

    campaign = diagnosis.campaign
    runs = campaign.runs_for(Use.HOLDOUT) or campaign.runs
    residuals = diagnosis.calibrated.residuals
    run, signal = max(
        ((run, n) for run in runs for n in run.signals),
        key=lambda row: rms_over_noise([residuals[row[0].name][row[1]]]),
    )
    figure = Figure(figsize=(12.5, 7.2), layout="constrained")
    grid = figure.add_gridspec(6, 2, width_ratios=[1.35, 1.0])
    last = None
    for first, left, title in (
        (0, residuals, "calibrated"), (3, diagnosis.after.residuals, "after")
    ):  # fmt: skip
        cells = figure.add_subplot(grid[first : first + 2, 0]), figure.add_subplot(grid[first + 2, 0])
        _traces(*cells, diagnosis, run, signal, left, title)
        last = cells[1] if last is None else last
        cells[1].set_ylim(last.get_ylim())
    suspects, falls = figure.add_subplot(grid[:3, 1]), figure.add_subplot(grid[3:, 1])
    _suspects(suspects, diagnosis)
    draw_stages(falls, diagnosis, runs[0].use)
    falls.set_title(f"residual over noise, {TITLES[runs[0].use]}", fontsize=10, loc="left", color=INK)
    figure.suptitle(diagnosis.sentences()[0], x=0.01, ha="left", fontsize=12, color=INK)
    return figure


def _traces(axes, below, diagnosis: Diagnosis, run: BenchRun, signal: str, residuals, title: str) -> None:
    machine = diagnosis.campaign.machine_of(run)
    start = run.time[0]
    if isinstance(machine.reference, Sine) and not isinstance(machine, ActuatorSystem):
        start = run.time[-1] - CYCLES / float(get_parameter(machine, "frequency"))
    inside = run.time >= start
    about, time = SIGNALS[signal], 1e3 * run.time[inside]
    noise = diagnosis.campaign.channels[signal].noise
    left = residuals[run.name][signal]
    measured = run.signals[signal]
    model, half = (from_si(v, about.unit, about.display_unit) for v in ((measured - noise * left)[inside], 2.0 * noise))
    points = from_si(measured[inside], about.unit, about.display_unit)
    axes.plot(time, points, ".", ms=3, color=COLOURS[0], label="measured")
    axes.fill_between(time, model - half, model + half, color=COLOURS[1], alpha=0.25, lw=0)
    axes.plot(time, model, color=COLOURS[1], lw=1.2, label="model ± 2 noise")
    use = ", held out" if run.use is Use.HOLDOUT else ""
    heading = f"{title}: {run.name}{use}, {rms_over_noise([left]):.2f} × noise"
    axes.set_title(heading, fontsize=10, loc="left", color=INK)
    axes.set_ylabel(f"{signal.replace('_', ' ')}, {about.display_unit}", fontsize=9, color=INK)
    axes.tick_params(labelbottom=False)
    axes.legend(fontsize=8, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2, markerscale=2.0,
                handlelength=1.2, columnspacing=1.0)  # fmt: skip
    below.axhspan(-2, 2, color="#d8dee4", lw=0)
    below.plot(time, left[inside], color=COLOURS[0], lw=0.8)
    below.set_ylabel("off / noise", fontsize=9, color=INK)
    below.set_xlabel("time, ms", fontsize=9, color=INK)
    for cell in (axes, below):
        cell.grid(color="#e4e7eb", lw=0.6)
        cell.margins(x=0.0)
        cell.spines[["top", "right"]].set_visible(False)
        cell.tick_params(colors=GREY, labelsize=8)


def _suspects(axes, diagnosis: Diagnosis) -> None:
    """What the suspects promised in the first round, of everything that was left over."""
    scores = sorted(diagnosis.rounds[0].scores, key=lambda score: -score.fall)[:SUSPECTS]
    accepted = {t.suspect for t in diagnosis.accepted}
    falls = [max(score.fall, 1.0) for score in scores]
    colours = [COLOURS[1] if score.suspect in accepted else "#aab4be" for score in scores]
    rows = np.arange(len(scores))
    axes.barh(rows, falls, height=0.65, color=colours)
    axes.set_xscale("log")
    axes.set_xlim(1.0, 3.0 * max([*falls, 10.0]))
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_yticks(rows, [score.suspect.name.replace("_", " ") for score in scores], fontsize=8.5, color=INK)
    axes.set_title("suspects: fall of χ² that each promises (coloured: accepted)", fontsize=10, loc="left", color=INK)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.tick_params(axis="x", colors=GREY, labelsize=8)
