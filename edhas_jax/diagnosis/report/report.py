"""The report of a diagnosis: one self-contained HTML file, the verdict first."""

import html
import math
from collections.abc import Callable, Sequence
from pathlib import Path

from edhas_jax.core import html_page
from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.core.optional_parts import OptionalParts
from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.laws.curve_figure import draw_law_curve
from edhas_jax.diagnosis.laws.curve_fit import estimate_law_curve
from edhas_jax.diagnosis.laws.law_curve import LawCurve
from edhas_jax.diagnosis.planning.next_experiment import Experiment
from edhas_jax.diagnosis.report.machine_schematic import draw_schematic
from edhas_jax.diagnosis.report.parameter_figure import draw_parameter_shifts
from edhas_jax.diagnosis.report.residual_stages import draw_waterfall
from edhas_jax.diagnosis.report.sensor_fault import estimate_sensor_error
from edhas_jax.diagnosis.report.sensor_fault_figure import draw_sensor_fault
from edhas_jax.diagnosis.report.trace_viewer import render_trace_viewer
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.conclusions import bench_rows, conclusions, fit_of_parameters, model_with, outcome
from edhas_jax.diagnosis.search.curve_candidate import CurveCandidate, fitted_curve
from edhas_jax.diagnosis.search.law_deviation import deviation_of
from edhas_jax.diagnosis.search.memory_term import MemoryTerm
from edhas_jax.diagnosis.search.outcome import evidence_text
from edhas_jax.diagnosis.search.result import Diagnosis, Verdict
from edhas_jax.measurements.campaign import Use, count_runs
from edhas_jax.measurements.checks.data_summary import data_sentences

MAX_LISTED_CANDIDATES = 14
MIN_SHOWN_PROBABILITY = 5e-4  # smaller ones are shown as 0
CURVE_NOTE = "The curve assumes no formula: it is fitted to the runs together with all other unknowns."
DIFFERENT_LAW = 12.0  # nats of log-evidence for a deviation from the library's law that chance does not give
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
            f"{campaign.machine.name}; {count_runs(campaign.runs_for(Use.FIT))} runs fitted, "
            f"{len(campaign.runs_for(Use.HOLDOUT))} held out; {len(diagnosis.ranked_candidates())} candidates; "
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
    probabilities = {} if diagnosis.verdict is Verdict.ADEQUATE else diagnosis.location_probabilities()
    schematic = draw_schematic(campaign.machine, probabilities, tuple(campaign.channels))
    return [html_page.heading("Location"), schematic]


def _waterfall_section(diagnosis: Diagnosis) -> list[str]:
    """The residual after each stage."""
    caption = "residual over noise from the present model down to the noise"
    return [html_page.heading("Residual after each stage"), html_page.image(draw_waterfall(diagnosis), caption)]


def _signals_section(diagnosis: Diagnosis) -> list[str]:
    """The interactive plot of measured and simulated signals."""
    states = {"before": diagnosis.before, "calibrated": diagnosis.calibrated.residuals}
    if diagnosis.accepted:
        states["after"] = diagnosis.after.residuals
    if (best := diagnosis.best_free_trial) is not None:
        states["free term"] = best.evaluated.residuals
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


def explaining_candidates(diagnosis: Diagnosis) -> list[tuple[Fit, Candidate]]:
    """The accepted candidates, or for an unknown effect the best free term, each with the fit that contains it."""
    if (best := diagnosis.best_free_trial) is not None:
        return [(best.evaluated.fit, best.candidate)]
    return [(diagnosis.final, trial.candidate) for trial in diagnosis.accepted]


def _term_sections(diagnosis: Diagnosis) -> list[str]:
    """For each explaining candidate, the missing term over its variable or the error of its sensor."""
    out = []
    for fitted, candidate in explaining_candidates(diagnosis):
        if candidate.signal is not None:
            figure = draw_sensor_fault(estimate_sensor_error(fitted, candidate))
            out += [
                html_page.heading(f"Sensor fault: {candidate.name}"),
                html_page.image(figure, f"{candidate.name}: error of the sensor"),
            ]
        elif (curve := _law_curve(diagnosis, fitted, candidate)) is not None:
            title = f"{curve.place.slot.replace('_', ' ')} over {curve.place.variable.replace('_', ' ')}"
            sentence = "" if curve.law_values is None else f" {law_sentence(curve)}"
            out += [
                html_page.heading(f"Missing term: {title}"),
                html_page.paragraph(f"{CURVE_NOTE}{sentence}"),
                html_page.image(draw_law_curve(curve, candidate.name), f"{candidate.name}: {title}"),
            ]
    return out


