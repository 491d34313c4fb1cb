"""Rates and calibration error of the benchmark of hidden effects, from constructed answers."""

import dataclasses
import math

import numpy as np
import pytest

from studies.hidden_effects.answers import (
    Law,
    answer_as_json,
    answer_from_json,
    truth_as_json,
    truth_from_json,
)
from studies.hidden_effects.rates import (
    Answered,
    Rate,
    by_strength,
    by_visibility,
    mean_set_size,
    names_wrong_effect,
    rates,
    times,
)
from studies.hidden_effects.reliability import reliability
from studies.hidden_effects.store import Limit
from tests.support.constructed_answers import FAILED, UNKNOWN_AT_MOVER, answer, truth


def test_names_places_and_sets_of_single_effects():
    cases = [
        (truth("cogging_force"), answer("cogging_force", ranked=("eddy_drag", "backlash", "cogging_force"))),
        (truth("eddy_drag"), answer("parasitic_spring", answer_set=("parasitic_spring", "eddy_drag"))),
        (truth("hose_compliance"), answer("cogging_force", "hose_compliance", ranked=("cogging_force",))),
        (truth("hose_compliance"), FAILED),
    ]
    found = rates(cases)
    assert found["right name first"] == Rate(1, 4)
    assert found["truth in the set"] == Rate(2, 4)
    assert found["right place"] == Rate(2, 4)
    assert found["all hidden effects named, and no other"] == Rate(1, 4)
    assert found["a wrong effect named where one is hidden"] == Rate(3, 4)
    assert found["both of two hidden effects named"] == Rate(0, 0)
    assert found["a wrong effect named where nothing is hidden"] == Rate(0, 0)
    assert mean_set_size(cases) == pytest.approx(4.0 / 3.0)


def test_several_hidden_effects():
    two, three = truth("cogging_force", "eddy_drag"), truth("cogging_force", "eddy_drag", "supply_sag")
    cases = [
        (two, answer("eddy_drag", "cogging_force")),
        (two, answer("eddy_drag", "backlash")),
        (two, answer("backlash")),
        (three, answer("supply_sag", "eddy_drag", "cogging_force")),
        (three, answer("supply_sag", "eddy_drag")),
        (three, FAILED),
    ]
    found = rates(cases)
    assert found["both of two hidden effects named"] == Rate(1, 3)
    assert found["all three hidden effects named"] == Rate(1, 3)
    assert found["right name first"] == Rate(4, 6)


def test_several_effects_that_stand_out_are_told_from_the_rest():
    """Where what the true laws explain has been computed: all of them explain three times what is left, or not."""
    two = truth("cogging_force", "eddy_drag")
    both, one = answer("eddy_drag", "cogging_force"), answer("eddy_drag")
    clear, weak = Limit(500.0, 9.0, 20.0, (20.0, 3.5)), Limit(500.0, 9.0, 20.0, (20.0, 0.7))
    cases = [(two, both, clear), (two, one, clear), (two, one, weak), (two, both), (truth("backlash"), both, clear)]
    found = rates(cases)
    assert found["both of two hidden effects named"] == Rate(2, 4)
    assert found["both of two hidden effects named, which stand out"] == Rate(1, 2)
    assert found["both of two hidden effects named, the rest"] == Rate(0, 1)
    bands = by_strength([Answered(*case) for case in cases[:4]])
    assert {low: r for (low, _), r in bands.items() if r.of} == {0.3: Rate(1, 1), 3.0: Rate(2, 2), 10.0: Rate(1, 3)}


def test_nulls_with_disturbed_sensors():
    """A fault named at a sensor that has an unlisted one is not a wrong effect, but the verdict is not `adequate`."""
    disturbed = truth(disturbed_signals=("current",))
    cases = [
        (truth(), answer()),
        (disturbed, answer("sensor_lag on current")),
        (disturbed, answer("sensor_lag on voltage")),
        (truth(), UNKNOWN_AT_MOVER),
        (truth(), answer("eddy_drag")),
        (truth(), FAILED),
    ]
    found = rates(cases)
    assert found["a wrong effect named where nothing is hidden"] == Rate(3, 6)
    assert found["`adequate` where nothing is hidden"] == Rate(1, 6)
    assert found["truth in the set"] == Rate(1, 6)
    assert found["right name first"] == Rate(0, 0)
    assert not names_wrong_effect(truth("cogging_force", disturbed_signals=("current",)), answer("cogging_force"))


def test_withheld_effects():
    withheld = truth("cogging_force", withheld=True)
    elsewhere = dataclasses.replace(UNKNOWN_AT_MOVER, place="coil", answer_set=("unknown",))
    cases = [(withheld, UNKNOWN_AT_MOVER), (withheld, elsewhere), (withheld, answer("eddy_drag")), (withheld, answer())]
    found = rates(cases)
    assert found["effect withheld from the library reported as unknown"] == Rate(2, 4)
    assert found["right place stated for an effect reported as unknown"] == Rate(1, 2)
    assert found["right place stated for a withheld effect"] == Rate(2, 4)
    assert found["truth in the set"] == Rate(2, 4) and found["right name first"] == Rate(0, 0)


