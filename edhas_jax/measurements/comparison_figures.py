"""Figures of a comparison: measured and simulated traces, errors over signals and conditions, residual spectra.

Residuals are drawn as measured − model: they lie below zero where the model is too high.
"""

import numpy as np

from edhas_jax.core.chart import style_axes
from edhas_jax.core.literal_text import figure_text
from edhas_jax.core.plot_style import COLOURS, GREY, INK, time_unit
from edhas_jax.core.units import display_unit, format_quantity, from_si
from edhas_jax.machine.parameters import find_parameter
from edhas_jax.measurements.comparison import Comparison, RunComparison
from edhas_jax.measurements.residual_matrix import ERROR_LABEL
from edhas_jax.measurements.residual_patterns import Pattern

MAX_STATED_POINTS = 2000  # of a dashed line
SHOWN_CYCLES = 2.0  # cycles at the end of a run that are drawn
SHOWN_SHARE = 0.4  # share of the length that is drawn of a run without cycles
BIN_COUNT = 30
MIN_SAMPLES_PER_BIN = 4
NOISE_BAND_COLOUR = "#d8dee4"
MOST_BINNED = 5  # quantities over which errors are drawn


def draw_traces(comparison: Comparison, signal: str):
    """A matplotlib figure of one signal in every run: measured and model ± 2 standard deviations, error below."""
    runs = [compared for compared in comparison.runs if signal in compared.residuals]
    columns = min(4, len(runs))
    rows = -(-len(runs) // columns)
    size = 3.3 * columns + 0.6, 2.9 * rows + 0.4
    figure, cells = _figure(size, 2 * rows, columns, height_ratios=[2.2, 1.0] * rows)
    about = comparison.machine.signals[signal]
    half_width = 2.0 * _noise_shown(comparison, signal)
    for k, compared in enumerate(runs):
        row, column = divmod(k, columns)
        above, below = cells[2 * row, column], cells[2 * row + 1, column]
        shown = _shown_samples(compared)
        scale, time_name = time_unit(float(compared.run.time[-1]))
        time = scale * compared.run.time[shown]
        measured, model = (about.shown(v[signal][shown]) for v in (compared.run.signals, compared.model))
        above.fill_between(time, model - half_width, model + half_width, color=COLOURS[1], alpha=0.25, lw=0)
        above.plot(time, measured, ".", ms=2.2, color=COLOURS[0], label="measured")
        above.plot(time, model, color=COLOURS[1], lw=1.1, label="model ± 2 noise")
        below.axhspan(-2, 2, color=NOISE_BAND_COLOUR, lw=0)
        below.plot(time, compared.residuals[signal][shown], lw=0.8, color=COLOURS[0])
        frequency = format_quantity(compared.frequency, "Hz") if np.isfinite(compared.frequency) else ""
        title = f"{figure_text(compared.run.name)}  {frequency}   {compared.rms_over_noise[signal]:.2f} × noise"
        above.set_title(title, fontsize=9, loc="left", color=INK)
        titles = (f"{signal.replace('_', ' ')}, {about.display_unit}", ERROR_LABEL) if column == 0 else ("", "")
        style_axes(above, "", titles[0], size=8)
        above.tick_params(labelbottom=False)
        style_axes(below, f"time, {time_name}" if row == rows - 1 else "", titles[1], size=8)
    for axes in cells[-2:, len(runs) - (rows - 1) * columns :].flat:  # of the last row, without a run
        axes.set_visible(False)
    _legend(figure, cells, "upper right", 2)
    return figure


def draw_binned_residuals(comparison: Comparison):
    """A matplotlib figure of the mean error over noise in bins of phase, position, velocity, current and pressure.

    One line per run.
    """
    machine, model = comparison.machine, comparison.runs[0].model
    abscissae = ["phase"] * _all_cyclic(comparison)
    abscissae += [n for n in machine.explaining or machine.signals if n in model and n != "time"]
    abscissae = abscissae[:MOST_BINNED]
    signals = comparison.signals
    size = 2.7 * len(abscissae) + 1.6, 1.75 * len(signals) + 0.7
    figure, cells = _figure(size, len(signals), len(abscissae), sharey="row", sharex="col")
    shades = _run_colours(len(comparison.runs))
    for row, signal in enumerate(signals):
        for column, axis in enumerate(abscissae):
            cell = cells[row, column]
            cell.axhspan(-1, 1, color=NOISE_BAND_COLOUR, lw=0)
            for compared, shade in zip(comparison.runs, shades, strict=True):
                if signal in compared.residuals:
                    at, mean = _binned(comparison, compared, signal, axis)
                    cell.plot(at, mean, color=shade, lw=1.2, label=figure_text(compared.run.name))
            title = f"{signal.replace('_', ' ')}\n{ERROR_LABEL}" if column == 0 else ""
            style_axes(cell, _axis_label(comparison, axis) if row == len(signals) - 1 else "", title, size=8)
    _legend(figure, cells)
    return figure


def draw_residuals_over_conditions(comparison: Comparison):
    """A matplotlib figure of residual over noise against the conditions that vary between runs; None if none does."""
    names = dict.fromkeys(n for compared in comparison.runs for n in compared.run.conditions)
    conditions = {n: [compared.run.conditions.get(n, np.nan) for compared in comparison.runs] for n in names}
    varied = {n: np.array(values) for n, values in conditions.items() if len(np.unique(values)) > 1}
    if not varied:
        return None
    figure, cells = _figure((3.2 * len(varied) + 1.6, 3.0), 1, len(varied), sharey=True)
    for axes, (name, values) in zip(cells[0], varied.items(), strict=True):
        unit = find_parameter(comparison.machine, name)[0].unit
        shown = display_unit(unit, float(np.nanmax(np.abs(values))))
        for signal, colour in zip(comparison.signals, COLOURS * 3, strict=False):
            rows = [compared.rms_over_noise.get(signal, np.nan) for compared in comparison.runs]
            axes.semilogy(from_si(values, unit, shown), rows, "o", ms=5, color=colour, label=signal.replace("_", " "))
        axes.axhline(1.0, color=GREY, lw=0.9, ls="--")
        style_axes(axes, f"{name.replace('_', ' ')}, {shown}", "residual over noise" if axes is cells[0, 0] else "")
    _legend(figure, cells)
    return figure


def draw_spectra(comparison: Comparison):
    """A matplotlib figure of the power spectra of the residuals over that of white sensor noise, which is 1."""
    from scipy.signal import welch

    signals, shades = comparison.signals, _run_colours(len(comparison.runs))
    figure, cells = _figure((2.9 * len(signals) + 1.4, 3.0), 1, len(signals), sharey=True)
    for axes, signal in zip(cells[0], signals, strict=True):
        axes.axhline(1.0, color=GREY, lw=0.9, ls="--")
        for compared, shade in zip(comparison.runs, shades, strict=True):
            if signal in compared.residuals:
                values = np.nan_to_num(compared.residuals[signal], posinf=0.0, neginf=0.0)
                rate = 1.0 / compared.run.interval
                f, power = welch(values, rate, nperseg=min(512, len(values)), detrend=False)
                axes.loglog(f[1:], power[1:] * rate / 2.0, color=shade, lw=1.0, label=figure_text(compared.run.name))
        axes.set_title(signal.replace("_", " "), fontsize=9, loc="left", color=INK)
        style_axes(axes, "frequency, Hz", "residual power / noise power" if axes is cells[0, 0] else "", size=8)
    _legend(figure, cells)
    return figure


def draw_pattern(comparison: Comparison, pattern: Pattern):
    """A matplotlib figure of the error of one signal over the quantity of its pattern, all runs."""
    figure, ((axes,),) = _figure((6.4, 3.4), 1, 1)
    runs = [compared for compared in comparison.runs if pattern.signal in compared.residuals]
    scale, unit = _noise_shown(comparison, pattern.signal), comparison.machine.signals[pattern.signal].display_unit
    axes.axhspan(-2 * scale, 2 * scale, color=NOISE_BAND_COLOUR, lw=0, label="± 2 noise")
    shades = _run_colours(len(runs))
    axis = pattern.axis if pattern.axis != "time" or not _all_cyclic(comparison) else "phase"
    for compared, shade in zip(runs, shades, strict=True):
        at = _abscissa(comparison, compared, axis)
        axes.plot(at, scale * compared.residuals[pattern.signal], ".", ms=1.2, alpha=0.25, color=shade)
        middle, mean = _binned(comparison, compared, pattern.signal, axis)
        axes.plot(middle, scale * mean, color=shade, lw=1.4, label=figure_text(compared.run.name))
    if pattern.stated and pattern.axis != "time":
        # the residual that the sentence of the pattern states
        at = np.concatenate([_abscissa(comparison, compared, pattern.axis) for compared in runs])
        order = np.argsort(at)
        order = order[np.linspace(0, len(order) - 1, MAX_STATED_POINTS).astype(int)] if len(order) else order
        stated = -scale / comparison.campaign.channels[pattern.signal].noise * np.concatenate(pattern.stated)
        axes.plot(at[order], stated[order], color=INK, lw=1.8, ls="--", label="as the sentence says")
    style_axes(axes, _axis_label(comparison, axis), f"{pattern.signal.replace('_', ' ')}: measured − model, {unit}")
    axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _figure(size: tuple[float, float], rows: int, columns: int, **sharing):
    """A matplotlib figure of a size [inch], and its axes (rows, columns)."""
    from edhas_jax.core.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **sharing)


