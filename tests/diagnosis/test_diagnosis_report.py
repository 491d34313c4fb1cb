"""The report of a diagnosis: what it says is what was found, and it needs nothing beside it."""

import base64
import dataclasses
import json
import math
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from edhas_jax.core import structs
from edhas_jax.core.summary import SummaryTable, Tone, Toned, plain
from edhas_jax.core.units import format_quantity, format_with_error
from edhas_jax.diagnosis.candidates.candidate import Candidate, with_candidates
from edhas_jax.diagnosis.candidates.free_curve import CurveCandidate
from edhas_jax.diagnosis.report.conclusions import Outcome, conclusions, evidence_text, outcome
from edhas_jax.diagnosis.report.machine_schematic import draw_schematic, probability_colour
from edhas_jax.diagnosis.report.overview_figure import draw_overview
from edhas_jax.diagnosis.report.report import diagnosis_report, law_curve, law_sentence, write_report
from edhas_jax.diagnosis.report.residual_stages import draw_waterfall, residual_stages
from edhas_jax.diagnosis.report.result_file import as_json
from edhas_jax.diagnosis.report.sensor_fault import draw_sensor_fault, estimate_sensor_error
from edhas_jax.diagnosis.search.diagnose import diagnose
from edhas_jax.diagnosis.search.member_laws import LAW_GAIN
from edhas_jax.diagnosis.search.posterior import SetPosterior
from edhas_jax.diagnosis.search.result import Verdict
from edhas_jax.inference.fit.evaluated_fit import fit_coarse
from edhas_jax.inference.fit.fit_problem import calibration_problem
from edhas_jax.inference.fit.unpredictable_part import with_unpredictable_part
from edhas_jax.machine.effects import ConstantBiasForce, ForceConstantDroop, InverterDeadTime
from edhas_jax.machine.effects.tabulated_law import LawPlace, tabulated_class
from edhas_jax.machine.rigs import RIGS
from edhas_jax.measurements.campaign import Use
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.residuals import rms_over_noise
from edhas_jax.measurements.sensor_models import SensorLag
from edhas_jax.tasks.diagnose import DiagnosisResult
from edhas_jax.tasks.result import with_methods
from tests.diagnosis.test_diagnose import SoftDeadTime, diagnosed
from tests.support.synthetic_campaign import bench, empty_campaign, measured

LOST = 0.8  # V
VOID = {"meta", "img", "br"}


@pytest.fixture(scope="module")
def diagnosis():
    """A bench whose inverter has a dead time of which the model knows nothing."""
    truth = structs.replace(bench(), effects=(*bench().effects, InverterDeadTime(dead_time_voltage=LOST)))
    campaign = measured(empty_campaign(), truth)
    return diagnose(campaign, library=(InverterDeadTime, ConstantBiasForce, ForceConstantDroop))


