"""Figures of the benchmark: rates over the visible size, and the reliability of stated probabilities."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from edhas_jax.core.plot_style import GREY, INK
from studies.hidden_effects.methods import Method
from studies.hidden_effects.rates import answered, answered_by_all, by_visibility
from studies.hidden_effects.reliability import reliability
from studies.hidden_effects.report import methods_in
from studies.hidden_effects.store import Record

COLOURS = {Method.OURS: "#0f5c6e", Method.PREVIOUS: "#5b4bb5", Method.BIC: "#c2571a", Method.CORRELATION: "#8a8f98"}
MARKERS = {Method.OURS: "o", Method.PREVIOUS: "D", Method.BIC: "s", Method.CORRELATION: "v"}
GRID = "#e6e8ea"
DPI = 130


def save_figures(records: Sequence[Record], folder: Path) -> None:
    """Write the figures of the methods that have answers to a folder.

    Where there are cases that every method was run on, methods are compared on these over the visible size.
    """
    methods = methods_in(records)
    if not methods:
        return
    folder.mkdir(parents=True, exist_ok=True)
    same = answered_by_all(records, [m.value for m in methods]) or records
    draw_visibility(same, methods).savefig(folder / "visibility.png", dpi=DPI)
    stating = [m for m in methods if reliability(answered(records, m.value)).count]
    if stating:
        draw_reliability(records, stating).savefig(folder / "reliability.png", dpi=DPI)


def _style(axes: Axes) -> None:
    axes.grid(color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(length=0, labelcolor=GREY, labelsize=9)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#c9ced3")


def _per_cent(value: float, _=None) -> str:
    return f"{100 * value:.0f} %"


def draw_visibility(records: Sequence[Record], methods: Sequence[Method]) -> Figure:
    """The rate of right first names over the visible size of single hidden effects."""
    figure = Figure(figsize=(7.6, 4.2), layout="constrained")
    axes = figure.subplots()
    labels: list[str] = []
    for k, method in enumerate(methods):
        bands = by_visibility(answered(records, method.value))
        labels = [f"{_power(low)} … {_power(high)}" for low, high in bands]
        found = [(i + 0.1 * (k - 0.5 * (len(methods) - 1)), r) for i, r in enumerate(bands.values()) if r.of]
        for x, r in found:
            axes.plot([x, x], r.interval(), color=COLOURS[method], linewidth=1.3, alpha=0.45, solid_capstyle="round")
        style = {"color": COLOURS[method], "linewidth": 1.6 if method is Method.OURS else 1.0, "markersize": 5}
        axes.plot(
            [x for x, _ in found], [r.share for _, r in found], MARKERS[method] + "-", label=method.title, **style
        )
    axes.set_xticks(range(len(labels)), labels)
    axes.set_xlim(-0.5, len(labels) - 0.5)
    axes.set_ylim(-0.02, 1.02)
    axes.yaxis.set_major_formatter(_per_cent)
    _style(axes)
    axes.set_xlabel("visible size: χ² that the uncertain parameters cannot explain", fontsize=9, color=INK)
    axes.set_ylabel("right name first", fontsize=9, color=INK)
    figure.legend(loc="outside upper center", ncols=min(len(methods), 3), fontsize=8.5, frameon=False)
    return figure


def _power(value: float) -> str:
    if not 0.0 < value < np.inf:
        return "0" if value <= 0.0 else ""
    return f"{value:.0f}" if value < 1e3 else f"10{str(int(np.log10(value))).translate(str.maketrans('345', '³⁴⁵'))}"


def draw_reliability(records: Sequence[Record], methods: Sequence[Method]) -> Figure:
    """The share of right first answers over their stated probability, one panel for each method."""
    figure = Figure(figsize=(1.0 + 3.1 * len(methods), 3.7), layout="constrained")
    row = figure.subplots(1, len(methods), squeeze=False, sharey=True)[0]
    for axes, method in zip(row, methods, strict=True):
        found = reliability(answered(records, method.value))
        axes.plot([0, 1], [0, 1], color=GREY, linewidth=1.0, linestyle=(0, (4, 3)))
        for b in found.bins:
            x = b.mean_probability
            axes.plot([x, x], b.right.interval(), color=COLOURS[method], linewidth=1.6, alpha=0.5)
            axes.plot(x, b.right.share, "o", color=COLOURS[method], markersize=5.5)
            left = x > 0.85
            axes.annotate(str(b.right.of), (x, b.right.share), xytext=(-5 if left else 5, -9), fontsize=7.5, color=GREY,
                          textcoords="offset points", ha="right" if left else "left")  # fmt: skip
        axes.set_xlim(-0.03, 1.03)
        axes.set_ylim(-0.03, 1.03)
        axes.set_aspect("equal")
        axes.xaxis.set_major_formatter(_per_cent)
        axes.yaxis.set_major_formatter(_per_cent)
        _style(axes)
        axes.set_title(f"{method.title}\ncalibration error {found.error:.3f}, by chance {found.by_chance:.3f}",
                       loc="left", fontsize=9, color=INK)  # fmt: skip
        axes.set_xlabel("stated probability of the first answer", fontsize=9, color=INK)
    row[0].set_ylabel("right, with number of answers", fontsize=9, color=INK)
    return figure
