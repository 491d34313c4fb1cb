"""The figure of a law: the estimated curve with its error band beside the law of the library."""

import numpy as np

from edhas_jax.config.law_file import law_units
from edhas_jax.core.plot_style import COLOURS, GREY, INK
from edhas_jax.core.units import from_si
from edhas_jax.diagnosis.laws.curve_basis import basis
from edhas_jax.diagnosis.laws.law_curve import LawCurve
from edhas_jax.machine.interface.slots import Rule
from edhas_jax.measurements.residuals import Z_95

LINE_POINTS = 400
VISIT_BINS = 60


def draw_law_curve(curve: LawCurve, law_name: str = ""):
    """Draw a law as an estimated curve with a 95 % band, the library's law, and how often each value was visited.

    Args:
        curve: the curve.
        law_name: name of the library's law for the legend.

    Returns:
        A matplotlib figure.
    """
    from edhas_jax.core.figure import Figure

    figure = Figure(figsize=(7.6, 4.6), layout="constrained")
    axes, below = figure.subplots(2, 1, sharex=True, height_ratios=(5, 1))
    place = curve.place
    variable_si, value_si = place.variable_unit, place.value_unit
    variable_unit, value_unit = law_units(place, float(np.abs(curve.total).max()))
    is_factor = place.declaration.rule is Rule.SCALE

    def shown_x(values):
        return from_si(values, variable_si, variable_unit)

    def shown_y(values):
        return values if is_factor else from_si(values, value_si, value_unit)

    x = np.unique(np.concatenate([np.linspace(curve.nodes[0], curve.nodes[-1], LINE_POINTS), curve.nodes]))
    through = basis(curve.nodes, x)
    whole, half = through @ curve.total, Z_95 * (np.abs(through) @ curve.std)
    axes.fill_between(shown_x(x), shown_y(whole - half), shown_y(whole + half), color=COLOURS[0], alpha=0.2, lw=0)
    axes.plot(shown_x(x), shown_y(whole), color=COLOURS[0], lw=1.6)
    axes.errorbar(shown_x(curve.nodes), shown_y(curve.total), yerr=shown_y(Z_95 * curve.std) - shown_y(0.0), fmt="o",
                  ms=4, color=COLOURS[0], capsize=2, elinewidth=1.0, label="estimated from the runs, 95 %")  # fmt: skip
    if curve.law_values is not None:
        label = f"law of the library{f', {law_name}' if law_name else ''}, fitted alone"
        axes.plot(shown_x(x), shown_y(through @ curve.law_values), color=COLOURS[1], lw=1.6, ls="--", label=label)
    axes.axhline(shown_y(place.neutral), color=GREY, lw=0.8)
    below.hist(shown_x(curve.variable_samples), bins=VISIT_BINS, color=GREY, alpha=0.5, log=True)
    below.set_yticks([])
    below.set_yticks([], minor=True)
    below.set_ylabel("visits", fontsize=8, color=INK)
    below.set_xlabel(f"{_words(place.variable)}, {variable_unit}", fontsize=9, color=INK)
    over = "".join(f" / {_words(name)}" for name in place.factors)
    unit = f", {value_unit}" if value_unit else ""
    axes.set_ylabel(f"{_words(place.slot)}{over}{unit}", fontsize=9, color=INK)
    for part in (axes, below):
        part.grid(color="#e4e7eb", lw=0.6)
        part.set_axisbelow(True)
        part.spines[["top", "right"]].set_visible(False)
        part.tick_params(colors=GREY, labelsize=8)
    figure.legend(loc="outside upper left", ncols=2, fontsize=9, frameon=False)
    return figure


def _words(name: str) -> str:
    return name.replace("_", " ")