@pytest.fixture(scope="module")
def report(diagnosis, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(diagnosis, path)
    return path.read_text(encoding="utf-8")


class Balanced(HTMLParser):
    def __init__(self):
        super().__init__()
        self.open, self.texts = [], []

    def handle_starttag(self, tag, attrs):
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


def test_the_report_is_one_sound_file(diagnosis, report):
    parser = Balanced()
    parser.feed(report)
    assert parser.open == []
    assert not re.search(r"""(?:src|href)=(?!["']?data:)|https?://""", report)
    assert conclusions(diagnosis)[0] in parser.texts
    assert "inverter_dead_time" in conclusions(diagnosis)[0] and diagnosis.verdict is Verdict.MISSING_EFFECT


def test_what_the_model_cannot_predict_is_said(diagnosis):
    """The report states the part that counts as noise, unless it is far below the noise of the sensor."""
    noise = diagnosis.campaign.channels["current"].noise
    for share, count in ((0.3, 1), (0.001, 0)):
        campaign = with_unpredictable_part(diagnosis.campaign, {"current": share * noise})
        said = [s for s in conclusions(dataclasses.replace(diagnosis, campaign=campaign)) if "counts as noise" in s]
        assert len(said) == count
        assert not said or f"{format_quantity(share * noise, 'A')} of current (rms)" in said[0]


def test_the_traces_are_those_measured_and_those_of_the_models(diagnosis, report):
    data = json.loads(re.search(r'id="traces-data">(.*?)</script>', report, re.DOTALL)[1])
    assert [m["name"] for m in data["models"]] == ["before", "calibrated", "after"]
    run = diagnosis.campaign.runs[1]
    shown = data["runs"][1]
    assert shown["count"] == len(run.time)
    noise = diagnosis.campaign.channels["current"].noise
    after = run.signals["current"] - noise * diagnosis.after.residuals[run.name]["current"]
    for name, expected in (("measured", run.signals["current"]), ("after", after)):
        packed = shown["signals"]["current"][name]
        values = np.frombuffer(base64.b64decode(packed["data"]), "<i2") * packed["scale"] + packed["offset"]
        assert np.abs(values - expected).max() <= 0.51 * packed["scale"]
    assert diagnosis.campaign.runs[data["run"]].use is Use.HOLDOUT


def test_the_missing_term_is_found_without_its_law(diagnosis, report):
    (candidate,) = diagnosis.named
    curve = law_curve(diagnosis, candidate)
    assert (curve.place.slot, curve.place.variable) == ("coil_voltage_change", "current")
    truth = -LOST * np.tanh(curve.nodes / 0.05)
    assert len(curve.nodes) > 6 and (np.abs(curve.total - truth) < 4.0 * curve.std + 0.02 * LOST).all()
    assert np.median(curve.std) < 0.1 * LOST and curve.explained_share > 0.99
    (law,) = diagnosis.laws
    assert "Missing term: coil voltage change over current" in report and law_sentence(curve, law) in report
    assert law_sentence(curve, law).endswith("need no other.")
    assert "that the law is another one (evidence: " in law_sentence(curve, law._replace(gain=LAW_GAIN + 1.0))


def test_the_waterfall_ends_at_the_noise(diagnosis):
    table = residual_stages(diagnosis)
    assert list(table) == ["present model", "calibrated", "+ inverter_dead_time"]
    before = [v for run in diagnosis.campaign.runs_for(Use.HOLDOUT) for v in diagnosis.before[run.name].values()]
    assert table["present model"][Use.HOLDOUT] == pytest.approx(rms_over_noise(before))
    held_out = [row[Use.HOLDOUT] for row in table.values()]
    assert held_out[0] > held_out[1] > held_out[2] and held_out[2] < 1.1
    assert len(draw_waterfall(diagnosis).axes) == 2
    assert len(draw_overview(diagnosis).axes) == 5


def test_a_sensor_fault_is_shown_as_it_was_measured():
    instruments = Instruments({"current": (SensorLag(lag_time=2e-3),)})
    campaign = measured(empty_campaign(), bench(), instruments)
    candidate = Candidate(SensorLag, "current")
    problem = with_candidates(calibration_problem(campaign), [candidate])
    fault = estimate_sensor_error(fit_coarse(problem, np.zeros(len(problem.unknowns)), 8, 12).fit, candidate)
    assert fault.over_rate and np.abs(fault.measured).max() > 20.0 * fault.std.max()
    assert (np.abs(fault.measured - fault.modelled) < 5.0 * fault.std).all()
    assert draw_sensor_fault(fault).axes


@pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS)
def test_the_schematic_colours_every_part_that_can_be_at_fault(rig):
    where = {slot.location for slot in rig.slots} | {"sensor"}
    for part in where:
        drawn = draw_schematic(rig(), {part: 0.9})
        assert probability_colour(0.9) in drawn and "90%" in drawn
    assert probability_colour(0.9) not in draw_schematic(rig(), {})
    red = [int(probability_colour(p)[3:5], 16) for p in (0.0, 0.1, 0.5, 1.0)]
    assert red == sorted(red, reverse=True) and len(set(red)) == 4


def test_a_value_and_its_error_share_a_unit():
    assert format_with_error(0.8002, 3.8e-4, "V") == "0.80020 ± 0.00038 V"
    assert format_with_error(1.441, 1.7e-4, "ohm") == "1.44100 ± 0.00017 ohm"
    assert format_with_error(4.0e-8, 1.6e-10, "m^2") == "0.04000 ± 0.00016 mm²"
    assert format_with_error(8.855e-9, 1.2e-10, "m^2") == "0.00886 ± 0.00012 mm²"


def test_value_and_error_end_at_the_same_place_with_two_digits_of_the_error():
    assert format_with_error(0.7993, 5.0e-4, "V") == "0.79930 ± 0.00050 V"
    assert format_with_error(12345.0, 123.0, "-") == "12340 ± 120"
    assert format_with_error(5e-6, 2e-7, "m") == "5.00 ± 0.20 µm"
    assert format_with_error(2.0, 0.0, "V") == "2.0000 ± 0 V"