@pytest.mark.parametrize(
    ("hidden", "named", "right"),
    [
        ("suction_seat_leakage", "delivery_seat_leakage", True),
        ("sensor_lag on current", "sensor_delay on current", True),
        ("sensor_lag on current", "sensor_delay on voltage", False),
        ("sensor_lag on current", "sensor_gain on current", False),
        ("backlash", "coupling_compliance", False),
    ],
)
def test_names_that_count_as_the_same(hidden, named, right):
    found = rates([(truth(hidden), answer(named))])
    assert found["right name first"] == found["all hidden effects named, and no other"] == Rate(int(right), 1)
    assert found["right name first, to the letter"] == Rate(0, 1)
    assert found["a wrong effect named where one is hidden"] == Rate(int(not right), 1)


def test_laws_and_parameters_count_where_they_are_stated():
    differs = truth("cogging_force", law=Law.DIFFERS)
    cases = [
        (differs, answer("cogging_force", law={"cogging_force": Law.DIFFERS})),
        (differs, answer("cogging_force", law={"cogging_force": Law.LIBRARY})),
        (differs, answer("eddy_drag", law={"eddy_drag": Law.LIBRARY})),
        (differs, answer("cogging_force")),
    ]
    assert rates(cases)["right statement whether the law is that of the library"] == Rate(1, 2)
    sizes = [(2.19, 0.01), (2.3, 0.16), (2.3, 0.01)]
    cases = [
        (truth("eddy_drag"), answer("eddy_drag", parameters={"eddy_drag": {"size": size, "other": (1.0, 1.0)}}))
        for size in sizes
    ]
    assert rates(cases)["parameters right"] == Rate(2, 3)


def test_rates_by_visibility_are_those_of_single_effects():
    cases = [
        (truth("eddy_drag", visible=100.0), answer("eddy_drag")),
        (truth("eddy_drag", visible=199.0), answer()),
        (truth("eddy_drag", visible=1e4), answer("eddy_drag")),
        (truth("eddy_drag", "backlash", visible=100.0), answer("eddy_drag")),
        (truth("eddy_drag", visible=100.0, withheld=True), answer("backlash")),
        (truth(), answer()),
    ]
    found = {low: r for (low, _), r in by_visibility(cases).items() if r.of}
    assert found == {60.0: Rate(1, 2), 1e4: Rate(1, 1)}


def test_times():
    cases = [(truth(), answer(seconds=float(s))) for s in (4, 1, 3, 2, 5, 6, 7, 8, 9, 30)]
    found = times(cases)
    assert (found.median, found.most, found.worst) == (5.5, 30.0, 30.0)
    assert math.isnan(times([]).median)


def test_wilson_interval():
    """The two ends solve (p̂ − p)² = z² p (1 − p)/n."""
    low, high = Rate(45, 50).interval()
    for p in (low, high):
        assert (0.9 - p) ** 2 == pytest.approx(1.96**2 * p * (1.0 - p) / 50)
    assert low < 0.9 < high
    assert Rate(0, 50).interval()[0] == pytest.approx(0.0, abs=1e-12)
    assert Rate(0, 0).interval() == (0.0, 1.0)


def test_calibration_error_of_constructed_answers():
    """Two bins: 4 answers of 0.95 of which 3 are right, 6 of 0.35 of which 3 are right."""
    right, wrong = truth("eddy_drag"), truth("backlash")
    cases = [(right if k < 3 else wrong, answer("eddy_drag", probability=0.95)) for k in range(4)]
    cases += [(right if k < 3 else wrong, answer("eddy_drag", probability=0.35)) for k in range(6)]
    cases += [(wrong, answer("eddy_drag")), (wrong, FAILED)]
    found = reliability(cases)
    assert found.error == pytest.approx(0.4 * 0.2 + 0.6 * 0.15)
    assert found.count == 10
    assert [(b.low, b.high, b.right) for b in found.bins] == [
        (pytest.approx(0.3), pytest.approx(0.4), Rate(3, 6)), (pytest.approx(0.9), 1.0, Rate(3, 4)),
    ]  # fmt: skip


def test_calibration_error_of_right_probabilities_is_that_of_chance():
    rng = np.random.default_rng(3)
    p = rng.uniform(0.0, 1.0, 4000)
    names = np.where(rng.uniform(size=4000) < p, "eddy_drag", "backlash")
    found = reliability([(truth(n), answer("eddy_drag", probability=q)) for n, q in zip(names, p, strict=True)])
    assert found.error < 2.0 * found.by_chance < 0.04
    certain = reliability([(truth(n), answer("eddy_drag", probability=1.0)) for n in names])
    assert certain.error == pytest.approx(np.mean(names == "backlash")) and certain.by_chance == 0.0


def test_first_answers_without_a_name_are_calibrated_too():
    withheld = truth("cogging_force", withheld=True)
    unknown = dataclasses.replace(UNKNOWN_AT_MOVER, probability=1.0)
    nothing = answer(probability=1.0)
    assert reliability([(withheld, unknown), (truth(), nothing)]).error == 0.0
    assert reliability([(withheld, nothing), (truth(), unknown)]).error == 1.0


def test_answers_and_truths_are_the_same_after_storing():
    hidden = truth("sensor_lag on current", law=Law.DIFFERS, disturbed_signals=("current",), description="a filter")
    assert truth_from_json(truth_as_json(hidden)) == hidden
    full = answer(
        "eddy_drag", answer_set=("eddy_drag", "unknown"), probability=0.8, law={"eddy_drag": Law.DIFFERS},
        ranked=("eddy_drag",), parameters={"eddy_drag": {"size": (2.0, 0.1)}}, seconds=3.0,
    )  # fmt: skip
    for one in (full, FAILED, UNKNOWN_AT_MOVER):
        assert answer_from_json(answer_as_json(one)) == one
