"""What the true laws explain in the cases of the benchmark, and why a first name is wrong."""

import dataclasses

import numpy as np
import pytest

from studies.hidden_effects import limits
from studies.hidden_effects.answers import Answer, HiddenEffect, Law, Truth, Verdict
from studies.hidden_effects.drawing import CaseKey, DrawnCase, draw
from studies.hidden_effects.generators.hidden_case import Split
from studies.hidden_effects.limits import Cause, Limit, cause_of, each_table, limit_of, strength_table
from studies.hidden_effects.store import ResultFolder, write_json

SAMPLES = 1000
EXPLAINS_ALL = Limit(gain=500.0, left=0.0, without=480.0, strength=40.0, samples=SAMPLES)
COGGING = HiddenEffect("cogging_force", ("mover",), Law.LIBRARY, {}, 1000.0)


def answer(name="", left=None, misfit=0.0):
    """An answer that names one effect, with which ½χ² is too large by `left`, or that nothing is missing."""
    members = [{"name": name, "left": left}] if name else []
    verdict = Verdict.MISSING_EFFECT if name else Verdict.ADEQUATE
    return Answer(verdict, (name,) if name else (), probability=0.8, evidence={"members": members, "misfit": misfit})


def truth(number=0):
    return Truth("b", "varied", number, (COGGING,))


@pytest.mark.parametrize(
    ("limit", "given", "cause"),
    [
        (dataclasses.replace(EXPLAINS_ALL, strength=0.5), answer("backlash", 400.0), Cause.WEAK),
        (EXPLAINS_ALL, answer("backlash", 400.0), Cause.FIT),
        (EXPLAINS_ALL, answer("backlash", 10.0), Cause.CONFUSED),
        (EXPLAINS_ALL, answer(misfit=0.96), Cause.FIT),
        (dataclasses.replace(EXPLAINS_ALL, left=300.0), answer(misfit=0.96), Cause.CONFUSED),
    ],
)
def test_causes_of_wrong_names(limit, given, cause):
    assert cause_of(limit, given) is cause


def test_rates_over_the_strength():
    weak = dataclasses.replace(EXPLAINS_ALL, strength=-0.2)
    right, wrong = answer("cogging_force", 0.0), answer("backlash", 0.0)
    rows = strength_table([(truth(), right, EXPLAINS_ALL), (truth(), wrong, EXPLAINS_ALL), (truth(), wrong, weak)])
    assert rows[2].startswith("| 0 … 0.3 | 0 % (0/1;") and rows[-1].startswith("| 10 and more | 50 % (1/2;")


def test_true_laws_explain_what_is_visible():
    """A small campaign of the actuator without any disturbance: the law explains half its visible χ² in nats."""
    case = draw(CaseKey("f", Split.VARIED, 2))
    found = limit_of(case)
    assert 0.5 * case.truth.visible / 2.0 < found.gain < 1.5 * case.truth.visible / 2.0
    assert found.left < 0.02 * found.samples and found.without > found.left


@pytest.mark.parametrize(("split", "shown"), [(Split.EARLIER, True), (Split.JUDGING, False)])
def test_single_answers_to_judging_cases_are_not_shown(tmp_path, capsys, split, shown):
    results, key = ResultFolder(tmp_path), CaseKey("b", split, 0)
    results.store_truth(key, Truth("b", split.value, 0, (COGGING,)))
    results.store_answer(key, "ours", answer("backlash", 400.0))
    write_json(results.of(key) / limits.FILE, dataclasses.asdict(EXPLAINS_ALL))
    assert limits.main(["--out", str(tmp_path), "--split", split.value, "--workers", "1"]) == 0
    printed = capsys.readouterr().out
    assert printed.strip().splitlines()[-1] == "cases=1 right=0 weak=0 fit=1 confused=0"
    assert ("backlash" in printed) is shown


def test_stored_limits_are_not_computed_again(monkeypatch, tmp_path, capsys):
    results, computed = ResultFolder(tmp_path), []
    for number in range(3):
        key = CaseKey("b", Split.VARIED, number)
        results.store_truth(key, truth(number))
        results.store_answer(key, "ours", answer("cogging_force" if number else "backlash", 400.0))

    def drawn(key):
        changed = dataclasses.replace(COGGING, visible=2000.0)
        return DrawnCase(truth(key.number) if key.number < 2 else Truth("b", "varied", 2, (changed,)), None, ())

    def limit(case):
        computed.append(case.truth.number)
        return EXPLAINS_ALL

    monkeypatch.setattr(limits, "draw", drawn)
    monkeypatch.setattr(limits, "limit_of", limit)
    for _ in range(2):
        assert limits.main(["--out", str(tmp_path), "--workers", "1"]) == 0
    assert computed == [0, 1]
    printed = capsys.readouterr().out
    assert printed.count("left out, as the generators have changed") == 2
    assert "b00000: cogging_force" in printed and "backlash; strength 40.00, fit" in printed
    assert printed.strip().splitlines()[-1] == "cases=2 right=1 weak=0 fit=1 confused=0"
    assert limits.main(["--out", str(tmp_path), "--split", "tuning"]) == 1


def test_each_of_several_effects_has_a_strength_beside_the_others():
    """Each effect improves the fit of a model that has the other one, the effect of larger visible size more."""
    case = draw(CaseKey("g", Split.VARIED, 11))
    found = limit_of(case)
    visible = [hidden.visible for hidden in case.truth.hidden]
    assert len(found.each) == len(case.truth.hidden) > 1
    assert np.argmax(found.each) == np.argmax(visible)
    assert min(found.each) > 0.0
    assert max(found.each) <= found.strength + 0.1


def test_effects_named_over_the_strength_beside_the_others():
    two = dataclasses.replace(truth(), hidden=(COGGING, dataclasses.replace(COGGING, name="backlash")))
    limit = dataclasses.replace(EXPLAINS_ALL, each=(20.0, 0.4))
    rows = each_table([(two, answer("cogging_force", 0.0), limit), (two, answer("cogging_force", 0.0), limit)])
    assert rows[2].startswith("| 0.3 … 1 | 0 % (0/2;") and rows[-1].startswith("| 10 and more | 100 % (2/2;")
    unknown = dataclasses.replace(limit, each=(float("nan"), 0.4))
    assert each_table([(two, answer("cogging_force", 0.0), unknown)])[-1] == "| 0.3 … 1 | 0 % (0/1; 0 … 79) |"
