"""The report of a comparison: one page, the matrix first, then where the model fails, in words and pictures."""

import numpy as np

from edhas_jax import page
from edhas_jax.comparison import Comparison
from edhas_jax.comparison_figures import draw_conditions, draw_pattern, draw_spectra, draw_traces, draw_where
from edhas_jax.comparison_table import COLUMNS, figures_of_merit
from edhas_jax.misfit_matrix import draw_matrix, notes_of
from edhas_jax.patterns import Pattern
from edhas_jax.replay import Replay
from edhas_jax.signals import SIGNALS
from edhas_jax.units import format_quantity

DRAWN = 4  # patterns with a picture of their own


def comparison_report(comparison: Comparison, patterns: list[Pattern]) -> str:
    """The page as HTML."""
    campaign = comparison.campaign
    effects = ", ".join(e.id for e in comparison.machine.effects) or "no effects"
    step = campaign.runs[0].interval / comparison.resolution.fine
    replayed = comparison.replay is not Replay.SET_POINT
    driven = f"the measured {comparison.replay.value}" if replayed else "set point and controller"
    notes = {run: text for run, text in notes_of(campaign).items() if run in comparison.matrix()}
    parts = [
        page.heading(f"{campaign.name}: model beside measurements", 1),
        page.paragraph(
            f"{comparison.machine.name} with {effects}, driven by {driven.replace('_', ' ')}; step "
            f"{format_quantity(step, 's')}, whose error is {comparison.resolution.error:.2f} of the noise at most. "
            "1 means that only the sensor's noise is left."
        ),
        page.picture(draw_matrix({"residual over noise": comparison.matrix()}, notes), "residual over noise"),
        page.heading("Where the model fails"),
        page.listing(sentences(patterns) or ["Nowhere: what is left is the sensors' noise."]),
        *(page.picture(draw_pattern(comparison, p), p.sentence) for p in patterns[:DRAWN] if np.isfinite(p.weight)),
        page.heading("What is left, against cycle, position, speed, current and pressure"),
        page.picture(draw_where(comparison), "mean residual in bins"),
        *_over_conditions(comparison),
        page.heading("Spectra of what is left"),
        page.picture(draw_spectra(comparison), "spectra of the residuals"),
    ]
    for signal in comparison.signals:
        parts += [
            page.heading(f"{signal.replace('_', ' ')}"),
            page.picture(draw_traces(comparison, signal), f"{signal}, measured and model"),
        ]
    meaning = page.listing([f"{n}: {doc}" for n, doc in COLUMNS.items()])
    parts += [page.heading("Figures"), meaning, _figures(comparison)]
    remarks = [*campaign.remarks, *comparison.remarks]
    if remarks:
        parts += [page.heading("What was noticed and left out"), page.listing([str(remark) for remark in remarks])]
    return page.page(f"{campaign.name}: comparison", *parts)


def _over_conditions(comparison: Comparison) -> list[str]:
    figure = draw_conditions(comparison)
    if figure is None:
        return []
    return [page.heading("What is left, run by run"), page.picture(figure, "residual over noise over the conditions")]


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
    return page.rows(header, body)
