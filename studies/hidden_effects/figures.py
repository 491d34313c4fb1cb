"""Figures of the benchmark: rates of all methods, rates over the visible size, reliability, times, confusion matrix."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from edhas_jax.core.plot_style import GREY, INK
from studies.hidden_effects.answers import NOTHING, UNKNOWN, Truth
from studies.hidden_effects.methods import Method
from studies.hidden_effects.rates import answered, answered_by_all, by_visibility, rates, times
from studies.hidden_effects.reliability import reliability
from studies.hidden_effects.report import methods_in
from studies.hidden_effects.store import Record

COLOURS = {
    Method.OURS: "#0f5c6e", Method.BIC: "#c2571a", Method.SUBSET: "#b58900", Method.PYSINDY: "#a24a63",
    Method.CLASSIFIER: "#5b4bb5", Method.CORRELATION: "#8a8f98",
}  # fmt: skip
MARKERS = {
    Method.OURS: "o", Method.BIC: "s", Method.SUBSET: "D", Method.PYSINDY: "P", Method.CLASSIFIER: "^",
    Method.CORRELATION: "v",
}  # fmt: skip
GRID, RIGHT_SHADES, WRONG = "#e6e8ea", ("#ffffff", "#9cc7cf", "#0f5c6e"), "#b3261e"
FAILED = "failed"
DPI = 130


def save_figures(records: Sequence[Record], folder: Path) -> None:
    """Write the figures of the methods that have answers to a folder.

    Where there are cases that every method was run on, methods are compared on these.
    """
    methods = methods_in(records)
    if not methods:
        return
    folder.mkdir(parents=True, exist_ok=True)
    figures = {"rates.png": draw_rates, "visibility.png": draw_visibility, "times.png": draw_times}
    same = answered_by_all(records, [m.value for m in methods]) or records
    for name, draw in figures.items():
        draw(same, methods).savefig(folder / name, dpi=DPI)
    stating = [m for m in methods if reliability(answered(records, m.value)).count]
    if stating:
        draw_reliability(records, stating).savefig(folder / "reliability.png", dpi=DPI)
    if any(len(t.hidden) < 2 for t, _ in answered(records, Method.OURS.value)):
        draw_confusion(records).savefig(folder / "confusion.png", dpi=DPI)


def _style(axes: Axes, grid: str = "both") -> None:
    axes.grid(axis=grid, color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(length=0, labelcolor=GREY, labelsize=9)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#c9ced3")


def _per_cent(value: float, _=None) -> str:
    return f"{100 * value:.0f} %"


def draw_rates(records: Sequence[Record], methods: Sequence[Method]) -> Figure:
    """The rates of all methods with their confidence intervals."""
    tables = {m: rates(answered(records, m.value)) for m in methods}
    labels = [label for label in next(iter(tables.values())) if any(t[label].of for t in tables.values())]
    figure = Figure(figsize=(9.0, 1.3 + (0.25 + 0.13 * len(methods)) * len(labels)), layout="constrained")
    axes = figure.subplots()
    for k, (method, table) in enumerate(tables.items()):
        for i, label in enumerate(labels):
            r = table[label]
            if r.of:
                y = i + 0.75 / len(methods) * (k - 0.5 * (len(methods) - 1))
                axes.plot(r.interval(), [y, y], color=COLOURS[method], linewidth=1.5, alpha=0.5, solid_capstyle="round")
                axes.plot(r.share, y, MARKERS[method], color=COLOURS[method], markersize=5)
    for method in methods:
        axes.plot([], [], MARKERS[method], color=COLOURS[method], markersize=5, label=method.title)
    counts = [max(t[label].of for t in tables.values()) for label in labels]
    names = [f"{label}  ({n})" for label, n in zip(labels, counts, strict=True)]
    axes.set_yticks(range(len(labels)), names)
    for edge in np.arange(0.5, len(labels) - 1):
        axes.axhline(edge, color=GRID, linewidth=0.8)
    axes.set_ylim(len(labels) - 0.5, -0.5)
    axes.set_xlim(-0.02, 1.02)
    axes.xaxis.set_major_formatter(_per_cent)
    _style(axes, "x")
    axes.tick_params(axis="y", labelcolor=INK)
    axes.set_xlabel("share of cases (number of cases in brackets), with Wilson's 95 % interval", fontsize=9, color=INK)
    figure.legend(loc="outside upper center", ncols=min(len(methods), 4), fontsize=8.5, frameon=False)
    return figure


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
    _style(axes, "y")
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


def draw_times(records: Sequence[Record], methods: Sequence[Method]) -> Figure:
    """The share of cases that take at most a given time."""
    figure = Figure(figsize=(7.2, 3.8), layout="constrained")
    axes = figure.subplots()
    for method in methods:
        cases = answered(records, method.value)
        seconds = np.sort([max(answer.seconds, 1e-2) for _, answer in cases])
        share = np.arange(1, len(seconds) + 1) / len(seconds)
        found = times(cases)
        label = f"{method.title}: median {found.median:.0f} s, longest {found.worst:.0f} s"
        axes.step(np.append(seconds[:1], seconds), np.append(0.0, share), where="post", color=COLOURS[method],
                  linewidth=2.0 if method is Method.OURS else 1.3, label=label)  # fmt: skip
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
    axes.yaxis.set_major_formatter(_per_cent)
    axes.set_ylim(0.0, 1.02)
    _style(axes)
    axes.set_xlabel("computing time [s]", fontsize=9, color=INK)
    axes.set_ylabel("share of cases", fontsize=9, color=INK)
    figure.legend(loc="outside upper center", ncols=2, fontsize=8.5, frameon=False)
    return figure


def draw_confusion(records: Sequence[Record]) -> Figure:
    """The hidden effect (rows) and our first answer (columns) of the cases with at most one hidden effect."""
    cases = [(t, a) for t, a in answered(records, Method.OURS.value) if len(t.hidden) < 2]
    rows = [(_hidden(truth), _short(answer.first) or FAILED) for truth, answer in cases]
    withheld = sorted({h for h, _ in rows if "," in h})
    first = sorted({h for h, _ in rows if h != NOTHING and "," not in h}, key=_order)
    row_labels = [*first, *withheld, *([NOTHING] if NOTHING in dict(rows) else [])]
    said = {a for _, a in rows}
    column_labels = [*first, *sorted(said - {*first, NOTHING, UNKNOWN, FAILED}, key=_order), UNKNOWN, NOTHING]
    column_labels += [FAILED] if FAILED in said else []
    table = np.zeros((len(row_labels), len(column_labels)))
    for hidden, answer in rows:
        table[row_labels.index(hidden), column_labels.index(answer)] += 1
    figure = Figure(figsize=(2.8 + 0.27 * len(column_labels), 2.4 + 0.25 * len(row_labels)), layout="constrained")
    axes = figure.subplots()
    largest = table[:, : column_labels.index(NOTHING)].max(initial=3.0)
    shades = LinearSegmentedColormap.from_list("count", RIGHT_SHADES)
    axes.imshow(table, cmap=shades, vmin=0, vmax=largest, aspect="auto")
    for (i, k), count in np.ndenumerate(table):
        if count:
            right = row_labels[i] == column_labels[k] or (row_labels[i] in withheld and column_labels[k] == UNKNOWN)
            colour = WRONG if not right else "white" if count > 0.55 * largest else INK
            axes.text(k, i, f"{count:.0f}", ha="center", va="center", fontsize=8, color=colour,
                      fontweight="normal" if right else "bold")  # fmt: skip
    axes.set_xticks(range(len(column_labels)), column_labels, rotation=90, fontsize=7.5, color=INK)
    axes.set_yticks(range(len(row_labels)), row_labels, fontsize=7.5, color=INK)
    axes.set_xticks(np.arange(len(column_labels)) - 0.5, minor=True)
    axes.set_yticks(np.arange(len(row_labels)) - 0.5, minor=True)
    axes.grid(which="minor", color=GRID, linewidth=0.6)
    axes.tick_params(which="both", length=0)
    axes.spines[:].set_color("#c9ced3")
    axes.set_xlabel("first answer", fontsize=9, color=INK)
    axes.set_ylabel("hidden", fontsize=9, color=INK)
    axes.set_title(f"{len(rows)} cases with at most one hidden effect; red: wrong", loc="left", fontsize=10, color=INK)
    return figure


def _hidden(truth: Truth) -> str:
    """What is hidden as a label of the matrix."""
    if not truth.hidden:
        return NOTHING
    return _short(truth.hidden[0].name) + (", withheld" if truth.withheld else "")


def _short(name: str) -> str:
    return name.partition(" on ")[0]


def _order(name: str) -> tuple[bool, str]:
    return name.startswith("sensor_"), name