def _legend(figure, cells, place: str = "right upper", columns: int = 1) -> None:
    """The legend of the first axes, outside of all."""
    figure.legend(
        *cells[0, 0].get_legend_handles_labels(), loc=f"outside {place}", ncols=columns, fontsize=8, frameon=False
    )


def _run_colours(count: int):
    """A colour for each run: distinct ones for a few, from pale to dark for many."""
    from matplotlib import colormaps

    return COLOURS[:count] if count <= len(COLOURS) else colormaps["viridis"](np.linspace(0.9, 0.0, count))


def _axis_label(comparison: Comparison, axis: str) -> str:
    labels = {"phase": "phase in the cycle, 0 … 1", "time": "time, s"}
    return labels.get(axis) or f"{axis.replace('_', ' ')}, {comparison.machine.signals[axis].display_unit}"


def _all_cyclic(comparison: Comparison) -> bool:
    return all(np.isfinite(compared.frequency) for compared in comparison.runs)


def _shown_samples(compared: RunComparison) -> np.ndarray:
    """Mask of the samples at the end of a run that are drawn."""
    end = compared.run.time[-1]
    length = SHOWN_CYCLES / compared.frequency if np.isfinite(compared.frequency) else SHOWN_SHARE * end
    return compared.run.time >= end - length


