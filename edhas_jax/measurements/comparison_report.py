"""The report of a comparison: one page, the matrix first, then where the model fails, in words and pictures."""

import numpy as np

from edhas_jax.core import html_page
from edhas_jax.core.units import format_quantity
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.measurements.comparison import Comparison
from edhas_jax.measurements.comparison_figures import (
    draw_binned_residuals,
    draw_pattern,
    draw_residuals_over_conditions,
    draw_spectra,
    draw_traces,
)
from edhas_jax.measurements.figures_of_merit import COLUMNS, figures_of_merit
from edhas_jax.measurements.replay import Replay
from edhas_jax.measurements.residual_matrix import draw_residual_matrix, run_descriptions
from edhas_jax.measurements.residual_patterns import Pattern

DRAWN = 4  # patterns with a picture of their own


def comparison_report(comparison: Comparison, patterns: list[Pattern]) -> str:
    """The page as HTML."""
    campaign = comparison.campaign
    effects = ", ".join(e.id for e in comparison.machine.effects) or "no effects"
    step = campaign.runs[0].interval / comparison.resolution.fine
    replayed = comparison.replay is not Replay.SET_POINT
    driven = f"the measured {comparison.replay.value}" if replayed else "set point and controller"
    notes = {run: text for run, text in run_descriptions(campaign).items() if run in comparison.rms_over_noise()}
    parts = [
        html_page.heading(f"{campaign.name}: model beside measurements", 1),
        html_page.paragraph(
            f"{comparison.machine.name} with {effects}, driven by {driven.replace('_', ' ')}; step "
            f"{format_quantity(step, 's')}, whose error is {comparison.resolution.error:.2f} of the noise at most. "
            "1 means that only the sensor's noise is left."
        ),
        html_page.image(
            draw_residual_matrix({"residual over noise": comparison.rms_over_noise()}, notes), "residual over noise"
        ),
        html_page.heading("Where the model fails"),
        html_page.numbered_list(sentences(patterns) or ["Nowhere: what is left is the sensors' noise."]),
        *(
            html_page.image(draw_pattern(comparison, p), p.sentence)
            for p in patterns[:DRAWN]
            if np.isfinite(p.weight)
        ),
        html_page.heading("What is left, against cycle, position, speed, current and pressure"),
        html_page.image(draw_binned_residuals(comparison), "mean residual in bins"),
        *_over_conditions(comparison),
        html_page.heading("Spectra of what is left"),
        html_page.image(draw_spectra(comparison), "spectra of the residuals"),
    ]
    for signal in comparison.signals:
        parts += [
            html_page.heading(f"{signal.replace('_', ' ')}"),
            html_page.image(draw_traces(comparison, signal), f"{signal}, measured and model"),
        ]
    meaning = html_page.numbered_list([f"{n}: {doc}" for n, doc in COLUMNS.items()])
    parts += [html_page.heading("Figures"), meaning, _figures(comparison)]
    remarks = [*campaign.remarks, *comparison.remarks]
    if remarks:
        listed = html_page.numbered_list([str(remark) for remark in remarks])
        parts += [html_page.heading("What was noticed and left out"), listed]
    return html_page.page(f"{campaign.name}: comparison", *parts)


def _over_conditions(comparison: Comparison) -> list[str]:
    figure = draw_residuals_over_conditions(comparison)
    if figure is None:
        return []
    drawn = html_page.image(figure, "residual over noise over the conditions")
    return [html_page.heading("What is left, run by run"), drawn]


def sentences(patterns: list[Pattern]) -> list[str]:
    """The patterns as sentences, each with what it explains of its signal's excess over the noise."""
    return [f"{p.sentence[0].upper()}{p.sentence[1:]} ({p.share:.0%} of what is left of it)." for p in patterns]


def _figures(comparison: Comparison) -> str:
    table = figures_of_merit(comparison)
    body = []
    for (run, signal), row in zip(table.index, table.itertuples(index=False), strict=True):
        unit = SIGNALS[signal].unit
        body.append([
            f"{run} {signal}", f"{row.residual_over_noise:.2f}", f"{row.nrmse:.3%}",
            *(format_quantity(value, unit) if np.isfinite(value) else "" for value in (row.peak, row.mean)),
            *("" if not np.isfinite(value) else text.format(value) for value, text in
              ((row.amplitude, "{:.4f}"), (np.degrees(row.phase), "{:+.2f}°"), (1e3 * row.delay, "{:+.3f} ms"))),
            f"{row.memory:+.2f}", "white" if row.white else "not white",
        ])  # fmt: skip
    header = ["", "off / noise", "NRMSE", "peak", "mean", "amplitude", "phase", "delay", "memory", ""]
    return html_page.table(header, body)
