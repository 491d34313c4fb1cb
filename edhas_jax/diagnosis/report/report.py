"""The report of a diagnosis: one self-contained HTML file, the verdict first."""

import html
import math
from collections.abc import Callable, Sequence
from pathlib import Path

from edhas_jax.core import html_page
from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.core.optional_parts import OptionalParts
from edhas_jax.diagnosis.candidates.candidate import Candidate
from edhas_jax.diagnosis.candidates.free_curve import CurveCandidate, fitted_curve
from edhas_jax.diagnosis.candidates.law_deviation import deviation_of
from edhas_jax.diagnosis.candidates.memory_term import MemoryTerm
from edhas_jax.diagnosis.laws.curve_figure import draw_law_curve
from edhas_jax.diagnosis.laws.curve_fit import estimate_law_curve
from edhas_jax.diagnosis.laws.law_curve import LawCurve
from edhas_jax.diagnosis.planning.next_experiment import Experiment
from edhas_jax.diagnosis.report.bench_findings import bench_rows
from edhas_jax.diagnosis.report.conclusions import conclusions, evidence_text, outcome
from edhas_jax.diagnosis.report.machine_schematic import draw_schematic
from edhas_jax.diagnosis.report.parameter_figure import draw_parameter_shifts
from edhas_jax.diagnosis.report.residual_stages import draw_waterfall
from edhas_jax.diagnosis.report.sensor_fault import draw_sensor_fault, estimate_sensor_error
from edhas_jax.diagnosis.report.trace_viewer import render_trace_viewer
from edhas_jax.diagnosis.search.member_laws import MemberLaw
from edhas_jax.diagnosis.search.result import Diagnosis, Verdict
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.measurements.campaign import Use, runs_text
from edhas_jax.measurements.checks.data_summary import data_sentences

MAX_LISTED_CANDIDATES, MAX_LISTED_SETS = 14, 8
MIN_SHOWN_PROBABILITY = 5e-4  # smaller ones are shown as 0
CURVE_NOTE = "The curve assumes no formula: it is fitted to the runs together with all other unknowns."
STYLE = """<style>
.verdict { font-size: 1.25em; line-height: 1.4; border-left: 5px solid #de4a1c; padding: 0.2em 0 0.2em 0.9em }
.verdict.fine { border-color: #1a7f4b } .verdict p { margin: 0.2em 0 } .verdict p + p { font-size: 0.8em }
.card { border: 1px solid rgba(128,128,128,.35); border-radius: 8px; padding: 0.2em 1.2em;
  background: rgba(128,128,128,.08) }
.beside { display: flex; gap: 2em; flex-wrap: wrap; align-items: flex-start } .beside > * { flex: 1 1 460px }
</style>"""


def write_report(
    diagnosis: Diagnosis, path: Path, experiment: Experiment | None = None, failures: Sequence[str] = (),
    pictures: bool = True,
) -> list[str]:  # fmt: skip
    """Write the report of a diagnosis as one self-contained HTML file.

    A picture that cannot be drawn leaves a sentence in its place.

    Args:
        diagnosis: the result to report.
        path: file to write.
        experiment: the run recommended next.
        failures: sentences on other parts of the result that could not be made.
        pictures: whether the report has pictures; without them it is text and tables alone.

    Returns:
        A sentence for each picture that could not be drawn.
    """
    optional = OptionalParts()
    text = diagnosis_report(diagnosis, experiment, failures, pictures, optional)
    with atomic_write(Path(path)) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return optional.failures


