"""What the true laws explain in the cases of the benchmark, and which of several effects stand out."""

import dataclasses

import numpy as np
import pytest

from studies.hidden_effects import limits
from studies.hidden_effects.answers import HiddenEffect, Law, Truth
from studies.hidden_effects.generators.drawing import draw
from studies.hidden_effects.generators.hidden_case import CaseKey, HiddenCase, Split
from studies.hidden_effects.limits import limit_of
from studies.hidden_effects.store import Limit, ResultFolder

COGGING = HiddenEffect("cogging_force", ("mover",), Law.LIBRARY, {}, 1000.0)
LIMIT = Limit(gain=500.0, left=0.0, strength=40.0, each=(40.0, float("nan")))


def test_true_laws_explain_what_is_visible():
    """A small campaign of the actuator without any disturbance: the law explains half its visible χ² in nats."""
    case = draw(CaseKey("f", Split.VARIED, 2))
    found = limit_of(case)
    samples = sum(len(run.time) * len(case.campaign.channels) for run in case.campaign.runs)
    assert 0.5 * case.truth.visible / 2.0 < found.gain < 1.5 * case.truth.visible / 2.0
    assert found.left < 0.02 * samples and found.each == (found.strength,)


def test_each_of_several_effects_has_a_strength_beside_the_others():
    """Each effect improves the fit of a model that has the other one, the effect of larger visible size more."""
    case = draw(CaseKey("g", Split.VARIED, 11))
    found = limit_of(case)
    visible = [hidden.visible for hidden in case.truth.hidden]
    assert len(found.each) == len(case.truth.hidden) > 1
    assert np.argmax(found.each) == np.argmax(visible)
    assert min(found.each) > 0.0
    assert max(found.each) <= found.strength + 0.1


def test_stored_limits_are_not_computed_again_and_say_nothing_of_what_is_hidden(monkeypatch, tmp_path, capsys):
    """Four cases: one as it was answered, one not drawn yet, one that has changed, and one without an effect."""
    results, computed = ResultFolder(tmp_path), []
    truths = {n: Truth("b", "varied", n, () if n == 3 else (COGGING,)) for n in range(4)}
    for number in (0, 2, 3):
        results.store_truth(CaseKey("b", Split.VARIED, number), truths[number])

    def drawn(key, first=0):
        changed = dataclasses.replace(COGGING, visible=2000.0)
        truth = dataclasses.replace(truths[2], hidden=(changed,)) if key.number == 2 else truths[key.number]
        return HiddenCase(truth, None, ())

    def limit(case):
        computed.append(case.truth.number)
        return LIMIT

    monkeypatch.setattr(limits, "draw", drawn)
    monkeypatch.setattr(limits, "limit_of", limit)
    for _ in range(2):
        assert limits.main(["--out", str(tmp_path), "--workers", "1", "--families", "b", "--cases", "4"]) == 0
    assert computed == [0, 1]
    printed = capsys.readouterr().out
    assert printed.count("left out, as the generators have changed") == 2 and "cogging" not in printed
    assert printed.strip().splitlines()[-1] == "cases=4 fitted=2 stand_out=0"
    (record,) = results.records([CaseKey("b", Split.VARIED, 0)], ())
    assert record.limit.each == pytest.approx(LIMIT.each, nan_ok=True)


@pytest.mark.parametrize(("each", "all_stand_out"), [((3.1, 9.0), True), ((3.1, 2.9), False), ((float("nan"),), False)])
def test_an_effect_stands_out_that_explains_three_times_what_is_left(each, all_stand_out):
    assert dataclasses.replace(LIMIT, each=each).all_stand_out is all_stand_out
