"""The pictures of a comparison: traces over each other, where the residuals lie, their spectra, the worst patterns."""


from collections.abc import Mapping

import numpy as np

from edhas_jax.core.plot_style import COLOURS, INK, QUIET
from edhas_jax.core.units import format_quantity, from_si, shown_unit
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.parameters import find_parameter
from edhas_jax.measurements.campaign import Campaign, Use
from edhas_jax.measurements.comparison import Comparison, RunView
from edhas_jax.measurements.residual_patterns import Pattern

CYCLES, WINDOW = 2.0, 0.4  # what is shown of a run at its end: cycles, or share of its length where it has none
BINS = 30
AXES = ("phase", "piston_position", "piston_velocity", "current", "outlet_pressure")


def draw_traces(comparison: Comparison, signal: str):
    """A matplotlib figure: one signal in every run, measured with its noise band and model, and below what is left."""
    from matplotlib.figure import Figure

    views = [view for view in comparison.views if signal in view.residuals]
    columns = min(4, len(views))
    rows = -(-len(views) // columns)
    figure = Figure(figsize=(3.3 * columns + 0.6, 2.9 * rows + 0.4), layout="constrained")
    cells = figure.subplots(2 * rows, columns, squeeze=False, height_ratios=[2.2, 1.0] * rows)
    unit = SIGNALS[signal].shown
    noise = comparison.campaign.channels[signal].noise
    for k, view in enumerate(views):
        row, column = divmod(k, columns)
        above, below = cells[2 * row, column], cells[2 * row + 1, column]
        inside = _shown(view)
        time = 1e3 * view.run.time[inside]
        measured, model = (_in(signal, v[inside], unit) for v in (view.run.signals[signal], view.model[signal]))
        half = 2.0 * _size(signal, noise, unit)
        above.fill_between(time, model - half, model + half, color=COLOURS[1], alpha=0.25, lw=0)
        above.plot(time, measured, ".", ms=2.2, color=COLOURS[0], label="measured")
        above.plot(time, model, color=COLOURS[1], lw=1.1, label="model ± 2 noise")
        below.axhspan(-2, 2, color="#d8dee4", lw=0)
        below.plot(time, view.residuals[signal][inside], lw=0.8, color=COLOURS[0])
        below.set_xlabel("time, ms" if row == rows - 1 else "", fontsize=8, color=INK)
        says = format_quantity(view.frequency, "Hz") if np.isfinite(view.frequency) else ""
        title = f"{view.run.name}  {says}   {view.levels[signal]:.2f} × noise"
        above.set_title(title, fontsize=9, loc="left", color=INK)
        above.tick_params(labelbottom=False)
        for axes, label in ((above, f"{signal.replace('_', ' ')}, {unit}"), (below, "off / noise")):
            _plain(axes)
            if column == 0:
                axes.set_ylabel(label, fontsize=8, color=INK)
    for k in range(len(views), rows * columns):
        for axes in cells[2 * (k // columns) : 2 * (k // columns) + 2, k % columns]:
            axes.set_visible(False)
    handles, labels = cells[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=2, fontsize=8, frameon=False)
    return figure


def draw_where(comparison: Comparison):
    """A matplotlib figure: the mean residual, in units of the noise, against cycle, position, speed, current, pressure.

    One line a run, the runs coloured from pale to dark in the order of the campaign.
    """
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    axes_of = [a for a in AXES if a in comparison.views[0].model or a == "phase" and _cyclic(comparison)]
    signals = comparison.signals
    size = 2.7 * len(axes_of) + 1.6, 1.75 * len(signals) + 0.7
    figure = Figure(figsize=size, layout="constrained")
    cells = figure.subplots(len(signals), len(axes_of), squeeze=False, sharey="row", sharex="col")
    shades = colormaps["viridis"](np.linspace(0.9, 0.0, len(comparison.views)))
    for row, signal in enumerate(signals):
        for column, axis in enumerate(axes_of):
            here = cells[row, column]
            here.axhspan(-1, 1, color="#d8dee4", lw=0)
            for view, shade in zip(comparison.views, shades, strict=True):
                if signal in view.residuals:
                    at, mean = _binned(view, signal, axis)
                    here.plot(at, mean, color=shade, lw=1.2, label=view.run.name)
            _plain(here)
            if column == 0:
                here.set_ylabel(f"{signal.replace('_', ' ')}\noff / noise", fontsize=8, color=INK)
            if row == len(signals) - 1:
                unit = "share of the cycle" if axis == "phase" else f"{axis.replace('_', ' ')}, {SIGNALS[axis].shown}"
                here.set_xlabel(unit, fontsize=8, color=INK)
    handles, labels = cells[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right upper", fontsize=8, frameon=False)
    return figure


def draw_conditions(comparison: Comparison):
    """A matplotlib figure: residual over noise of each signal over the conditions that vary; None where none does."""
    from matplotlib.figure import Figure

    given = {n: [view.run.conditions.get(n, np.nan) for view in comparison.views] for view in comparison.views
             for n in view.run.conditions}  # fmt: skip
    varied = {n: np.array(values) for n, values in given.items() if len(np.unique(values)) > 1}
    if not varied:
        return None
    figure = Figure(figsize=(3.2 * len(varied) + 1.6, 3.0), layout="constrained")
    cells = figure.subplots(1, len(varied), squeeze=False, sharey=True)[0]
    for axes, (name, values) in zip(cells, varied.items(), strict=True):
        unit = find_parameter(comparison.machine, name)[0].unit
        shown = shown_unit(unit, float(np.nanmax(np.abs(values))))
        for signal, colour in zip(comparison.signals, COLOURS * 3, strict=False):
            rows = [view.levels.get(signal, np.nan) for view in comparison.views]
            axes.semilogy(from_si(values, unit, shown), rows, "o", ms=5, color=colour, label=signal.replace("_", " "))
        axes.axhline(1.0, color=QUIET, lw=0.9, ls="--")
        axes.set_xlabel(f"{name.replace('_', ' ')}, {shown}", fontsize=9, color=INK)
        _plain(axes)
    cells[0].set_ylabel("residual over noise", fontsize=9, color=INK)
    handles, labels = cells[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right upper", fontsize=8, frameon=False)
    return figure


def draw_spectra(comparison: Comparison):
    """A matplotlib figure: the spectra of the residuals in units of those of the sensors' noise; 1 is noise."""
    from matplotlib import colormaps
    from matplotlib.figure import Figure
    from scipy.signal import welch

    signals = comparison.signals
    figure = Figure(figsize=(2.9 * len(signals) + 1.4, 3.0), layout="constrained")
    cells = figure.subplots(1, len(signals), squeeze=False, sharey=True)[0]
    shades = colormaps["viridis"](np.linspace(0.9, 0.0, len(comparison.views)))
    for axes, signal in zip(cells, signals, strict=True):
        axes.axhline(1.0, color=QUIET, lw=0.9, ls="--")
        for view, shade in zip(comparison.views, shades, strict=True):
            if signal in view.residuals:
                values = np.nan_to_num(view.residuals[signal])
                rate = 1.0 / view.run.interval
                f, power = welch(values, rate, nperseg=min(512, len(values)), detrend=False)
                axes.loglog(f[1:], power[1:] * rate / 2.0, color=shade, lw=1.0, label=view.run.name)
        axes.set_title(signal.replace("_", " "), fontsize=9, loc="left", color=INK)
        axes.set_xlabel("frequency, Hz", fontsize=8, color=INK)
        _plain(axes)
    cells[0].set_ylabel("power of what is left / noise", fontsize=8, color=INK)
    handles, labels = cells[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right upper", fontsize=8, frameon=False)
    return figure


def draw_pattern(comparison: Comparison, pattern: Pattern):
    """A matplotlib figure: what is left of one signal against the quantity that tells it best, all runs."""
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 3.4), layout="constrained")
    axes = figure.subplots()
    views = [view for view in comparison.views if pattern.signal in view.residuals]
    unit = SIGNALS[pattern.signal].shown
    noise = comparison.campaign.channels[pattern.signal].noise
    scale = _size(pattern.signal, noise, unit)
    axes.axhspan(-2 * scale, 2 * scale, color="#d8dee4", lw=0, label="± 2 noise")
    shades = colormaps["viridis"](np.linspace(0.9, 0.0, len(views)))
    axis = pattern.axis if pattern.axis != "time" or not _cyclic(comparison) else "phase"
    for view, shade in zip(views, shades, strict=True):
        at = _along(view, axis)
        axes.plot(at, scale * view.residuals[pattern.signal], ".", ms=1.2, alpha=0.25, color=shade)
        middle, mean = _binned(view, pattern.signal, axis)
        axes.plot(middle, scale * mean, color=shade, lw=1.4, label=view.run.name)
    words = {"phase": "share of the cycle", "time": "time, s"}
    named = words.get(axis) or f"{axis.replace('_', ' ')}, {SIGNALS[axis].shown}"
    axes.set_xlabel(named, fontsize=9, color=INK)
    axes.set_ylabel(f"{pattern.signal.replace('_', ' ')}: measured − model, {unit}", fontsize=9, color=INK)
    axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    _plain(axes)
    return figure


def _cyclic(comparison: Comparison) -> bool:
    return all(np.isfinite(view.frequency) for view in comparison.views)


def _shown(view: RunView) -> np.ndarray:
    end = view.run.time[-1]
    length = CYCLES / view.frequency if np.isfinite(view.frequency) else WINDOW * end
    return view.run.time >= end - length


def _along(view: RunView, axis: str) -> np.ndarray:
    if axis == "phase":
        return view.phase
    return view.run.time if axis == "time" else _in(axis, view.model[axis], SIGNALS[axis].shown)


def _binned(view: RunView, signal: str, axis: str) -> tuple[np.ndarray, np.ndarray]:
    """Mean residual in bins of equal width along a quantity; bins with few samples are left out."""
    at, values = _along(view, axis), view.residuals[signal]
    ok = np.isfinite(at) & np.isfinite(values)
    if not ok.any():
        return np.zeros(0), np.zeros(0)
    edges = np.linspace(at[ok].min(), at[ok].max() + 1e-12, BINS + 1)
    place = np.clip(np.digitize(at[ok], edges) - 1, 0, BINS - 1)
    count = np.bincount(place, minlength=BINS)
    full = count >= 4
    sums = np.bincount(place, values[ok], minlength=BINS)
    return (0.5 * (edges[1:] + edges[:-1]))[full], sums[full] / count[full]


def _in(signal: str, values: np.ndarray, unit: str) -> np.ndarray:
    return from_si(values, SIGNALS[signal].unit, "" if unit == "-" else unit)


def _size(signal: str, size: float, unit: str) -> float:
    return float(_in(signal, np.array(size), unit) - _in(signal, np.array(0.0), unit))


def _plain(axes) -> None:
    axes.grid(True, color="#d8dee4", lw=0.5)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=QUIET, labelsize=7)



SCALE = (0.7, 30.0)  # residual over noise from the palest to the darkest colour
LADDER = ("#f3f6f4", "#fdf3d0", "#f9c76a", "#ea7a2e", "#b3261e", "#5a0f14")


def draw_matrix(panels: Mapping[str, Mapping[str, Mapping[str, float]]], notes: Mapping[str, str] | None = None):
    """A matplotlib figure with one matrix a panel: {title: {run: {signal: residual over noise}}}.

    `notes` are what is written beside the runs, such as their conditions. 1 means that only the sensor's noise is left.
    """
    from matplotlib.colors import LinearSegmentedColormap, LogNorm
    from matplotlib.figure import Figure

    runs = list(next(iter(panels.values())))
    signals = list(dict.fromkeys(n for table in panels.values() for row in table.values() for n in row))
    notes = notes or {}
    side = 0.075 * max((len(_label(run, notes)) for run in runs), default=4)
    size = 1.2 + side + 1.25 * len(signals) * len(panels), 1.3 + 0.38 * len(runs)
    figure = Figure(figsize=size, layout="constrained")
    colours = LinearSegmentedColormap.from_list("misfit", LADDER)
    grid = figure.subplots(1, len(panels), squeeze=False, sharey=True)[0]
    for axes, (title, table) in zip(grid, panels.items(), strict=True):
        values = np.array([[table[run].get(n, np.nan) for n in signals] for run in runs])
        shown = np.clip(np.where(np.isposinf(values), SCALE[1], values), *SCALE)
        image = axes.imshow(shown, cmap=colours, norm=LogNorm(*SCALE), aspect="auto")
        _write(axes, values)
        axes.set_xticks(range(len(signals)), [n.replace("_", "\n") for n in signals], fontsize=9, color=INK)
        axes.set_yticks(range(len(runs)), [_label(run, notes) for run in runs], fontsize=9, color=INK)
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
        axes.set_title(title, loc="left", fontsize=10, color=INK)
    bar = figure.colorbar(image, ax=grid, pad=0.01, aspect=22, ticks=[1, 2, 5, 10, 20])
    bar.ax.set_yticklabels(["1", "2", "5", "10", "20"], fontsize=8, color=QUIET)
    bar.ax.minorticks_off()
    bar.set_label("residual over noise", fontsize=9, color=INK)
    bar.outline.set_visible(False)
    return figure


def _label(run: str, notes: Mapping[str, str]) -> str:
    return f"{run}   {notes[run]}" if notes.get(run) else run


def _write(axes, values: np.ndarray) -> None:
    for (row, column), value in np.ndenumerate(values):
        if np.isnan(value):
            continue
        text = "fails" if np.isinf(value) else f"{value:.2f}" if value < 10 else f"{value:.0f}"
        axes.text(column, row, text, ha="center", va="center", fontsize=9, color="white" if value > 7 else INK)


def notes_of(campaign: Campaign) -> dict[str, str]:
    """The conditions of each run in a few words, and whether it is held out."""
    out = {}
    for run in campaign.runs:
        units = {name: find_parameter(campaign.machine, name)[0].unit for name in run.conditions}
        words = [format_quantity(value, units[name]) for name, value in run.conditions.items()]
        out[run.name] = ", ".join(words + (["held out"] if run.use is Use.HOLDOUT else []))
    return out