def _law_curve(diagnosis: Diagnosis, fitted: Fit, candidate: Candidate) -> LawCurve | None:
    """The law of an accepted effect, or a free curve, as an estimated curve; None where it has no variable."""
    if isinstance(candidate, CurveCandidate):
        return fitted_curve(fitted, candidate)
    if isinstance(candidate, MemoryTerm):
        return None
    deviation, alone = deviation_of(candidate, diagnosis.laws), None
    if deviation is not None:
        alone = fit_of_parameters(diagnosis, next(t for t in diagnosis.accepted if t.candidate == candidate))
    found = estimate_law_curve(fitted, candidate.id, deviation=None if deviation is None else deviation.id, alone=alone)
    return None if found is None else found.curve


def law_sentence(curve: LawCurve) -> str:
    """How the law of the library and the estimated curve agree, as a sentence."""
    share = 100.0 * curve.explained_share
    explained = "nearly all" if share >= 99.95 else f"{share:.1f} %"
    if curve.log_evidence_gain < DIFFERENT_LAW:
        return f"The law of the library explains {explained} of it, and the runs need no other."
    return (
        f"The law of the library explains {explained} of it at its best size, but the runs are precise enough to show "
        f"that the law is another one (evidence: {evidence_text(curve.log_evidence_gain)})."
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
    rows = bench_rows(diagnosis)
    if not rows:
        return []
    header = "what", "run", "deviation", "accuracy of the bench"
    return [html_page.heading("What the bench did"), html_page.table(header, rows)]


def _candidate_table(diagnosis: Diagnosis) -> str:
    """The candidates that were accepted or tried, and the most promising others, as an HTML table."""
    accepted = {t.candidate for t in diagnosis.accepted}
    groups = {c: k for k, group in enumerate(diagnosis.confounded_groups(), 1) for c in group}
    ranked = diagnosis.ranked_candidates()
    probability, trials = {c: p for c, p, _ in ranked}, {c: trial for c, _, trial in ranked if trial is not None}
    falls = {s.candidate: s.chi_square_fall for r in reversed(diagnosis.rounds) for s in r.scores}
    # without a trial, candidates differ more in their predicted fall than in their probability
    order = {c: (c not in accepted, c not in trials, -p if c in trials else -falls[c]) for c, p in probability.items()}
    body, quiet = [], []
    for candidate in sorted(probability, key=order.__getitem__)[:MAX_LISTED_CANDIDATES]:
        p, trial = probability[candidate], trials.get(candidate)
        fitted = None if trial is None else model_with(diagnosis, trial)
        sized = None if trial is None else fit_of_parameters(diagnosis, trial)
        remarks = [candidate.location.replace("_", " ")]
        remarks += [] if sized is None else parameter_texts(candidate, sized)
        remarks += [] if trial is None else [outcome(diagnosis, candidate).value]
        remarks += [f"group {groups[candidate]}"] if candidate in groups else []
        rms = math.nan if fitted is None else fitted.rms_over_noise(Use.HOLDOUT)
        quiet.append(trial is None or outcome(diagnosis, candidate).is_quiet)
        has_gain = trial is not None and math.isfinite(trial.log_evidence_gain)
        body.append([
            candidate.name,
            f"{p:.3f}" if p >= MIN_SHOWN_PROBABILITY else "0",
            f"{falls[candidate]:.3g}" if candidate in falls else "",
            evidence_text(trial.log_evidence_gain) if has_gain else "",
            f"{rms:.3f}" if math.isfinite(rms) else "",
            "; ".join(remarks),
        ])  # fmt: skip
    header = (
        "candidate", "probability", "predicted fall of χ²", "evidence", "residual/noise on held-out runs",
        "location and parameters",
    )  # fmt: skip
    return html_page.table(header, body, quiet)


def parameter_texts(candidate: Candidate, fitted: Fit) -> list[str]:
    """The parameters of a candidate in a fit as text, with standard errors and units."""
    own, machine = candidate.own_unknowns(fitted.problem.unknowns), fitted.problem.machine
    return [
        f"{name.replace('_', ' ')} {fitted.text(u.name, candidate.unit(u, machine))}"
        for name, u in own.items()
    ]