def diagnosis_report(
    diagnosis: Diagnosis, experiment: Experiment | None = None, failures: Sequence[str] = (), pictures: bool = True,
    optional: OptionalParts | None = None,
) -> str:  # fmt: skip
    """The report as HTML; `optional` collects what fails, the other arguments are those of `write_report`."""
    campaign, optional = diagnosis.campaign, optional or OptionalParts()

    def picture(what: str, draw: Callable[[], list[str]]) -> list[str]:
        """The HTML of a section with pictures, or the sentence on its failure."""
        if not pictures:
            return []
        made = optional.attempt(f"The {what} of the report", draw)
        return [html_page.paragraph(optional.failures[-1])] if made is None else made

    parts = [
        STYLE,
        html_page.heading(f"{campaign.name}: diagnosis", 1),
        html_page.paragraph(
            f"{campaign.machine.name}; {runs_text(campaign.runs_for(Use.FIT))} fitted, "
            f"{len(campaign.runs_for(Use.HOLDOUT))} held out; {diagnosis.weighing.named} candidates; "
            f"{diagnosis.seconds:.0f} s."
        ),
        _verdict_box(diagnosis),
        *(html_page.paragraph(sentence) for sentence in failures),
        '<div class="beside"><div>', *picture("drawing of the machine", lambda: _location_section(diagnosis)),
        "</div><div>", *picture("residual after each stage", lambda: _waterfall_section(diagnosis)),
        "</div></div>",
        *picture("measured and simulated signals", lambda: _signals_section(diagnosis)),
        *picture("missing term", lambda: _term_sections(diagnosis)),
        *_ambiguity_section(diagnosis, experiment),
        *_bench_section(diagnosis),
        html_page.heading("Sets of effects"),
        _set_table(diagnosis),
        html_page.heading("Candidates"),
        _candidate_table(diagnosis),
        *picture("parameters", lambda: _parameter_section(diagnosis)),
    ]  # fmt: skip
    if campaign.remarks:
        remarks = [str(remark) for remark in campaign.remarks]
        parts += [html_page.heading("Remarks on the measurement files"), html_page.numbered_list(remarks)]
    return html_page.page(f"{campaign.name}: diagnosis", *parts)


def _verdict_box(diagnosis: Diagnosis) -> str:
    kind = "verdict fine" if diagnosis.verdict is Verdict.ADEQUATE else "verdict"
    sentences = data_sentences(diagnosis.campaign, conclusions(diagnosis))
    sentences = "".join(f"<p>{html.escape(sentence)}</p>" for sentence in sentences)
    return f'<div class="{kind}">{sentences}</div>'


def _location_section(diagnosis: Diagnosis) -> list[str]:
    """The machine with the probability of each component."""
    campaign = diagnosis.campaign
    probabilities = {} if diagnosis.verdict is Verdict.ADEQUATE else diagnosis.posterior.locations()
    schematic = draw_schematic(campaign.machine, probabilities, tuple(campaign.channels))
    return [html_page.heading("Location"), schematic]


def _waterfall_section(diagnosis: Diagnosis) -> list[str]:
    """The residual after each stage."""
    caption = "residual over noise from the present model down to the noise"
    return [html_page.heading("Residual after each stage"), html_page.image(draw_waterfall(diagnosis), caption)]


def _signals_section(diagnosis: Diagnosis) -> list[str]:
    """The interactive plot of measured and simulated signals."""
    states = {"before": diagnosis.before, "calibrated": diagnosis.calibrated.residuals}
    if diagnosis.posterior.best.members:
        states["after"] = diagnosis.after.residuals
    explanation = (
        "Click a model to switch it on or off; drag to zoom, double-click for the whole run. "
        "Band: two standard deviations of the sensor's noise."
    )
    return [
        html_page.heading("Measured and simulated signals"),
        html_page.paragraph(explanation),
        render_trace_viewer(diagnosis.campaign, states),
    ]


def _parameter_section(diagnosis: Diagnosis) -> list[str]:
    """The uncertain parameters before and after."""
    image = html_page.image(draw_parameter_shifts(diagnosis), "uncertain parameters before and after")
    return [html_page.heading("Parameters: prior and estimates"), image]


def _term_sections(diagnosis: Diagnosis) -> list[str]:
    """For each member of the best set, the missing term over its variable or the error of its sensor."""
    out, fitted = [], diagnosis.final
    laws = {law.candidate: law for law in diagnosis.laws}
    for candidate in diagnosis.posterior.best.members:
        if candidate.signal is not None:
            figure = draw_sensor_fault(estimate_sensor_error(fitted, candidate))
            out += [
                html_page.heading(f"Sensor fault: {candidate.name}"),
                html_page.image(figure, f"{candidate.name}: error of the sensor"),
            ]
        elif (curve := law_curve(diagnosis, candidate)) is not None:
            title = f"{curve.place.slot.replace('_', ' ')} over {curve.place.variable.replace('_', ' ')}"
            sentence = "" if curve.law_values is None else f" {law_sentence(curve, laws[candidate])}"
            out += [
                html_page.heading(f"Missing term: {title}"),
                html_page.paragraph(f"{CURVE_NOTE}{sentence}"),
                html_page.image(draw_law_curve(curve, candidate.name), f"{candidate.name}: {title}"),
            ]
    return out


