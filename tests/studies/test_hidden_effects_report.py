"""Tables, and last line of the benchmark of hidden effects, from constructed answers."""

import dataclasses

from studies.hidden_effects.rates import Answered
from studies.hidden_effects.report import last_line, probability_table, report, time_table, wrong_answer
from studies.hidden_effects.store import Limit, Record
from tests.support.constructed_answers import FAILED, UNKNOWN_AT_MOVER, answer, truth


def test_tables_and_last_line():
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
    wrong = text.split("wrong answers")[1].split("slowest")[0]
    assert "nothing → missing_effect eddy_drag at mover" in wrong and FAILED.failed in wrong
    assert "cogging_force" not in wrong
    assert "(withheld)" in wrong_answer(*[(r.truth, r.answers["ours"]) for r in records][2])
    assert report([], {}).endswith("no answer")


def test_the_report_tells_effects_that_stand_out_from_the_rest():
    """The true laws of both effects of the first two cases explain three times what is left, those of the third not."""
    two, named = truth("cogging_force", "eddy_drag"), answer("eddy_drag", "cogging_force", probability=0.9)
    clear, weak = Limit(500.0, 9.0, 20.0, (20.0, 3.5)), Limit(500.0, 9.0, 20.0, (20.0, 0.7))
    records = [Record(two, {"ours": named, "previous": answer("backlash")}, clear),
               Record(two, {"ours": answer("eddy_drag"), "previous": named}, clear),
               Record(two, {"ours": answer("eddy_drag"), "previous": answer("eddy_drag")}, weak)]  # fmt: skip
    text = report(records, {})
    assert "| both of two hidden effects named, which stand out | 50 % (1/2; 9 … 91) | 50 % (1/2; 9 … 91) |" in text
    assert "| both of two hidden effects named, the rest | 0 % (0/1; 0 … 79) | 0 % (0/1; 0 … 79) |" in text
    assert "| 10 … inf | 33 % (1/3; 6 … 79) | 33 % (1/3; 6 … 79) |" in text
    line = dict(word.split("=") for word in last_line(records).split())
    assert line["ours_both_clear"] == "0.500" and line["previous_both_rest"] == "0.000"
    assert line["ours_three_clear"] == "nan"


def test_times_by_bench_and_right_answers_by_probability_have_tables():
    pump, system = (truth("cogging_force", description=f"{bench}: cogging_force") for bench in ("pump", "system"))
    sure, fast = (answer("cogging_force", probability=0.95, seconds=seconds) for seconds in (40.0, 20.0))
    wrong = answer("eddy_drag", probability=0.65, seconds=200.0)
    cases = [Answered(pump, sure), Answered(pump, fast), Answered(system, wrong)]
    assert time_table(cases)[-2:] == ["| pump | 2 | 30 s | 40 s | 40 s |", "| system | 1 | 200 s | 200 s | 200 s |"]
    unsure, almost = probability_table(cases)[-2:]
    assert unsure.startswith("| 0.6 … 0.7 | 0 % (0/1;") and almost.startswith("| 0.9 … 1.0 | 100 % (2/2;")
