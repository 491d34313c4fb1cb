"""Heat maps: a metric over two parameters; others as small multiples, at a slice or averaged."""

import numpy as np

from edhas_jax.design.sweep.figure_selection import COLOURS, FAILED, INK, QUIET, FigureError, View, one_of, tick

MOST_COLUMNS, MOST_ROWS = 4, 3
PER_BIN = 25  # sampled designs in a cell, about


def heat(view: View, metric: str, x: str | None, y: str | None, average: bool):
    """A figure of heat maps.

    Raises:
        FigureError: fewer than two parameters vary, or `x` or `y` is none of them.
    """
    from matplotlib.figure import Figure

    varied = view.varied()
    if len(varied) < 2:
        raise FigureError("a heat map needs two parameters that vary", missing=True)
    for name in (x, y):
        if name is not None:
            one_of(name, varied, "no parameter that varies")
    telling = sorted(varied, key=lambda n: -_share(view, metric, n))
    x = x or next(n for n in telling if n != y)
    y = y or next(n for n in telling if n != x)
    if x == y:
        raise FigureError(f"--x and --y are both {x}; name two parameters")
    others = [n for n in varied if n not in (x, y)] if view.is_grid and not average else []
    columns, rows = (_panels(view, others, at, most) for at, most in ((0, MOST_COLUMNS), (1, MOST_ROWS)))
    held = {}
    for name in others[2:]:  # what has no room as a row or a column is held at its middle
        levels = np.unique(view.result.frame[name][view.chosen])
        held[name] = levels[len(levels) // 2]
    figure = Figure(figsize=(1.6 + 3.4 * len(columns) + (2.6 if len(columns) == 1 else 0),
                             1.3 + 2.9 * len(rows) + (1.4 if len(rows) == 1 else 0)), layout="constrained")  # fmt: skip
    grid = figure.subplots(len(rows), len(columns), squeeze=False, sharex=True, sharey=True)
    cells = {(r, c): _cells(view, metric, x, y, {**held, **row, **column})
             for r, row in enumerate(rows) for c, column in enumerate(columns)}  # fmt: skip
    finite = np.concatenate([mean[np.isfinite(mean)] for *_, mean, _ in cells.values()])
    if not len(finite):
        raise FigureError("every design that would be shown has failed", missing=True)
    low, high = finite.min(), finite.max()
    for (r, c), (x_edges, y_edges, mean, failed) in cells.items():
        axes = grid[r, c]
        image = axes.pcolormesh(x_edges, y_edges, mean, cmap=COLOURS, vmin=low, vmax=max(high, low + 1e-300))
        _hatch(axes, x_edges, y_edges, failed)
        _decorate(axes, view, x, y, {**rows[r], **columns[c]}, last=r == len(rows) - 1, first=c == 0)
        if view.is_grid and not failed.any():
            _contours(axes, x_edges, y_edges, mean, (low, high))
    bar = figure.colorbar(image, ax=grid, pad=0.02, aspect=28)
    bar.set_label(view.label(metric), color=INK, fontsize=10)
    bar.outline.set_visible(False)
    what = metric.replace("_", " ") + f" over {x.replace('_', ' ')} and {y.replace('_', ' ')}"
    what += "".join(f", {n.replace('_', ' ')} {view.quantity(n, v)}" for n, v in held.items())
    rest = [n for n in varied if n not in (x, y)] if not others else []
    if rest:
        what += f", mean over {', '.join(n.replace('_', ' ') for n in rest)}"
    figure.suptitle(view.title(what), x=0.01, ha="left", fontsize=11, color=INK)
    return figure


def _share(view: View, metric: str, name: str) -> float:
    """How much of the variance of a metric one parameter explains."""
    values, of = view.values(metric)[view.ok], view.values(name)[view.ok]
    if len(values) < 2:
        return 0.0
    order = values[np.argsort(of, kind="stable")]
    return float(np.var([part.mean() for part in np.array_split(order, min(10, len(order)))]))


def _panels(view: View, others: list[str], at: int, most: int) -> list[dict[str, float]]:
    """The values of a further parameter, a panel each; at most so many, spread over its range."""
    if len(others) <= at:
        return [{}]
    levels = np.unique(view.result.frame[others[at]][view.chosen])
    chosen = np.unique(np.linspace(0, len(levels) - 1, min(most, len(levels))).round().astype(int))
    return [{others[at]: levels[i]} for i in chosen]


def _cells(view: View, metric: str, x: str, y: str, held: dict[str, float]):
    """Edges of the cells (shown units), the mean of the metric in each, and where all designs have failed."""
    inside = view.chosen.copy()
    for name, value in held.items():
        inside &= view.result.frame[name].to_numpy() == value
    edges, index = [], []
    for name in (x, y):
        values = view.values(name)
        levels = np.unique(values[view.chosen])
        if view.is_grid or len(levels) <= 12:
            edges.append(_edges(levels, view.is_log(name)))
        else:
            count = int(np.clip(np.sqrt(inside.sum() / PER_BIN), 3, 40))
            spread = np.geomspace if view.is_log(name) else np.linspace
            edges.append(spread(levels[0], levels[-1], count + 1))
        index.append(np.clip(np.searchsorted(edges[-1], values, side="right") - 1, 0, len(edges[-1]) - 2))
    shape = (len(edges[1]) - 1, len(edges[0]) - 1)

    def total(mask, weights=None):
        at = (index[1][mask], index[0][mask])
        out = np.zeros(shape)
        np.add.at(out, at, 1.0 if weights is None else weights[mask])
        return out

    good = inside & view.ok
    count = total(good)
    mean = np.where(count > 0, total(good, view.values(metric)) / np.maximum(count, 1), np.nan)
    return edges[0], edges[1], mean, (count == 0) & (total(inside & view.failed) > 0)


def _edges(levels: np.ndarray, log: bool) -> np.ndarray:
    """Edges half way between the levels."""
    z = np.log(levels) if log else levels
    if len(z) == 1:
        edges = np.array([z[0] - 0.5, z[0] + 0.5])
    else:
        middle = 0.5 * (z[1:] + z[:-1])
        edges = np.concatenate([[2 * z[0] - middle[0]], middle, [2 * z[-1] - middle[-1]]])
    return np.exp(edges) if log else edges


def _hatch(axes, x_edges, y_edges, failed) -> None:
    if failed.any():
        from matplotlib.colors import ListedColormap

        axes.pcolor(
            x_edges, y_edges, np.ma.array(np.zeros(failed.shape), mask=~failed), cmap=ListedColormap([FAILED]),
            hatch="////", edgecolor=QUIET, linewidth=0.0,
        )  # fmt: skip


def _contours(axes, x_edges, y_edges, mean, span) -> None:
    if min(mean.shape) < 4 or np.isfinite(mean).sum() < 12 or not span[1] > span[0]:
        return
    from matplotlib.ticker import MaxNLocator

    x, y = 0.5 * (x_edges[1:] + x_edges[:-1]), 0.5 * (y_edges[1:] + y_edges[:-1])
    levels = [v for v in MaxNLocator(7).tick_values(*span) if span[0] < v < span[1]]
    lines = axes.contour(x, y, np.ma.masked_invalid(mean), levels=levels, colors="white", linewidths=0.8, alpha=0.9)
    axes.clabel(lines, fmt=tick, fontsize=8)


def _decorate(axes, view: View, x: str, y: str, at: dict[str, float], last: bool, first: bool) -> None:
    for name, axis, scale in ((x, axes.xaxis, axes.set_xscale), (y, axes.yaxis, axes.set_yscale)):
        if view.is_log(name):
            from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

            scale("log")
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(FuncFormatter(lambda v, _: tick(v)))
            axis.set_minor_formatter(NullFormatter())
    if at:
        axes.set_title(", ".join(f"{n.replace('_', ' ')} {view.quantity(n, v)}" for n, v in at.items()), fontsize=9)
    axes.set_xlabel(view.label(x) if last else "", color=INK)
    axes.set_ylabel(view.label(y) if first else "", color=INK)
    axes.tick_params(colors=QUIET, labelsize=8)
    axes.spines[:].set_visible(False)
