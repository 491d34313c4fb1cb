"""The numbers of the weight are judged by the probability that they give to right answers."""

import json
import math

import pytest

from edhas_jax.diagnosis.search.posterior import NOT_FITTED
from edhas_jax.diagnosis.search.weight import WEIGHT, log_likelihood
from studies.hidden_effects import weights
from studies.hidden_effects.answers import HiddenEffect, Law, Truth
from studies.hidden_effects.generators.hidden_case import CaseKey, Split

DRAG = HiddenEffect("eddy_drag", ("mover",), Law.LIBRARY, {}, 1e3)


def truth(*hidden, withheld=False, disturbed=()):
    return Truth("b", "varied", 0, hidden, withheld, disturbed)


def case(*misfits):
    """Nothing, and the right set; ½χ² of noise alone would be 500."""
    rows = [{"members": [], "free": 0, "right": False}, {"members": ["eddy_drag"], "free": 0, "right": True}]
    common = {"numbers": 50.0, "fall_by_laws": math.inf}
    rows = [row | common | {"misfit": misfit} for row, misfit in zip(rows, misfits, strict=True)]
    return {"named": 40, "free": 40, "samples": 1000, "sets": rows}


def test_the_right_answer_names_what_is_hidden_and_nothing_else():
    drag, lag, free = ("eddy_drag", None, False), ("sensor_lag on current", "current", False), ("a curve", None, True)
    assert weights.is_right([drag], truth(DRAG)) and not weights.is_right([], truth(DRAG))
    assert not weights.is_right([drag, lag], truth(DRAG))
    assert weights.is_right([drag, lag], truth(DRAG, disturbed=("current",)))
    assert not weights.is_right([drag, free], truth(DRAG))
    withheld = truth(DRAG, withheld=True)
    assert weights.is_right([free], withheld) and not weights.is_right([drag], withheld)
    assert weights.is_right([], truth())


def test_a_score_is_the_log_probability_of_the_right_answer():
    clear, near = case(9e3, 550.0), case(580.0, 550.0)
    assert weights.score(clear, WEIGHT) == pytest.approx(math.log(1.0 - NOT_FITTED), abs=1e-2)
    least = 550.0 - WEIGHT.least_error
    gain = log_likelihood(550.0 - least, 1000) - log_likelihood(580.0 - least, 1000)
    odds = WEIGHT.expected / 40 * math.exp(gain)
    assert weights.score(near, WEIGHT) == pytest.approx(math.log((1.0 - NOT_FITTED) * odds / (1.0 + odds)))


def test_an_effect_that_adds_next_to_nothing_is_no_answer():
    assert weights.score(case(551.0, 550.0), WEIGHT) == math.log(weights.LEAST_PROBABILITY)


def test_the_numbers_follow_the_cases():
    """Where effects that explain little are hidden in many campaigns, more are expected."""
    best = weights.best_constants([case(565.0, 550.0)] * 5)
    assert best.expected > 2.0 * WEIGHT.expected or best.least_error < WEIGHT.least_error
    assert weights.mean_score([case(565.0, 550.0)], best) > weights.mean_score([case(565.0, 550.0)], WEIGHT)


def test_finished_cases_are_not_run_again(tmp_path, capsys):
    for number, misfits in enumerate([(9e3, 550.0), (565.0, 550.0)]):
        file = tmp_path / "varied" / f"{CaseKey('b', Split.VARIED, number)}.json"
        file.parent.mkdir(exist_ok=True)
        file.write_text(json.dumps(case(*misfits)))
    assert weights.main(["--families", "b", "--cases", "2", "--out", str(tmp_path)]) == 0
    last = dict(word.split("=") for word in capsys.readouterr().out.strip().splitlines()[-1].split())
    assert last["cases"] == "2" and float(last["score_best"]) > float(last["score"])
