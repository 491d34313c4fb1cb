"""The report of a diagnosis: one file that can be sent, the verdict first."""

import html
import math
from pathlib import Path

from edhas_jax.core import html_page
from edhas_jax.core.units import format_with_error
from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.planning.next_experiment import Experiment
from edhas_jax.diagnosis.report.figures import draw_missing_term, draw_pulls, draw_sensor_fault, draw_waterfall
from edhas_jax.diagnosis.report.machine_schematic import schematic
from edhas_jax.diagnosis.report.nonparametric_term import missing_term
from edhas_jax.diagnosis.report.sensor_fault import sensor_fault
from edhas_jax.diagnosis.report.trace_viewer import trace_view
from edhas_jax.diagnosis.search.candidates import Suspect
from edhas_jax.diagnosis.search.result import Diagnosis, Verdict
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.measurements.campaign import Use
from edhas_jax.measurements.unknown_parameters import UnknownParameter

LISTED = 14  # suspects in the table
LAWLESS = (
    "The points assume no law: they were estimated from what is left over, with the other parameters as fitted. "
    "The law is right where it passes through them."
)
STYLE = """<style>
.verdict { font-size: 1.25em; line-height: 1.4; border-left: 5px solid #de4a1c; padding: 0.2em 0 0.2em 0.9em }
.verdict.fine { border-color: #1a7f4b } .verdict p { margin: 0.2em 0 } .verdict p + p { font-size: 0.8em }
.card { border: 1px solid #d8dee4; border-radius: 8px; padding: 0.2em 1.2em; background: #f6f8fa }
.beside { display: flex; gap: 2em; flex-wrap: wrap; align-items: flex-start } .beside > * { flex: 1 1 460px }
</style>"""


def write_report(diagnosis: Diagnosis, path: Path, experiment: Experiment | None = None) -> None:
    """Write the report as one HTML file that needs nothing beside it; `experiment` is the run that tells most."""
    Path(path).write_text(diagnosis_report(diagnosis, experiment), encoding="utf-8")


def diagnosis_report(diagnosis: Diagnosis, experiment: Experiment | None = None) -> str:
    """The page as HTML."""
    campaign = diagnosis.campaign
    states = {"before": diagnosis.before, "calibrated": diagnosis.calibrated.residuals}
    form = diagnosis.forms[0].judged if diagnosis.verdict is Verdict.UNKNOWN_EFFECT and diagnosis.forms else None
    if diagnosis.accepted:
        states["after"] = diagnosis.after.residuals
    if form is not None:
        states["formula"] = form.residuals
    suspected = {} if diagnosis.verdict is Verdict.ADEQUATE else diagnosis.where()
    parts = [
        STYLE,
        html_page.heading(f"{campaign.name}: diagnosis", 1),
        html_page.paragraph(
            f"{campaign.machine.name}; {len(campaign.runs_for(Use.FIT))} runs fitted, "
            f"{len(campaign.runs_for(Use.HOLDOUT))} held out; {len(diagnosis.candidates())} suspects; "
            f"{diagnosis.seconds:.0f} s."
        ),
        _verdict(diagnosis),
        '<div class="beside"><div>', html_page.heading("Where"),
        schematic(campaign.machine, suspected, tuple(campaign.channels)),
        "</div><div>", html_page.heading("How the error falls"),
        html_page.image(draw_waterfall(diagnosis), "residual over noise from the present model down to the noise"),
        "</div></div>",
        html_page.heading("Measured and model"),
        html_page.paragraph("Click a model to switch it on or off; drag to zoom, double-click for the whole run. "
                       "Band: two standard deviations of the sensor's noise."),
        trace_view(campaign, states),
        *_terms(diagnosis),
        *_ambiguity(diagnosis, experiment),
        html_page.heading("Suspects"),
        _suspects(diagnosis),
        html_page.heading("What was believed of the parameters, and what was found"),
        html_page.image(draw_pulls(diagnosis), "uncertain parameters before and after"),
    ]  # fmt: skip
    if campaign.remarks:
        noticed = [str(remark) for remark in campaign.remarks]
        parts += [html_page.heading("What the reader noticed"), html_page.numbered_list(noticed)]
    return html_page.page(f"{campaign.name}: diagnosis", *parts)


def _verdict(diagnosis: Diagnosis) -> str:
    kind = "verdict fine" if diagnosis.verdict is Verdict.ADEQUATE else "verdict"
    sentences = "".join(f"<p>{html.escape(sentence)}</p>" for sentence in diagnosis.sentences())
    return f'<div class="{kind}">{sentences}</div>'


