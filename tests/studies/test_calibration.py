"""Constants of the probabilities from cases with known truth."""

import dataclasses

import numpy as np
import pytest

from edhas_jax.diagnosis.search.answer import CONSTANTS, Evidence, Rivals
from studies.hidden_effects.answers import HiddenEffect, Law, Truth
from studies.hidden_effects.calibration import (
    Case,
    answered_with,
    best_constants,
    best_coverage,
    evidence_from,
    loss,
    right_probability,
)
from studies.hidden_effects.rates import rate, set_is_right

COGGING = HiddenEffect("cogging_force", ("mover",), Law.LIBRARY, {}, 500.0)


def drawn_cases(count: int, seed: int) -> list[Case]:
    """Cases in which the accepted candidate is right with a probability of logit −3 + 1.5 ln(strength)."""
    rng, cases = np.random.default_rng(seed), []
    for number in range(count):
        strength = float(np.exp(rng.uniform(-1.0, 5.0)))
        is_right = rng.uniform() < 1.0 / (1.0 + np.exp(3.0 - 1.5 * np.log(strength)))
        member = Rivals("cogging_force", strength, {"cogging_force": 900.0, "seal_friction": 20.0}, 10.0)
        truth = Truth("b", "tuning", number, (COGGING,) if is_right else ())
        cases.append(Case(truth, Evidence((member,), 0.1, 0.0)))
    return cases


def test_constants_follow_the_cases():
    seen, unseen = drawn_cases(150, 1), drawn_cases(400, 2)
    found = best_constants(seen)
    assert loss(seen, found) < loss(seen, CONSTANTS)
    assert loss(unseen, found) < loss(unseen, CONSTANTS)


def test_sets_hold_the_truth_of_unseen_cases():
    seen, unseen = drawn_cases(500, 3), drawn_cases(500, 4)  # shares then scatter by 0.01
    found = best_constants(seen)
    coverage = best_coverage([(case, found) for case in seen])
    held = rate([answered_with(c, dataclasses.replace(found, coverage=coverage)) for c in unseen], set_is_right)
    assert held.share > 0.92


def test_evidence_is_read_back():
    case = drawn_cases(1, 5)[0]
    assert evidence_from(dataclasses.asdict(case.evidence)) == case.evidence


def test_the_probability_of_what_is_right():
    strong = Rivals("cogging_force", 1e9, {"cogging_force": 900.0}, 0.0)
    null, named = Truth("b", "tuning", 1), Truth("b", "tuning", 2, (COGGING,))
    withheld = dataclasses.replace(named, withheld=True)
    evidence = Evidence((strong,), 0.1, 0.0)
    p = [right_probability(Case(truth, evidence), CONSTANTS) for truth in (named, null, withheld)]
    assert p[0] == pytest.approx(CONSTANTS.max_real) and p[1] + p[2] == pytest.approx(1.0 - CONSTANTS.max_real)