@pytest.mark.parametrize(
    ("gain", "text"),
    [(1322034.0, "overwhelming (1.3·10⁶ nats)"), (34.2, "strong (34 nats)"), (5.6, "clear (5.6 nats)"),
     (1.2, "weak (1.2 nats)"), (0.2, "none"), (-20.0, "against it (−20 nats)"), (math.nan, "none")],
)  # fmt: skip
def test_evidence_is_said_in_words(gain, text):
    assert evidence_text(gain) == text


def with_rival(diagnosis):
    """The diagnosis, if another effect could take the place of the dead time, and that effect."""
    best, *others = diagnosis.posterior.sets
    rival = Candidate(ConstantBiasForce)
    near = dataclasses.replace(best, members=(rival,), log_weight=best.log_weight - 1.0)
    return dataclasses.replace(diagnosis, posterior=SetPosterior((best, near, *others))), rival


def test_an_effect_that_could_take_the_place_of_another_has_its_own_word_everywhere(diagnosis):
    """One verdict for sentences, JSON, report, command and Python."""
    found, rival = with_rival(diagnosis)
    (named,) = found.named
    assert found.verdict is Verdict.AMBIGUOUS and found.confounded_groups() == [[named, rival]]
    assert outcome(found, named) is Outcome.MISSING and outcome(found, rival) is Outcome.POSSIBLE
    weights = found.posterior.weights
    assert weights[0] / weights[1] == pytest.approx(np.e)
    assert found.posterior.evidence(named) == pytest.approx(1.0) == -found.posterior.evidence(rival)
    sentences, data = conclusions(found), as_json(found)
    assert named.name in sentences[0] and rival.name not in sentences[0]
    assert f"These runs cannot distinguish {named.name} and {rival.name}." in sentences
    assert data["conclusions"] == sentences and data["effects"] == [named.id]
    assert data["groups"] == [[named.id, rival.id]] and data["answer"]["set"] == [named.name, rival.name]
    assert [row["members"] for row in data["sets"][:2]] == [[named.name], [rival.name]]
    words = {" on ".join(filter(None, (c["effect"], c.get("signal")))): c["outcome"] for c in data["candidates"]}
    assert (words[named.name], words[rival.name]) == ("missing", "possibly missing")
    tables = [part for part in with_methods(DiagnosisResult, found).summary().parts if isinstance(part, SummaryTable)]
    rows = {plain(row[0]): row for table in tables if table.name == "candidates" for row in table.rows}
    assert rows[named.name][1] == "missing" and rows[rival.name][1] == "possibly missing"
    assert all(row[1] == Toned("tried", Tone.QUIET) for name, row in rows.items() if words[name] == "tried")
    html = diagnosis_report(found, pictures=False)
    assert re.search(rf"<tr><td>{rival.name}</td>[^\n]*?; possibly missing; group 1", html)
    assert re.search(rf"<tr><td>{named.name}</td>[^\n]*?; missing", html)


def test_a_doubtful_member_of_the_best_set_is_called_so(diagnosis):
    best, *others = diagnosis.posterior.sets
    (named,) = best.members
    nothing = next(of for of in others if not of.members)
    near = dataclasses.replace(nothing, log_weight=best.log_weight - 0.1)
    third = dataclasses.replace(near, members=(Candidate(SensorLag, "current"),))
    found = dataclasses.replace(diagnosis, posterior=SetPosterior((best, near, third)))
    doubt = f"{named.name} improves the model, but its probability is only"
    assert any(sentence.startswith(doubt) for sentence in conclusions(found))
    assert not any("improves the model" in sentence for sentence in conclusions(diagnosis))


def test_the_size_of_an_effect_with_another_law_is_that_of_the_library_law_alone():
    """The measurements determine the sum of law and curve; the part of the law in this sum is no size."""
    found = diagnosed(SoftDeadTime(), seed=5)
    (named,), (deviation,) = found.named, found.curves
    name = "inverter_dead_time.dead_time_voltage"
    alone = found.fit_of_parameters(named)
    assert [effect.id for effect in alone.machine.effects] == ["lugre_friction", "inverter_dead_time"]
    said = conclusions(found)
    assert f"dead_time_voltage {alone.text(name)}" in said[0]
    assert said[1].endswith("inverter_dead_time are those of a fit with the library's law alone.")
    assert found.after.bench.has_deviations
    assert sum(s.endswith("`edhas compare --model` shows both.") for s in said) == 1
    curve = law_curve(found, named)
    assert deviation.of == "inverter_dead_time"
    assert np.abs(curve.law_values).max() == pytest.approx(alone.values[name], rel=1e-3)


