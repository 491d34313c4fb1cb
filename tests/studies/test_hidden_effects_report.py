"""Tables, last line and pictures of the benchmark of hidden effects, from constructed answers."""

import dataclasses

from studies.hidden_effects.answers import Law, LawEstimate, answer_as_json, answer_from_json
from studies.hidden_effects.figures import save_figures
from studies.hidden_effects.report import (
    candidate_table,
    free_term_table,
    last_line,
    law_table,
    probability_table,
    report,
    time_table,
    wrong_answer,
)
from studies.hidden_effects.store import Record
from tests.support.constructed_answers import FAILED, UNKNOWN_AT_MOVER, answer, truth


def test_candidates_are_counted_with_what_they_explain():
    members = [{"name": "cogging_force", "strength": 8.0, "gains": {"cogging_force": 9.0, "backlash": 4.0}},
               {"name": "seal_friction", "strength": 0.5, "gains": {}},
               {"name": "supply_sag", "strength": 0.25, "gains": {}}]  # fmt: skip
    found = dataclasses.replace(answer("cogging_force"), evidence={"members": members})
    names = "cogging_force", "backlash", "coil_heating", "seal_friction"
    hidden = tuple(truth(n).hidden[0] for n in names)
    of_one = dataclasses.replace(truth("cogging_force"), hidden=hidden)
    rows = {cells[1]: cells[2:4] for line in candidate_table([(of_one, found)]) if len(cells := line.split("|")) > 3}
    text = {label.strip(): [cell.strip() for cell in cells] for label, cells in rows.items()}
    assert text["hidden: candidate, named"] == ["1", "8 (8 … 8)"]
    assert text["hidden: candidate, not named"] == ["1", "0.5 (0.5 … 0.5)"]
    assert text["not hidden: candidate, not named"] == ["1", "0.25 (0.25 … 0.25)"]
    assert text["hidden: rival of a candidate"] == ["1", "–"] and text["hidden: not in the answer"] == ["1", "–"]


def test_gains_of_free_terms_are_counted_where_no_effect_was_named():
    def with_gain(one, gain):
        return dataclasses.replace(one, evidence={"free_strength": gain, "misfit": 0.5 * gain})

    withheld = truth("cogging_force", withheld=True)
    cases = [
        (truth(), with_gain(answer(), 0.1)),
        (truth(), with_gain(answer(), 2.5)),
        (truth(), with_gain(answer("eddy_drag"), 0.0)),
        (withheld, with_gain(UNKNOWN_AT_MOVER, 40.0)),
        (withheld, with_gain(answer(), 0.7)),
        (truth("cogging_force"), with_gain(answer(), 0.7)),
        (withheld, FAILED),
    ]
    assert free_term_table(cases)[-3:] == [
        "| a withheld effect: an effect without a name | 0 | 0 | 0 | 1 | 20 (20 … 20) |",
        "| a withheld effect: nothing is missing | 0 | 1 | 0 | 0 | 0.35 (0.35 … 0.35) |",
        "| nothing: nothing is missing | 1 | 0 | 1 | 0 | 0.65 (0.35 … 0.95) |",
    ]


def test_tables_last_line_and_figures(tmp_path):
    records = [
        Record(truth("cogging_force"), {"ours": answer("cogging_force", probability=0.9, seconds=50.0)}),
        Record(truth(), {"ours": answer("eddy_drag", probability=0.6), "correlation": answer(seconds=20.0)}),
        Record(dataclasses.replace(truth("eddy_drag", withheld=True), family="h"), {"ours": UNKNOWN_AT_MOVER}),
        Record(dataclasses.replace(truth("backlash", visible=5.0), family="d"), {"ours": FAILED}),
    ]
    line = dict(word.split("=") for word in last_line(records).split())
    assert line["ours_top1"] == "0.500" and line["ours_wrong_on_nulls"] == "1.000" and line["ours_unknown"] == "1.000"
    assert line["correlation_adequate_on_nulls"] == "1.000" and line["correlation_top1"] == "nan"
    assert line["ours_calibration_error"] == "0.350" and line["ours_worst_s"] == "50"
    text = report(records, {"c00003": "nothing visible"})
    assert "not drawn: c00003: nothing visible" in text
    assert "| right name first | 50 % (1/2; 9 … 91) | – |" in text
    assert "| | (b) | (d) | (h) |" in text
    compared = text.split("cases that every method was run on")[1].split("by family")[0]
    assert "| `adequate` where nothing is hidden | 0 % (0/1; 0 … 79) | 100 % (1/1; 21 … 100) |" in compared
    table = text.split("where an effect is hidden")[1].split("\n\n")[1]
    outcomes = [line.split(" | ")[:3] for line in table.split("\n")]
    for label, count, in_set in (("right name", "1", "1"), ("error", "1", "0")):
        assert [f"| an effect that can be named: {label}", count, in_set] in outcomes
    assert ["| a withheld effect: an effect without a name", "1", "1"] in outcomes and len(outcomes) == 5
    wrong = text.split("wrong answers")[1].split("slowest")[0]
    assert "nothing → missing_effect eddy_drag at mover" in wrong and FAILED.failed in wrong
    assert "cogging_force" not in wrong
    assert "(withheld)" in wrong_answer(*[(r.truth, r.answers["ours"]) for r in records][2])
    save_figures(records, tmp_path)
    names = {path.name for path in tmp_path.glob("*.png") if path.stat().st_size > 5000}
    assert names == {"rates.png", "visibility.png", "times.png", "reliability.png", "confusion.png"}
    assert report([], {}).endswith("no answer")


def test_times_by_bench_and_right_answers_by_probability_have_tables():
    pump, system = (truth("cogging_force", description=f"{bench}: cogging_force") for bench in ("pump", "system"))
    sure, fast = (answer("cogging_force", probability=0.95, seconds=seconds) for seconds in (40.0, 20.0))
    wrong = answer("eddy_drag", probability=0.65, seconds=200.0)
    cases = [(pump, sure), (pump, fast), (system, wrong)]
    assert time_table(cases)[-2:] == ["| pump | 2 | 30 s | 40 s | 40 s |", "| system | 1 | 200 s | 200 s | 200 s |"]
    unsure, almost = probability_table(cases)[-2:]
    assert unsure.startswith("| 0.6 … 0.7 | 0 % (0/1;") and almost.startswith("| 0.9 … 1.0 | 100 % (2/2;")


def test_laws_that_differ_have_a_table():
    differs = dataclasses.replace(
        answer("cogging_force"), estimates={"cogging_force": LawEstimate(0.4, 0.1, True, 3.0, 1.5, 1.02)}
    )
    as_in_library = dataclasses.replace(
        answer("eddy_drag"), estimates={"eddy_drag": LawEstimate(0.02, 0.02, False, 3.0, 1.0, 1.0)}
    )
    cases = [(truth("cogging_force", law=Law.DIFFERS), differs), (truth("eddy_drag"), as_in_library)]
    (row,) = [line for line in law_table(cases) if line.startswith("| (b)")]
    assert row.startswith("| (b) | 1 | 1 | 0.4 (0.4 … 0.4) | 0.1 (0.1 … 0.1) | 3 (3 … 3) | 1.5 ")
    assert answer_from_json(answer_as_json(differs)) == differs