def _abscissa(comparison: Comparison, compared: RunComparison, axis: str) -> np.ndarray:
    """The samples of the quantity over which residuals are drawn, in its display unit."""
    if axis in ("phase", "time"):
        return compared.phase if axis == "phase" else compared.run.time
    return comparison.machine.signals[axis].shown(compared.model[axis])


def _binned(comparison: Comparison, compared: RunComparison, signal: str, axis: str) -> tuple[np.ndarray, np.ndarray]:
    """Centres of bins of equal width along a quantity, and the mean error over noise in each, without sparse bins."""
    at, values = _abscissa(comparison, compared, axis), compared.residuals[signal]
    ok = np.isfinite(at) & np.isfinite(values)
    if not ok.any():
        return np.zeros(0), np.zeros(0)
    edges = np.linspace(at[ok].min(), at[ok].max() + 1e-12, BIN_COUNT + 1)
    bin_index = np.clip(np.digitize(at[ok], edges) - 1, 0, BIN_COUNT - 1)
    count = np.bincount(bin_index, minlength=BIN_COUNT)
    full = count >= MIN_SAMPLES_PER_BIN
    sums = np.bincount(bin_index, values[ok], minlength=BIN_COUNT)
    return (0.5 * (edges[1:] + edges[:-1]))[full], sums[full] / count[full]


def _noise_shown(comparison: Comparison, signal: str) -> float:
    """The standard deviation of the noise of a signal in its display unit, which may have an offset."""
    about, noise = comparison.machine.signals[signal], comparison.campaign.channels[signal].noise
    return float(about.shown_difference(noise))