def law_curve(diagnosis: Diagnosis, candidate: Candidate) -> LawCurve | None:
    """The curve estimated for a member of the best set; None for a memory, or a law that is no function of a signal."""
    if isinstance(candidate, CurveCandidate):
        return fitted_curve(diagnosis.final, candidate)
    if isinstance(candidate, MemoryTerm):
        return None
    deviation, alone = deviation_of(candidate, diagnosis.curves), None
    if deviation is not None:
        alone = diagnosis.fit_of_parameters(candidate)
    id_of = None if deviation is None else deviation.id
    found = estimate_law_curve(diagnosis.final, candidate.id, deviation=id_of, alone=alone)
    return None if found is None else found.curve


def law_sentence(curve: LawCurve, law: MemberLaw) -> str:
    """How the law of the library and the estimated curve agree, as a sentence.

    Args:
        curve: the curve.
        law: what the measurements say of the law.
    """
    share = 100.0 * curve.explained_share
    explained = "nearly all" if share >= 99.95 else f"{share:.1f} %"
    if not law.differs:
        return f"The law of the library explains {explained} of it, and the runs need no other."
    return (
        f"The law of the library explains {explained} of it at its best size, but the runs are precise enough to show "
        f"that the law is another one (evidence: {evidence_text(law.gain)})."
    )


def _ambiguity_section(diagnosis: Diagnosis, experiment: Experiment | None) -> list[str]:
    """The confounded candidates and the recommended run."""
    groups = diagnosis.confounded_groups()
    if not groups and experiment is None:
        return []
    sentences = [f"These runs cannot distinguish {' and '.join(c.name for c in group)}." for group in groups]
    sentences += [experiment.sentence] if experiment is not None else []
    title = "Confounded candidates" if groups else "The next experiment"
    paragraphs = (f"<p>{html.escape(text)}</p>" for text in sentences)
    return [html_page.heading(title), '<div class="card">', *paragraphs, "</div>"]


def _bench_section(diagnosis: Diagnosis) -> list[str]:
    """The deviations of triggers, settings and sensors that the runs show."""
    rows = bench_rows(diagnosis.after)
    if not rows:
        return []
    header = "what", "run", "deviation", "accuracy of the bench"
    return [html_page.heading("What the bench did"), html_page.table(header, rows)]


def _set_table(diagnosis: Diagnosis) -> str:
    """The most probable sets of effects with their probabilities and residuals, as an HTML table."""
    posterior, body = diagnosis.posterior, []
    for of, weight in list(zip(posterior.sets, posterior.weights, strict=True))[:MAX_LISTED_SETS]:
        names = " + ".join(c.title for c in of.members) or "nothing"
        body.append([names, _probability_text(weight), *(_rms_text(of.evaluated.rms_over_noise(use)) for use in Use)])
    header = "set", "probability", "residual/noise on fitted runs", "on held-out runs"
    return html_page.table(header, body, [weight < MIN_SHOWN_PROBABILITY for weight in posterior.weights[: len(body)]])


def _candidate_table(diagnosis: Diagnosis) -> str:
    """The candidates that were fitted, as an HTML table."""
    groups = {c: k for k, group in enumerate(diagnosis.confounded_groups(), 1) for c in group}
    body, quiet = [], []
    for candidate, p in diagnosis.posterior.candidates()[:MAX_LISTED_CANDIDATES]:
        said = outcome(diagnosis, candidate)
        remarks = [candidate.location.replace("_", " ")]
        remarks += [*parameter_texts(candidate, diagnosis.fit_of_parameters(candidate)), said.value]
        remarks += [f"group {groups[candidate]}"] if candidate in groups else []
        rms = diagnosis.model_with(candidate).rms_over_noise(Use.HOLDOUT)
        evidence = evidence_text(diagnosis.posterior.evidence(candidate))
        quiet.append(said.is_quiet)
        body.append([candidate.name, _probability_text(p), evidence, _rms_text(rms), "; ".join(remarks)])
    header = "candidate", "probability", "evidence", "residual/noise on held-out runs", "location and parameters"
    return html_page.table(header, body, quiet)


def _probability_text(p: float) -> str:
    return f"{p:.3f}" if p >= MIN_SHOWN_PROBABILITY else "0"


def _rms_text(rms: float) -> str:
    return f"{rms:.3f}" if math.isfinite(rms) else ""


def parameter_texts(candidate: Candidate, fitted: Fit) -> list[str]:
    """The parameters of a candidate in a fit as text, with standard errors and units."""
    own, machine = candidate.own_unknowns(fitted.problem.unknowns), fitted.problem.machine
    return [f"{name.replace('_', ' ')} {fitted.text(u.name, candidate.unit(u, machine))}" for name, u in own.items()]
