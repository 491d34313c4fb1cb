"""The figure of a law: the estimated curve with its error band beside the law of the library."""

import numpy as np

from edhas_jax.config.law_file import law_units
from edhas_jax.core.chart import Band, Chart, Curve, Style, Tone, draw_chart, style_axes
from edhas_jax.core.plot_style import GREY
from edhas_jax.core.units import from_si
from edhas_jax.diagnosis.laws.curve_basis import basis
from edhas_jax.diagnosis.laws.law_curve import LawCurve
from edhas_jax.machine.interface.slots import Rule
from edhas_jax.measurements.residuals import Z_95

LINE_POINTS = 400
VISIT_BINS = 60


def law_chart(curve: LawCurve, law_name: str = "") -> Chart:
    """A law as an estimated curve with a 95 % band, and the library's law.

    Args:
        curve: the curve.
        law_name: name of the library's law for the legend.
    """
    place, (x_unit, y_unit) = curve.place, _units(curve)
    is_factor = place.declaration.rule is Rule.SCALE
    x = np.unique(np.concatenate([np.linspace(curve.nodes[0], curve.nodes[-1], LINE_POINTS), curve.nodes]))
    through = basis(curve.nodes, x)
    whole, half = through @ curve.total, Z_95 * (np.abs(through) @ curve.std)

    def shown(values):
        return values if is_factor else from_si(values, place.value_unit, y_unit)

    nodes, across = (from_si(values, place.variable_unit, x_unit) for values in (curve.nodes, x))
    error = shown(Z_95 * curve.std) - shown(0.0)
    marks = Curve("estimated from the runs, 95 %", nodes, shown(curve.total), Tone.DATA, Style.MARKS, error)
    curves = [Curve("", across, shown(whole)), marks]
    if curve.law_values is not None:
        label = f"law of the library{f', {law_name}' if law_name else ''}, fitted alone"
        curves.append(Curve(label, across, shown(through @ curve.law_values), Tone.MODEL, Style.DASHED))
    curves.append(Curve("", nodes[[0, -1]], shown(np.full(2, place.neutral)), Tone.BESIDE))
    over = "".join(f" / {_words(name)}" for name in place.factors)
    titles = f"{_words(place.variable)}, {x_unit}", f"{_words(place.slot)}{over}" + (f", {y_unit}" if y_unit else "")
    return Chart(*titles, tuple(curves), (Band(across, shown(whole - half), shown(whole + half)),))


def draw_law_curve(curve: LawCurve, law_name: str = ""):
    """Draw the chart of a law, and below it how often each value was visited.

    Args and returns as of `law_chart`, but a matplotlib figure.
    """
    from edhas_jax.core.figure import Figure

    figure = Figure(figsize=(7.6, 4.6), layout="constrained")
    axes, below = figure.subplots(2, 1, sharex=True, height_ratios=(5, 1))
    chart = law_chart(curve, law_name)
    draw_chart(axes, chart)
    axes.set_xlabel("")
    visited = from_si(curve.variable_samples, curve.place.variable_unit, _units(curve)[0])
    below.hist(visited, bins=VISIT_BINS, color=GREY, alpha=0.5, log=True)
    style_axes(below, chart.x_title, "visits")
    below.set_yticks([])
    below.set_yticks([], minor=True)
    figure.legend(loc="outside upper left", ncols=2, fontsize=9, frameon=False)
    return figure


def _units(curve: LawCurve) -> tuple[str, str]:
    return law_units(curve.place, float(np.abs(curve.total).max()))


def _words(name: str) -> str:
    return name.replace("_", " ")
