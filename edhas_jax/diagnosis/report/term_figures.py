"""Figures of what was found: a missing term over its variable, and the error of a faulty sensor."""

import numpy as np

from edhas_jax.core.plot_style import COLOURS, GREY, INK
from edhas_jax.core.units import display_unit, from_si
from edhas_jax.diagnosis.report.nonparametric_term import NonparametricTerm
from edhas_jax.diagnosis.report.sensor_fault import SensorError
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.interface.slots import Rule

CURVE_BINS = 60  # bins of equal count over which the curve of a law is averaged
Z_95 = 1.96  # standard errors on either side of a 95 % interval


def draw_nonparametric_term(term: NonparametricTerm):
    """Draw a missing term over its variable: the points of the nonparametric estimate, and the candidate's law.

    Returns:
        A matplotlib figure.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.6, 4.2), layout="constrained")
    axes = figure.subplots()
    variable = SIGNALS[term.variable]
    is_factor = term.slot.rule is Rule.SCALE
    unit = "" if is_factor else display_unit(term.slot.unit, float(np.abs(term.law_samples).max()))

    def shown_x(values):
        return from_si(values, variable.unit, variable.display_unit)

    def shown_y(values):
        return values if is_factor else from_si(values, term.slot.unit, unit)

    x, law = _binned_means(term.variable_samples, term.law_samples)
    axes.plot(shown_x(term.variable_samples), shown_y(term.law_samples), ".", ms=1.5, color=COLOURS[1], alpha=0.25)
    text = getattr(term.candidate.kind, "text", None)
    label = f"accepted effect: {term.candidate.name}" if text is None else f"generic term: c · {text}"
    axes.plot(shown_x(x), shown_y(law), color=COLOURS[1], lw=1.6, label=label)
    half_width = Z_95 * np.abs(shown_y(term.std) - shown_y(0.0 * term.std))
    axes.errorbar(shown_x(term.nodes), shown_y(term.values), yerr=half_width, fmt="o", ms=5, color=COLOURS[0],
                  capsize=3, elinewidth=1.4, label="nonparametric estimate, 95 %")  # fmt: skip
    axes.axhline(1.0 if is_factor else 0.0, color=GREY, lw=0.8)
    axes.set_xlabel(f"{term.variable.replace('_', ' ')}, {variable.display_unit}", fontsize=9, color=INK)
    name = term.slot.name.replace("_", " ")
    axes.set_ylabel(f"{name}{'' if is_factor else f', {unit}'}", fontsize=9, color=INK)
    _style(figure, axes)
    return figure


def draw_sensor_fault(error: SensorError):
    """Draw the error of a sensor over its signal, or over the rate of change: measured, and by the accepted fault.

    Returns:
        A matplotlib figure.
    """
    from matplotlib.figure import Figure

    about = SIGNALS[error.candidate.signal]
    figure = Figure(figsize=(7.6, 4.2), layout="constrained")
    axes = figure.subplots()
    zero = from_si(0.0, about.unit, about.display_unit)
    x, measured, modelled, std = (
        from_si(v, about.unit, about.display_unit) - zero for v in (error.x, error.measured, error.modelled, error.std)
    )
    x = x if error.over_rate else x + zero
    axes.plot(x, modelled, color=COLOURS[1], lw=1.6, label=f"accepted fault: {error.candidate.name}")
    axes.errorbar(x, measured, yerr=Z_95 * std, fmt="o", ms=5, color=COLOURS[0], capsize=3, elinewidth=1.4,
                  label="measured − model, mean, 95 %")  # fmt: skip
    axes.axhline(0.0, color=GREY, lw=0.8)
    name = error.candidate.signal.replace("_", " ")
    label = f"rate of {name}, {about.display_unit}/s" if error.over_rate else f"{name}, {about.display_unit}"
    axes.set_xlabel(label, fontsize=9, color=INK)
    axes.set_ylabel(f"error of {name}, {about.display_unit}", fontsize=9, color=INK)
    _style(figure, axes)
    return figure


def _style(figure, axes) -> None:
    axes.grid(color="#e4e7eb", lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=GREY, labelsize=8)
    figure.legend(loc="outside upper left", ncols=2, fontsize=9, frameon=False)


def _binned_means(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means of x and y in bins of equal count over x."""
    bins = np.array_split(np.argsort(x), min(CURVE_BINS, len(x)))
    return np.array([x[b].mean() for b in bins]), np.array([y[b].mean() for b in bins])