def found_in(diagnosis: Diagnosis) -> list[tuple[Fit, Suspect]]:
    """What was accepted, or the formula that stands for it, each with the fit that it is mounted in."""
    if diagnosis.verdict is Verdict.UNKNOWN_EFFECT and diagnosis.forms and diagnosis.forms[0].judged is not None:
        return [(diagnosis.forms[0].judged.fit, diagnosis.forms[0].suspect)]
    return [(diagnosis.final, trial.suspect) for trial in diagnosis.accepted]


def _terms(diagnosis: Diagnosis) -> list[str]:
    """The curve of each thing that was found, over its natural variable."""
    out = []
    for fitted, suspect in found_in(diagnosis):
        if suspect.signal is not None:
            out += [
                html_page.heading(f"What is wrong with the sensor: {suspect.name}"),
                html_page.image(draw_sensor_fault(sensor_fault(fitted, suspect)), f"{suspect.name}: what it adds"),
            ]
        elif (term := missing_term(fitted, suspect)) is not None:
            what = f"{term.slot.name.replace('_', ' ')} over {term.axis.replace('_', ' ')}"
            out += [
                html_page.heading(f"What is missing: {what}"),
                html_page.paragraph(LAWLESS),
                html_page.image(draw_missing_term(term), f"{suspect.name}: {what}"),
            ]
    return out


def _ambiguity(diagnosis: Diagnosis, experiment: Experiment | None) -> list[str]:
    groups = diagnosis.groups()
    if not groups and experiment is None:
        return []
    said = [f"These runs cannot tell {' and '.join(s.name for s in group)} apart." for group in groups]
    said += [experiment.sentence] if experiment is not None else []
    title = "What these runs cannot tell" if groups else "The next experiment"
    return [html_page.heading(title), '<div class="card">', *(f"<p>{html.escape(text)}</p>" for text in said), "</div>"]


def _suspects(diagnosis: Diagnosis) -> str:
    """The suspects that were tried, and the likeliest of the others, as an HTML table."""
    accepted = {t.suspect for t in diagnosis.accepted}
    groups = {s: k for k, group in enumerate(diagnosis.groups(), 1) for s in group}
    found = {suspect: p for suspect, p, _ in diagnosis.candidates()}
    promised = {score.suspect: score for r in reversed(diagnosis.rounds) for score in r.scores}
    tried = {t.suspect: t for r in reversed(diagnosis.rounds) for t in r.trials}
    # what was not tried differs in its promise more than in its probability
    order = {s: (s not in accepted, s not in tried, -p if s in tried else -promised[s].fall) for s, p in found.items()}
    body = []
    for suspect in sorted(found, key=order.__getitem__)[:LISTED]:
        p, trial = found[suspect], tried.get(suspect)
        judged = diagnosis.after if suspect in accepted else trial.judged if trial is not None else None
        said = [suspect.where.replace("_", " ")]
        said += [] if judged is None else sizes_of(suspect, judged.fit)
        said += ["accepted"] if suspect in accepted else ["tried"] if trial is not None else []
        said += [f"group {groups[suspect]}"] if suspect in groups else []
        body.append([
            suspect.name,
            f"{p:.3f}" if p >= 5e-4 else "0",
            f"{promised[suspect].fall:.3g}",
            f"{trial.gain:+.3g}" if trial is not None and math.isfinite(trial.gain) else "",
            f"{judged.level(Use.HOLDOUT):.3f}" if judged is not None else "",
            "; ".join(said),
        ])  # fmt: skip
    header = "effect", "probability", "promised fall of χ²", "gain of evidence", "error on new runs", "where, and size"
    return html_page.table(header, body)


def sizes_of(suspect: Suspect, fitted: Fit) -> list[str]:
    """A suspect's own parameters in a fit, with their standard errors."""
    return [
        f"{name.replace('_', ' ')} "
        + format_with_error(fitted.values[u.name], fitted.standard_errors[u.name], _unit(suspect, u))
        for name, u in suspect.own(fitted.problem.unknowns).items()
    ]


def _unit(suspect: Suspect, u: UnknownParameter) -> str:
    """The SI unit of an unknown; an offset has that of its signal."""
    return SIGNALS[suspect.signal].unit if suspect.signal and u.name.endswith(".offset") else u.unit
