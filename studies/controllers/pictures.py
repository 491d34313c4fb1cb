"""The figure of `studies.controllers.comparison`."""

import numpy as np

from edhas_jax.core.plot_style import COLOURS as SERIES
from edhas_jax.core.plot_style import GREY

CONTROLLER_LABELS = {"pid": "PID", "cascade": "cascade", "antsmc": "ANTSMC"}
COLOURS = {"pid": SERIES[0], "cascade": SERIES[4], "antsmc": SERIES[1]}
LINE_STYLES = {"continuous": {"ls": (0, (4, 2)), "lw": 1.1, "alpha": 0.75}, "5khz": {"ls": "-", "lw": 1.8}}
MARKER_FACES = {"continuous": "white", "5khz": None}  # None: filled
SAMPLING_LABELS = {"continuous": "continuous", "5khz": "5 kHz, one sample of delay"}


def draw_comparison(comparison, conditions, load_time):
    """Draw tracking over frequency, errors under all conditions, both step responses and the effect of sample time.

    Args:
        comparison: the results.
        conditions: names of the conditions, in the order of `comparison.condition_errors`.
        load_time: time [s] of the load step.

    Returns:
        A matplotlib figure.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    figure = Figure(figsize=(8.6, 10.4), layout="constrained")
    axes = figure.subplots(3, 2)
    _draw_tracking(axes[0, 0], comparison)
    _draw_conditions(axes[0, 1], comparison, list(conditions), 0)
    _draw_conditions(axes[1, 0], comparison, list(conditions), 1)
    _draw_step(axes[1, 1], comparison)
    _draw_load_step(axes[2, 0], comparison, load_time)
    _draw_sample_times(axes[2, 1], comparison)
    for panel in axes.flat:
        panel.spines[["top", "right"]].set_visible(False)
    names = dict.fromkeys(name for name, _ in comparison.condition_errors)
    handles = [Line2D([], [], color=COLOURS[n], lw=2.2, label=CONTROLLER_LABELS[n]) for n in names]
    for sampling, style in LINE_STYLES.items():
        face = MARKER_FACES[sampling] or GREY
        label = SAMPLING_LABELS[sampling]
        handles.append(Line2D([], [], color=GREY, label=label, marker="o", markerfacecolor=face, **style))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, fontsize=9)
    figure.suptitle("Piston controllers, tuned by gradient at 10 and 30 Hz under load and with steps", x=0.01,
                    ha="left", fontsize=12)  # fmt: skip
    return figure


def _draw_tracking(axes, comparison) -> None:
    for (name, sampling), errors in comparison.tracking_errors.items():
        axes.loglog(comparison.frequencies, 1e6 * errors, color=COLOURS[name], **LINE_STYLES[sampling])
    axes.set_xlim(comparison.frequencies[0], comparison.frequencies[-1])
    ticks = [1, 2, 5, 10, 20, 30, 60]
    axes.set_xticks(ticks, [str(t) for t in ticks])
    axes.minorticks_off()
    axes.set(title="Tracking a sine of 3.5 mm", xlabel="frequency, Hz", ylabel="rms error, µm")
    axes.grid(axis="y", color="#d8dee4", lw=0.6)


def _draw_conditions(axes, comparison, conditions, column) -> None:
    rows = np.arange(len(conditions))[::-1]
    keys = list(comparison.condition_errors)
    for k, (name, sampling) in enumerate(keys):
        heights = rows + 0.55 * (0.5 - (k + 0.5) / len(keys))
        face = MARKER_FACES[sampling] or COLOURS[name]
        values = 1e6 * comparison.condition_errors[name, sampling][:, column]
        axes.hlines(heights, 1e-2, values, color=COLOURS[name], lw=0.8, alpha=0.35)
        axes.semilogx(values, heights, "o", color=COLOURS[name], markerfacecolor=face, ms=6)
    values = 1e6 * np.stack([e[:, column] for e in comparison.condition_errors.values()])
    axes.set_xlim(0.5 * values.min(), 2.0 * values.max())
    axes.set_yticks(rows, conditions)
    axes.set_ylim(-0.6, len(conditions) - 0.4)
    axes.grid(axis="x", color="#d8dee4", lw=0.6)
    axes.set(title=f"Disturbed, {(10, 30)[column]} Hz", xlabel="rms error, µm")


def _draw_step(axes, comparison) -> None:
    time, reference, _ = next(iter(comparison.step_responses.values()))
    for (name, sampling), (_, _, position) in comparison.step_responses.items():
        axes.plot(1e3 * time, 1e3 * position, color=COLOURS[name], **LINE_STYLES[sampling])
    axes.plot(1e3 * time, 1e3 * reference, color=GREY, lw=1.0, ls=":")
    axes.set(title="A step of the set point", xlabel="time, ms", ylabel="piston position, mm", xlim=(3, 25))
    highest = max(position.max() for _, _, position in comparison.step_responses.values())
    axes.set_ylim(-0.1, max(1.6, min(2.6, 1.05e3 * highest)))


def _draw_load_step(axes, comparison, load_time) -> None:
    lowest, highest = -1.0, 1.0
    for (name, sampling), (time, _, position) in comparison.step_responses.items():
        begin = np.searchsorted(time, load_time)
        deviation = 1e6 * (position - position[begin - 1])
        lowest, highest = min(lowest, deviation[begin:].min()), max(highest, deviation[begin:].max())
        axes.plot(1e3 * (time - load_time), deviation, color=COLOURS[name], **LINE_STYLES[sampling])
    axes.set(title="A force of 50 N at rest", xlabel="time after the force, ms", ylabel="deviation, µm", xlim=(-2, 30))
    axes.set_ylim(1.15 * max(lowest, -400.0), 20.0 + 1.15 * min(highest, 200.0))
    axes.grid(axis="y", color="#d8dee4", lw=0.6)


def _draw_sample_times(axes, comparison) -> None:
    for name, errors in comparison.sample_time_errors.items():
        axes.loglog(1e3 * comparison.sample_times, 1e6 * errors, color=COLOURS[name], **LINE_STYLES["5khz"])
        if (name, "continuous") in comparison.condition_errors:
            continuous = 1e6 * comparison.condition_errors[name, "continuous"][0, 1]
            axes.axhline(continuous, color=COLOURS[name], **LINE_STYLES["continuous"])
    axes.axvline(0.2, color=GREY, lw=0.8, ls=":")
    axes.annotate("tuned for this", (0.2, 0.97), (4, 0), xycoords=("data", "axes fraction"), textcoords="offset points",
                  fontsize=8, va="top", color=GREY)  # fmt: skip
    ticks = [0.05, 0.1, 0.2, 0.5]
    axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
    axes.minorticks_off()
    axes.set(title="Other sample times, same gains, 30 Hz", xlabel="sample time = delay, ms", ylabel="rms error, µm")
    axes.grid(axis="y", color="#d8dee4", lw=0.6)
