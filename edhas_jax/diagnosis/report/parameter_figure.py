"""Figure of the uncertain parameters of a diagnosed model: prior, calibrated without and with the accepted effects."""

import numpy as np

from edhas_jax.core.chart import style_axes
from edhas_jax.core.plot_style import COLOURS, INK
from edhas_jax.diagnosis.report.calibration_figures import PRIOR_COLOUR
from edhas_jax.diagnosis.search.result import Diagnosis
from edhas_jax.measurements.residuals import Z_95

CALIBRATED_COLOUR = COLOURS[4]
MIN_HALF_RANGE = 3.0  # of the horizontal axis, in standard deviations of the prior
ROW_OFFSET = 0.14  # vertical distance of the two estimates of a parameter from its row


def draw_parameter_shifts(diagnosis: Diagnosis):
    """Draw each uncertain parameter in standard deviations of its prior, before and after adding the best set.

    Returns:
        A matplotlib figure.
    """
    from edhas_jax.core.figure import Figure

    final, calibrated = diagnosis.final, diagnosis.calibrated.fit
    common = [k for k, u in enumerate(final.problem.unknowns) if u.name in calibrated.values]
    unknowns = calibrated.problem.unknowns
    first = {u.name: (x, s) for u, x, s in zip(unknowns, calibrated.x, calibrated.std, strict=True)}
    figure = Figure(figsize=(8.6, 1.3 + 0.36 * len(common)), layout="constrained")
    axes = figure.subplots()
    axes.axvspan(-2, 2, color=PRIOR_COLOUR, lw=0, alpha=0.5)
    axes.axvspan(-1, 1, color=PRIOR_COLOUR, lw=0)
    rows = np.arange(len(common))[::-1]
    names, half_range = [], MIN_HALF_RANGE
    for row, k in zip(rows, common, strict=True):
        u, x, std = final.problem.unknowns[k], final.x[k], final.std[k]
        before, before_std = first[u.name]
        axes.errorbar(before, row + ROW_OFFSET, xerr=Z_95 * before_std, fmt="o", mfc="white", ms=5,
                      color=CALIBRATED_COLOUR, capsize=2)  # fmt: skip
        axes.errorbar(x, row - ROW_OFFSET, xerr=Z_95 * std, fmt="o", ms=5, color=COLOURS[1], capsize=2)
        names.append(f"{u.name.replace('_', ' ')}   {final.text(u.name)}")
        half_range = max(half_range, abs(before) + Z_95 * before_std, abs(x) + Z_95 * std)
    axes.set_xlim(-1.1 * half_range, 1.1 * half_range)
    style_axes(axes, "distance from the prior mean, in prior standard deviations (grey: ±1, ±2)", grid="x")
    axes.set_yticks(rows, names, fontsize=9, color=INK)
    legend = "○ calibrated without candidates   ● with what was found   (95 %)"
    axes.set_title(legend, fontsize=9, loc="left", color=INK)
    return figure
