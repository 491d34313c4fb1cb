"""The pictures of the benchmark of hidden effects: what was taken for what, and the rates beside those of others."""

from pathlib import Path

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from edhas_jax.core.plot_style import GREY, INK
from studies.hidden_effects.rates import TOOL, Result, answers, names, rates, sound

CONFUSION, RATES = "confusion.png", "rates.png"
COLOURS = {
    TOOL: "#0f5c6e", "forward selection by BIC": "#c98a2b", "residual correlation": "#8a8f98",
    "sparse regression (PySINDy)": "#a24a63",
}  # fmt: skip
NOTHING, UNKNOWN = "nothing", "unknown"


def save_pictures(results: list[Result], folder: Path) -> None:
    """Write `confusion.png` and `rates.png`."""
    done = sound(results)
    if done:
        draw_confusion(done).savefig(folder / CONFUSION, dpi=130)
        draw_rates(done).savefig(folder / RATES, dpi=130)


def draw_confusion(results: list[Result]) -> Figure:
    """What was hidden (rows) against the first answer (columns), cases with a single thing hidden or none."""
    rows: list[tuple[str, str]] = []
    for r in results:
        if r["family"] == "pair":
            continue
        hidden = _short(names(r)[0]) if r["hidden"] else NOTHING
        if r["family"] == "struck":
            hidden += ", struck"
        rows.append((hidden, _answer(r)))
    first = sorted({h for h, _ in rows if h != NOTHING and "," not in h}, key=_order)
    down = [*first, *sorted({h for h, _ in rows if "," in h}), *([NOTHING] if (NOTHING in dict(rows)) else [])]
    across = [*first, *sorted({a for _, a in rows} - {*first, NOTHING, UNKNOWN}, key=_order), UNKNOWN, NOTHING]
    table = np.zeros((len(down), len(across)))
    for hidden, answer in rows:
        table[down.index(hidden), across.index(answer)] += 1
    figure = Figure(figsize=(2.8 + 0.27 * len(across), 2.4 + 0.25 * len(down)), layout="constrained")
    axes = figure.subplots()
    shades = LinearSegmentedColormap.from_list("count", ("#ffffff", "#9cc7cf", "#0f5c6e"))
    most = max(3.0, table[:, :-1].max())
    axes.imshow(table, cmap=shades, vmin=0, vmax=most, aspect="auto")
    for (i, k), count in np.ndenumerate(table):
        if count:
            right = down[i] == across[k] or ("struck" in down[i] and across[k] == UNKNOWN)
            colour = "#b3261e" if not right else "white" if count > 0.55 * most else INK
            axes.text(k, i, f"{count:.0f}", ha="center", va="center", fontsize=8, color=colour,
                      fontweight="bold" if not right else "normal")  # fmt: skip
    axes.set_xticks(range(len(across)), across, rotation=90, fontsize=7.5, color=INK)
    axes.set_yticks(range(len(down)), down, fontsize=7.5, color=INK)
    axes.set_xticks(np.arange(len(across)) - 0.5, minor=True)
    axes.set_yticks(np.arange(len(down)) - 0.5, minor=True)
    axes.grid(which="minor", color="#e6e8ea", linewidth=0.6)
    axes.tick_params(which="both", length=0)
    axes.spines[:].set_color("#c9ced3")
    axes.set_xlabel("first answer", fontsize=9, color=INK)
    axes.set_ylabel("hidden", fontsize=9, color=INK)
    axes.set_title(f"{len(rows)} cases with one thing hidden or none; red: wrong", loc="left", fontsize=10, color=INK)
    return figure


def draw_rates(results: list[Result]) -> Figure:
    """All rates with their intervals, this tool's beside those of others."""
    tables = {who: rates(results, who) for who in (TOOL, *results[0]["rivals"])}
    whats = [what for what, r in tables[TOOL].items() if r.of]
    figure = Figure(figsize=(8.6, 1.3 + 0.55 * len(whats)), layout="constrained")
    axes = figure.subplots()
    for k, (who, table) in enumerate(tables.items()):
        for i, what in enumerate(whats):
            r = table.get(what)
            if r is None or not r.of:
                continue
            low, high = r.interval()
            y = i + 0.17 * (k - 1.5)
            axes.plot([low, high], [y, y], color=COLOURS[who], linewidth=1.6, alpha=0.55, solid_capstyle="round")
            label = who if what == whats[0] else None
            axes.plot(r.right / r.of, y, "o", color=COLOURS[who], markersize=5.5, label=label)
    axes.set_yticks(range(len(whats)), [f"{w}  ({tables[TOOL][w].of})" for w in whats], fontsize=9, color=INK)
    axes.set_ylim(len(whats) - 0.5, -0.5)
    axes.set_xlim(-0.02, 1.02)
    axes.xaxis.set_major_formatter(lambda x, _: f"{100 * x:.0f} %")
    axes.grid(axis="x", color="#e6e8ea", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(length=0, labelcolor=GREY)
    axes.tick_params(axis="y", labelcolor=INK)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.set_xlabel("share of cases (their number in brackets), with Wilson's 95 % interval", fontsize=9, color=INK)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=4, fontsize=8.5, frameon=False)
    return figure


def _answer(r: Result) -> str:
    if r["verdict"] == "adequate":
        return NOTHING
    said = answers(r, TOOL)
    return _short(said[0]) if said else UNKNOWN


def _short(name: str) -> str:
    return name.partition(" on ")[0]


def _order(name: str) -> tuple[bool, str]:
    return name.startswith("sensor_"), name
