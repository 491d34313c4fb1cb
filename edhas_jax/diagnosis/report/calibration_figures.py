"""Figures of a calibration: estimates against their priors, drift between runs, correlations, profile likelihoods."""

import numpy as np

from edhas_jax.core.chart import Chart, Curve, Style, Tone, add_title, draw_chart, style_axes
from edhas_jax.core.literal_text import figure_text
from edhas_jax.core.plot_style import COLOURS, GREY, INK
from edhas_jax.core.units import display_unit, from_si
from edhas_jax.inference.fit.calibration import DRIFT_SCORE, IMPLAUSIBLE_DISTANCE, Calibration
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.inference.fit.uncertainty import CHI2_95, ProfileLikelihood
from edhas_jax.measurements.residuals import Z_95

PRIOR_COLOUR = "#d8dee4"


def draw_estimates(calibration: Calibration):
    """A matplotlib figure: estimates with 95 % intervals, in standard deviations of their priors."""
    from edhas_jax.core.figure import Figure

    fit = calibration.fit
    count = len(fit.x)
    figure = Figure(figsize=(9.5, 1.4 + 0.36 * count), layout="constrained")
    axes = figure.subplots()
    axes.axvspan(-1, 1, color=PRIOR_COLOUR, lw=0)
    axes.axvspan(-2, 2, color=PRIOR_COLOUR, lw=0, alpha=0.5)
    for edge in (-IMPLAUSIBLE_DISTANCE, IMPLAUSIBLE_DISTANCE):
        axes.axvline(edge, color=COLOURS[1], lw=0.9, ls=":")
    rows = np.arange(count)[::-1]
    axes.errorbar(fit.x, rows, xerr=Z_95 * fit.std, fmt="o", ms=5, color=COLOURS[0], elinewidth=2, capsize=3)
    if calibration.drift is not None:
        for k, row in enumerate(rows):
            axes.plot(calibration.drift.x[:, k], np.full(len(calibration.drift.x), row - 0.26), "|", ms=7, color=GREY)
    width = 1.15 * max(3.0, np.abs(fit.x + np.sign(fit.x) * Z_95 * fit.std).max())
    axes.set_xlim(-width, width)
    style_axes(axes, "distance from the prior mean, in prior standard deviations", grid="x")
    labels = [f"{u.name.replace('_', ' ')}   {fit.text(u.name)}" for u in fit.problem.unknowns]
    axes.set_yticks(rows, labels, fontsize=9, color=INK)
    legend = "● estimate with 95 % interval    | each run fitted alone    grey: prior ±1 σ, ±2 σ"
    axes.set_title(legend, fontsize=9, loc="left", color=INK)
    return figure


def draw_drift(calibration: Calibration):
    """A matplotlib figure: unknowns × runs, distance of a run's estimate from the common one, if computed."""
    drift = calibration.drift
    if drift is None:
        return None
    return _annotated_matrix(
        drift.score.T, list(drift.runs), [u.name for u in calibration.fit.problem.unknowns], 2.0 * DRIFT_SCORE,
        "each run fitted alone: distance from the common value in its standard deviations", "{:.1f}",
    )  # fmt: skip


def draw_correlations(calibration: Calibration):
    """A matplotlib figure: correlation matrix of the estimates."""
    names = [u.name for u in calibration.fit.problem.unknowns]
    return _annotated_matrix(calibration.fit.correlation, names, names, 1.0, "correlation of the estimates", "{:.2f}")


def profile_chart(fit: Fit, profile: ProfileLikelihood) -> Chart:
    """χ² along a parameter, with the parabola of its standard error and its 95 % interval."""
    name, unit = profile.name, next(u.unit for u in fit.problem.unknowns if u.name == profile.name)
    units = unit, display_unit(unit, float(np.median(profile.values)))
    fine = np.linspace(profile.values[0], profile.values[-1], 101)
    parabola = ((fine - fit.values[name]) / fit.standard_errors[name]) ** 2
    curves = (
        Curve("parabola of the standard error", from_si(fine, *units), parabola, Tone.BESIDE, Style.DASHED),
        Curve("all others fitted anew", from_si(profile.values, *units), profile.chi2_increase, style=Style.MARKED),
    )
    ends = tuple(float(from_si(value, *units)) for value in profile.interval())
    top = max(10.0, 1.05 * float(np.nanmax(profile.chi2_increase)))
    return Chart(f"{name.replace('_', ' ')}, {units[1]}", "increase of χ²", curves, (), (CHI2_95,), ends, (0.0, top))


def draw_profiles(calibration: Calibration):
    """A matplotlib figure: χ² along each unknown that was profiled, with its parabola; None without profiles."""
    from edhas_jax.core.figure import Figure

    profiles = calibration.profiles
    if not profiles:
        return None
    figure = Figure(figsize=(4.2 * min(3, len(profiles)) + 0.6, 3.2 * -(-len(profiles) // 3)), layout="constrained")
    grid = figure.subplots(-(-len(profiles) // 3), min(3, len(profiles)), squeeze=False)
    for axes, profile in zip(grid.flat, profiles, strict=False):
        chart = profile_chart(calibration.fit, profile)
        draw_chart(axes, chart)
        axes.annotate("95 %", (chart.curves[0].x[0], CHI2_95), fontsize=8, color=COLOURS[1], va="bottom")
    for axes in grid.flat[len(profiles) :]:
        axes.set_visible(False)
    grid.flat[0].legend(fontsize=8, frameon=False, loc="upper center")
    return figure


def _annotated_matrix(values: np.ndarray, columns: list[str], rows: list[str], limit: float, title: str, number: str):
    from edhas_jax.core.figure import Figure

    figure = Figure(figsize=(2.6 + 0.72 * len(columns), 1.6 + 0.36 * len(rows)), layout="constrained")
    axes = figure.subplots()
    axes.imshow(values, cmap="RdBu_r", vmin=-limit, vmax=limit, aspect="auto")
    for (row, column), value in np.ndenumerate(values):
        strong = abs(value) > 0.6 * limit
        text = number.format(value).replace("-0.00", "0.00") if np.isfinite(value) else ""
        axes.text(column, row, text, ha="center", va="center", fontsize=8, color="white" if strong else INK)
    turned = max(map(len, columns)) > 8
    axes.set_xticks(range(len(columns)), [figure_text(c.replace("_", " ")) for c in columns], fontsize=8, color=INK,
                    rotation=40 if turned else 0, ha="right" if turned else "center")  # fmt: skip
    axes.set_yticks(range(len(rows)), [figure_text(r.replace("_", " ")) for r in rows], fontsize=9, color=INK)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    add_title(figure, title, 10)
    return figure
