"""Figures of the benchmark of hidden effects: the confusion matrix, and the rates of all methods."""

from pathlib import Path

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from edhas_jax.core.plot_style import GREY, INK
from studies.hidden_effects.cases import Family
from studies.hidden_effects.rates import (
    BIC,
    CORRELATION,
    PACKAGE_METHOD,
    SPARSE,
    Result,
    answers,
    family_name,
    has_failed,
    hidden_names,
    methods_in,
    rates,
)

CONFUSION_FILE, RATES_FILE = "confusion.png", "rates.png"
COLOURS = {PACKAGE_METHOD: "#0f5c6e", BIC: "#c98a2b", CORRELATION: "#8a8f98", SPARSE: "#a24a63"}
NOTHING, UNKNOWN, FAILED = "nothing", "unknown", "failed"


def save_figures(results: list[Result], folder: Path) -> None:
    """Write `rates.png`, and `confusion.png` where the package's own diagnosis was run."""
    methods = methods_in(results)
    if PACKAGE_METHOD in methods and any(family_name(r) != Family.PAIR.value and "hidden" in r for r in results):
        draw_confusion(results).savefig(folder / CONFUSION_FILE, dpi=130)
    if methods:
        draw_rates(results).savefig(folder / RATES_FILE, dpi=130)


def draw_confusion(results: list[Result]) -> Figure:
    """The confusion matrix of hidden effect (rows) and first answer (columns), cases with at most one hidden effect."""
    rows: list[tuple[str, str]] = []
    for r in results:
        if "hidden" not in r:  # ended in an error before anything was hidden
            continue
        if family_name(r) == Family.PAIR.value:
            continue
        hidden = _short(hidden_names(r)[0]) if r["hidden"] else NOTHING
        if family_name(r) == Family.WITHHELD.value:
            hidden += ", withheld"
        rows.append((hidden, _answer(r)))
    first = sorted({h for h, _ in rows if h != NOTHING and "," not in h}, key=_order)
    row_labels = [*first, *sorted({h for h, _ in rows if "," in h}), *([NOTHING] if (NOTHING in dict(rows)) else [])]
    answered = {a for _, a in rows}
    column_labels = [*first, *sorted(answered - {*first, NOTHING, UNKNOWN, FAILED}, key=_order), UNKNOWN, NOTHING]
    column_labels += [FAILED] if FAILED in answered else []
    table = np.zeros((len(row_labels), len(column_labels)))
    for hidden, answer in rows:
        table[row_labels.index(hidden), column_labels.index(answer)] += 1
    figure = Figure(figsize=(2.8 + 0.27 * len(column_labels), 2.4 + 0.25 * len(row_labels)), layout="constrained")
    axes = figure.subplots()
    shades = LinearSegmentedColormap.from_list("count", ("#ffffff", "#9cc7cf", "#0f5c6e"))
    largest = table[:, : column_labels.index(NOTHING)].max(initial=3.0)
    axes.imshow(table, cmap=shades, vmin=0, vmax=largest, aspect="auto")
    for (i, k), count in np.ndenumerate(table):
        if count:
            right = row_labels[i] == column_labels[k] or ("withheld" in row_labels[i] and column_labels[k] == UNKNOWN)
            colour = "#b3261e" if not right else "white" if count > 0.55 * largest else INK
            axes.text(k, i, f"{count:.0f}", ha="center", va="center", fontsize=8, color=colour,
                      fontweight="bold" if not right else "normal")  # fmt: skip
    axes.set_xticks(range(len(column_labels)), column_labels, rotation=90, fontsize=7.5, color=INK)
    axes.set_yticks(range(len(row_labels)), row_labels, fontsize=7.5, color=INK)
    axes.set_xticks(np.arange(len(column_labels)) - 0.5, minor=True)
    axes.set_yticks(np.arange(len(row_labels)) - 0.5, minor=True)
    axes.grid(which="minor", color="#e6e8ea", linewidth=0.6)
    axes.tick_params(which="both", length=0)
    axes.spines[:].set_color("#c9ced3")
    axes.set_xlabel("first answer", fontsize=9, color=INK)
    axes.set_ylabel("hidden", fontsize=9, color=INK)
    axes.set_title(f"{len(rows)} cases with at most one hidden effect; red: wrong", loc="left", fontsize=10, color=INK)
    return figure


def draw_rates(results: list[Result]) -> Figure:
    """The rates of all methods with their confidence intervals."""
    tables = {method: rates(results, method) for method in methods_in(results)}
    leading = next(iter(tables.values()))
    labels = [label for label, r in leading.items() if r.of]
    figure = Figure(figsize=(8.6, 1.3 + 0.55 * len(labels)), layout="constrained")
    axes = figure.subplots()
    for k, (method, table) in enumerate(tables.items()):
        for i, label in enumerate(labels):
            r = table.get(label)
            if r is None or not r.of:
                continue
            low, high = r.interval()
            y = i + 0.17 * (k - 1.5)
            axes.plot([low, high], [y, y], color=COLOURS[method], linewidth=1.6, alpha=0.55, solid_capstyle="round")
            legend = method if label == labels[0] else None
            axes.plot(r.right / r.of, y, "o", color=COLOURS[method], markersize=5.5, label=legend)
    axes.set_yticks(range(len(labels)), [f"{w}  ({leading[w].of})" for w in labels], fontsize=9, color=INK)
    axes.set_ylim(len(labels) - 0.5, -0.5)
    axes.set_xlim(-0.02, 1.02)
    axes.xaxis.set_major_formatter(lambda x, _: f"{100 * x:.0f} %")
    axes.grid(axis="x", color="#e6e8ea", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(length=0, labelcolor=GREY)
    axes.tick_params(axis="y", labelcolor=INK)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.set_xlabel("share of cases (number of cases in brackets), with Wilson's 95 % interval", fontsize=9, color=INK)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=4, fontsize=8.5, frameon=False)
    return figure


def _answer(r: Result) -> str:
    """The first answer of the package as a label of the matrix."""
    if has_failed(r, PACKAGE_METHOD):
        return FAILED
    if r["verdict"] == "adequate":
        return NOTHING
    answered = answers(r, PACKAGE_METHOD)
    return _short(answered[0]) if answered else UNKNOWN


def _short(name: str) -> str:
    return name.partition(" on ")[0]


def _order(name: str) -> tuple[bool, str]:
    return name.startswith("sensor_"), name