def leaving(diagnosis, share):
    """The diagnosis, if its final model left so much of the residuals of the calibrated one, the more the later."""
    calibrated = diagnosis.calibrated.residuals
    rows = {run: {n: share * v for n, v in signals.items()} for run, signals in calibrated.items()}
    return dataclasses.replace(diagnosis, after=dataclasses.replace(diagnosis.after, residuals=rows))


def test_an_answer_that_leaves_most_is_no_answer(diagnosis):
    before = diagnosis.errors()["calibrated"]["holdout"]
    assert before["overall"] > 5.0
    little, half = leaving(diagnosis, 0.8), leaving(diagnosis, 0.45)
    said = conclusions(little)
    assert said[0].startswith("The cause was not found: inverter_dead_time (dead_time_voltage 0.8")
    worst = max((n for n in before if n != "overall"), key=before.__getitem__).replace("_", " ")
    amount = f"{0.8 * before['overall']:.3g} of {before['overall']:.3g} times the noise is left"
    assert said[1] == f"{amount}, most of it in {worst} (first of all in run3)."
    data = as_json(little)
    assert data["explains_little"] and data["left"] == said[1]
    title = with_methods(DiagnosisResult, little).summary().title
    assert title.startswith("synthetic: missing effect, most is left")
    said = conclusions(half)
    assert said[0].endswith("is missing.") and "times the noise is left" in said[1]
    assert not as_json(half)["explains_little"]


def test_an_answer_that_leaves_the_noise_says_nothing_of_it(diagnosis):
    assert not any("is left" in sentence for sentence in conclusions(diagnosis))
    data = as_json(diagnosis)
    assert data["left"] is None and data["explains_little"] is False


@pytest.mark.parametrize(
    ("values", "is_law"), [((-9.7, 0.6, -16.5, 6.1, 16.9, -7.7), False), ((0.0, 1.0, 2.0, 3.0, 4.0, 6.0), True)]
)
def test_a_curve_that_is_not_smooth_is_not_offered_as_a_law(diagnosis, values, is_law):
    nodes = tuple(np.linspace(-0.3, 0.3, len(values)))
    place = LawPlace("mover_force", "piston_velocity")
    curve = CurveCandidate(tabulated_class("curve", place, len(nodes)), None, place, 50.0, nodes)
    problem = with_candidates(calibration_problem(diagnosis.campaign), [curve])
    start = np.zeros(len(problem.unknowns))
    start[-len(values) :] = curve.nearest(np.array(values) / 50.0)
    evaluated = fit_coarse(problem, start, 8, 0)
    nothing = next(of for of in diagnosis.posterior.sets if not of.members)
    with_curve = dataclasses.replace(nothing, members=(curve,), evaluated=evaluated, log_weight=0.0)
    unknown = dataclasses.replace(diagnosis, posterior=SetPosterior((with_curve, nothing)), after=evaluated, laws=())
    assert unknown.verdict is Verdict.UNKNOWN_EFFECT and unknown.first == "unknown"
    said = conclusions(unknown)
    assert said[0].endswith("most likely it acts on mover.")
    assert said[1] == "What explains most of it is a curve over piston velocity as mover force."
    assert said[2].startswith("This curve is no law of one cause: it is not smooth") is not is_law


def test_where_no_curve_explains_what_is_left_the_records_may_be_wrong(diagnosis):
    nothing = next(of for of in diagnosis.posterior.sets if not of.members)
    alone = SetPosterior((dataclasses.replace(nothing, excess=10.0 * nothing.samples, log_weight=0.0),))
    found = dataclasses.replace(diagnosis, posterior=alone, after=nothing.evaluated, laws=())
    assert found.verdict is Verdict.UNKNOWN_EFFECT
    sentences = conclusions(found)
    assert sentences[0].startswith("Neither an effect of the library nor a curve explains what is left")
    assert "Not ruled out, with their probabilities: unknown 0.45, nothing 0.45." in sentences
