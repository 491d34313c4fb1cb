"""Write the report of a comparison as one HTML page: residual matrix, patterns, figures and tables."""

from collections.abc import Mapping

import numpy as np

from edhas_jax.core import html_page
from edhas_jax.core.units import format_quantity
from edhas_jax.measurements import comparison_figures as figures
from edhas_jax.measurements.checks.data_summary import data_sentences
from edhas_jax.measurements.comparison import Comparison
from edhas_jax.measurements.figures_of_merit import COLUMNS, figures_of_merit
from edhas_jax.measurements.replay import Replay
from edhas_jax.measurements.residual_matrix import RESIDUAL, draw_residual_matrix, run_descriptions
from edhas_jax.measurements.residual_patterns import Pattern

MAX_DRAWN_PATTERNS = 4  # patterns with a figure of their own
NOTHING = "Nowhere: the residuals hold nothing but the noise of the sensors."


def comparison_report(
    comparison: Comparison, patterns: list[Pattern], matrices: Mapping[str, Mapping[str, Mapping[str, float]]]
) -> str:
    """The report as HTML.

    Args:
        comparison: the model compared with the measurements.
        patterns: the patterns in its residuals, the most important first.
        matrices: residual over noise by title, run and signal.
    """
    campaign = comparison.campaign
    effects = ", ".join(e.id for e in comparison.machine.effects) or "no effects"
    step = campaign.runs[0].interval / comparison.resolution.fine
    is_replay = comparison.replay is not Replay.SET_POINT
    model_input = f"the measured {comparison.replay.value}" if is_replay else "set point and controller"
    over_conditions = []
    if (figure := figures.draw_residuals_over_conditions(comparison)) is not None:
        image = html_page.image(figure, "residual over noise against the conditions")
        over_conditions = [html_page.heading("Residual over noise against the conditions of the runs"), image]
    drawn = [p for p in patterns[:MAX_DRAWN_PATTERNS] if np.isfinite(p.weight)]
    parts = [
        html_page.heading(f"{campaign.name}: model and measurements", 1),
        html_page.paragraph(
            f"{comparison.machine.name} with {effects}, driven by {model_input.replace('_', ' ')}; time step "
            f"{format_quantity(step, 's')}, whose error is at most {comparison.resolution.error:.2f} of the noise. "
            "A residual over noise of 1 means that only the noise of the sensor remains."
        ),
        *(html_page.paragraph(sentence) for sentence in data_sentences(campaign)),
        html_page.image(draw_matrices(comparison, matrices), RESIDUAL),
        html_page.heading("Where the model deviates"),
        html_page.numbered_list(sentences(patterns) or [NOTHING]),
        *(html_page.image(figures.draw_pattern(comparison, p), p.sentence) for p in drawn),
        html_page.heading("Mean error against phase, position, velocity, current and pressure"),
        html_page.image(figures.draw_binned_residuals(comparison), "mean error in bins"),
        *over_conditions,
        html_page.heading("Spectra of the residuals"),
        html_page.image(figures.draw_spectra(comparison), "spectra of the residuals"),
    ]
    for signal in comparison.signals:
        image = html_page.image(figures.draw_traces(comparison, signal), f"{signal}, measured and model")
        parts += [html_page.heading(signal.replace("_", " ")), image]
    meanings = html_page.numbered_list([f"{n}: {doc}" for n, doc in COLUMNS.items()])
    parts += [html_page.heading("Figures of merit"), meanings, _figures_of_merit_table(comparison)]
    remarks = [*campaign.remarks, *comparison.remarks]
    if remarks:
        listed = html_page.numbered_list([str(remark) for remark in remarks])
        parts += [html_page.heading("Remarks on the data, and data that were left out"), listed]
    return html_page.page(f"{campaign.name}: comparison", *parts)


def draw_matrices(comparison: Comparison, matrices: Mapping[str, Mapping[str, Mapping[str, float]]]):
    """A matplotlib figure of residual over noise by title, run and signal."""
    notes = run_descriptions(comparison.campaign)
    simulated = {compared.run.name for compared in comparison.runs}
    return draw_residual_matrix(matrices, {run: text for run, text in notes.items() if run in simulated})


def sentences(patterns: list[Pattern]) -> list[str]:
    """The patterns as sentences, each with the share that it explains of the excess of its signal over the noise."""
    return [f"{p.sentence[0].upper()}{p.sentence[1:]} ({p.share:.0%} of its excess over the noise)." for p in patterns]


def _figures_of_merit_table(comparison: Comparison) -> str:
    table = figures_of_merit(comparison)
    body = []
    for (run, signal), row in zip(table.index, table.itertuples(index=False), strict=True):
        unit = comparison.machine.signals[signal].unit
        optional = ((row.harmonic, "{:.0f}"), (row.amplitude, "{:.4f}"), (np.degrees(row.phase), "{:+.2f}°"),
                    (1e3 * row.delay, "{:+.3f} ms"))  # fmt: skip
        body.append([
            f"{run} {signal}", f"{row.residual_over_noise:.2f}", f"{row.nrmse:.3%}",
            *(format_quantity(value, unit) if np.isfinite(value) else "" for value in (row.peak, row.mean)),
            *(text.format(value) if np.isfinite(value) else "" for value, text in optional),
            f"{row.memory:+.2f}", "white" if row.white else "not white",
        ])  # fmt: skip
    columns = "residual / noise", "NRMSE", "peak", "mean", "harmonic", "amplitude", "phase", "delay", "autocorrelation"
    return html_page.table(["", *columns, ""], body)
