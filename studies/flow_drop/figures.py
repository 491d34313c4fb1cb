"""Figures of the causes of the flow drop: the flow of each, their distances, and the signals of the decisive run."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

import edhas_jax as edhas
from edhas_jax.core.plot_style import COLOURS, GREY, INK
from edhas_jax.machine.rigs import PumpBench
from studies.flow_drop.causes import Cause, SizedCause, flow_at_sizes
from studies.flow_drop.discrimination import MEAN_FLOW, MIN_DISTANCE, READINGS, Discrimination, Run
from studies.paper.readings import RUN_IN, mean_flows, swept_volume

FREQUENCIES = tuple(np.arange(2.0, 61.0, 2.0).tolist())  # Hz
PAPER = COLOURS[1]
EXPLAINING_COLOURS = (COLOURS[0], COLOURS[3], COLOURS[2])
OTHER_COLOURS = ("#57606a", "#b5489a", "#7a9a01", "#0f5c6e", "#c08a00", "#7d8fd1", "#a24a63", *COLOURS)  # other causes
READING_COLOURS = (COLOURS[3], COLOURS[4], COLOURS[0], COLOURS[2])  # of what is read beside the flow
LABELS = {
    MEAN_FLOW: "mean flow alone", "piston_position": "with piston position", "current": "with current",
    "outlet_pressure": "with outlet pressure", "chamber_pressure_a": "with chamber pressure",
}  # fmt: skip
UNCHANGED = 0.02  # of the flow
SHOWN = {
    "chamber_pressure_a": ("chamber pressure, MPa", 1e-6), "current": ("current, A", 1.0),
    "piston_position": ("piston, mm", 1e3),
}  # fmt: skip


def draw_flows(base: PumpBench, found: Sequence[Sequence[SizedCause]], frequencies=FREQUENCIES) -> Figure:
    """Mean flow over frequency: the causes that make it fall, and those that cannot, at their strongest."""
    figure = Figure(figsize=(11.0, 4.8), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    free = mean_flows(base, {"valve_mass": np.array([float(edhas.get(base, "valve_mass"))])}, frequencies)[:, 0]
    explaining, rest = [s[0] for s in found if s[0].explains_fall], [s for s in found if not s[0].explains_fall]
    for axes in (left, right):
        axes.plot(frequencies, np.array(frequencies) * swept_volume(base), color=INK, lw=1.0, ls=":")
        axes.plot(frequencies, free, color=INK, lw=2.6, label="the machine without any of them")
        axes.axvline(30.0, color=PAPER, lw=1.2)
    for s, colour in zip(explaining, EXPLAINING_COLOURS, strict=False):
        left.plot(frequencies, _flow(base, s.cause, s.size, frequencies), color=colour, lw=2.0, label=_label(s))
    idle, colours = [], iter(OTHER_COLOURS)
    for end, *beyond in rest:
        flow, colour = _flow(base, end.cause, end.size, frequencies), next(colours)
        if np.abs(flow / free - 1.0).max() < UNCHANGED:
            idle.append(_label(end))
        else:
            right.plot(frequencies, flow, color=colour, lw=1.6, label=_label(end))
        for s in beyond:
            flow = _flow(base, s.cause, s.size, frequencies)
            right.plot(frequencies, flow, color=colour, lw=1.3, ls="--", label=_label(s))
    left.annotate("paper: proportional to\nabout here, then falling", (30.0, -0.3), (-6, 0), ha="right",
                  textcoords="offset points", color=PAPER, fontsize=9)  # fmt: skip
    right.annotate("\n".join(("no change:", *idle)), (29.5, -0.3), ha="right", color=GREY, fontsize=8)
    left.annotate("swept volume", (52.0, 52.0 * swept_volume(base)), (-6, 4), textcoords="offset points", color=GREY,
                  fontsize=8.5, ha="right")  # fmt: skip
    left.set_title("what makes it fall, sized to do so within its published range", fontsize=9.5, loc="left", color=INK)
    right.set_title("what cannot: at the end of its range; dashed: what it would take", fontsize=9.5, loc="left",
                    color=INK)  # fmt: skip
    for axes in (left, right):
        _format_axes(axes, "frequency, Hz", "mean flow, L/min" if axes is left else "", xlim=(0, 60), ylim=(-0.4, 6.2))
        axes.legend(frameon=False, fontsize=8, loc="upper left")
    figure.suptitle("Mean flow over frequency, one cause at a time", x=0.01, ha="left", fontsize=11, color=INK)
    return figure


def _flow(base: PumpBench, cause: Cause, size: float, frequencies) -> np.ndarray:
    return flow_at_sizes(base, cause, [size], frequencies)[:, 0]


def _label(s: SizedCause) -> str:
    return f"{s.cause.title}, {s.cause.size_text(s.size)}"


def draw_distances(discriminations: dict[str, Discrimination]) -> Figure:
    """Distance of every pair by what is measured; a panel per campaign."""
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    panels = figure.subplots(1, len(discriminations), sharey=True, sharex=True)
    for axes, (title, discrimination) in zip(panels, discriminations.items(), strict=True):
        pairs = list(discrimination.pairs(MEAN_FLOW))
        axes.axvspan(0.3, MIN_DISTANCE, color="#f3f4f6", zorder=0)
        axes.axvline(MIN_DISTANCE, color=GREY, lw=1.0)
        axes.annotate("not told apart", (MIN_DISTANCE, len(pairs) - 0.62), (-6, 0), textcoords="offset points",
                      ha="right", color=GREY, fontsize=8.5)  # fmt: skip
        for k, name in enumerate(READINGS):
            values = [max(discrimination.pairs(name)[pair], 0.35) for pair in pairs]
            rows = np.arange(len(pairs)) + 0.13 * (k - 2)
            axes.plot(values, rows, "o" if k else "D", color=INK if k == 0 else READING_COLOURS[k - 1], ms=6.5, ls="",
                      label=LABELS[name])  # fmt: skip
        axes.set_yticks(range(len(pairs)), [f"{a} | {b}" for a, b in pairs], fontsize=9, color=INK)
        axes.set(xscale="log", xlim=(0.3, 700), ylim=(len(pairs) - 0.4, -0.6))
        axes.set_xticks((1, 10, 100), ("1", "10", "100"))
        axes.set_title(title, fontsize=9.5, loc="left", color=INK)
        _format_axes(axes, "distance, standard deviations", "")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False,
                  fontsize=8.5)  # fmt: skip
    figure.suptitle("How far apart the causes are when all that is uncertain is fitted anew", x=0.01, ha="left",
                    fontsize=11, color=INK)  # fmt: skip
    return figure


def draw_signals(base: PumpBench, explaining: Sequence[SizedCause], run: Run) -> Figure:
    """One cycle of the settling run for every cause that makes the flow fall."""
    figure = Figure(figsize=(11.0, 3.9), layout="constrained")
    panels = figure.subplots(1, len(SHOWN))
    for s, colour in zip(explaining, EXPLAINING_COLOURS, strict=False):
        machine = edhas.change(s.cause.with_size(base, s.size), **run._asdict())
        length = RUN_IN + 2.0 / run.frequency
        signals = edhas.simulate(machine, edhas.Simulation(duration=length, sample_rate=20e3)).signals
        first = np.ceil(RUN_IN * run.frequency) / run.frequency
        inside = (signals["time"] >= first) & (signals["time"] <= first + 1.0 / run.frequency)
        phase = 360.0 * run.frequency * (signals["time"][inside] - first)
        for axes, (name, (label, scale)) in zip(panels, SHOWN.items(), strict=True):
            axes.plot(phase, scale * signals[name][inside], color=colour, lw=1.5, label=s.cause.title)
            _format_axes(axes, "phase of the set point, °", label, xlim=(0, 360))
            axes.set_xticks(range(0, 361, 90))
    panels[-1].set_title("the controller hides it", fontsize=9, loc="left", color=GREY)
    panels[0].legend(frameon=False, fontsize=8.5)
    title = f"The run that settles it: {run.frequency:g} Hz, {1e3 * run.amplitude:g} mm"
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, color=INK)
    return figure


def _format_axes(axes, x: str, y: str, **limits) -> None:
    axes.set(xlabel=x, ylabel=y, **limits)
    axes.grid(True, color="#d8dee4", lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8.5)
