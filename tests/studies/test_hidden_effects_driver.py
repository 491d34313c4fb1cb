"""The driver of the benchmark of hidden effects: command line, stored answers, resumption; with stubbed methods."""

import dataclasses
import json

import pytest

from studies.hidden_effects import benchmark, methods, published
from studies.hidden_effects.answers import Answer, HiddenEffect, Law, Truth, Verdict
from studies.hidden_effects.generators.hidden_case import CaseKey, HiddenCase, Split, keys_of
from studies.hidden_effects.methods import Method, SharedParts, answer_with
from studies.hidden_effects.our_answer import answer_of
from studies.hidden_effects.store import Limit, ResultFolder

HIDDEN = HiddenEffect("cogging_force", ("mover",), Law.LIBRARY, {}, 1000.0)


@pytest.fixture
def asked(monkeypatch):
    """Cases without a campaign and methods that find nothing; the list of what was asked."""
    calls = []

    def answer(method, case, shared):
        calls.append((case.truth.family, case.truth.number, method))
        return Answer(Verdict.ADEQUATE, probability=0.9, seconds=1.0)

    monkeypatch.setattr(
        benchmark, "draw", lambda key, first=0: HiddenCase(Truth(key.family, key.split.value, key.number), None, ())
    )
    monkeypatch.setattr(benchmark, "answer_with", answer)
    return calls


def run(folder, *arguments):
    return benchmark.main([*arguments, "--workers", "1", "--out", str(folder)])


def test_every_answer_is_stored_and_none_is_repeated(asked, tmp_path, capsys):
    assert run(tmp_path, "--families", "b", "--cases", "2", "--methods", "ours") == 0
    assert asked == [("b", 0, Method.OURS), ("b", 1, Method.OURS)]
    printed = capsys.readouterr().out
    assert "[2/2" in printed and "min left" in printed and "varied cases b00000 … b00001" in printed
    assert "ours_adequate_on_nulls=1.000" in printed.strip().splitlines()[-1]
    stored = json.loads((tmp_path / "varied" / "b00001" / "ours.json").read_text())
    assert stored["verdict"] == "adequate" and stored["probability"] == 0.9
    asked.clear()
    assert run(tmp_path, "--families", "b", "--cases", "3", "--methods", "ours,correlation") == 0
    assert asked == [
        ("b", 0, Method.CORRELATION), ("b", 1, Method.CORRELATION), ("b", 2, Method.OURS), ("b", 2, Method.CORRELATION),
    ]  # fmt: skip
    assert capsys.readouterr().out.strip().splitlines()[-1].count("adequate_on_nulls=1.000") == 2


def test_what_is_finished_survives_an_interruption(asked, tmp_path, monkeypatch, capsys):
    answer = benchmark.answer_with

    def interrupted(method, case, shared):
        if case.truth.number == 1 and method is Method.CORRELATION:
            raise KeyboardInterrupt
        return answer(method, case, shared)

    monkeypatch.setattr(benchmark, "answer_with", interrupted)
    arguments = ["--families", "b", "--cases", "2", "--methods", "ours,correlation"]
    with pytest.raises(SystemExit, match="130"):
        run(tmp_path, *arguments)
    assert "the same command continues" in capsys.readouterr().err
    monkeypatch.setattr(benchmark, "answer_with", answer)
    asked.clear()
    assert run(tmp_path, *arguments) == 0
    assert asked == [("b", 1, Method.CORRELATION)]


def test_a_case_that_cannot_be_drawn_is_said_and_tried_again(asked, tmp_path, monkeypatch, capsys):
    draw, arguments = benchmark.draw, ("--families", "b", "--cases", "1")

    def nothing_visible(key, first=0):
        raise RuntimeError("nothing visible in 12 draws")

    monkeypatch.setattr(benchmark, "draw", nothing_visible)
    assert run(tmp_path, *arguments) == 0
    assert "not drawn: b00000: nothing visible in 12 draws" in capsys.readouterr().out
    monkeypatch.setattr(benchmark, "draw", draw)
    assert run(tmp_path, *arguments) == 0
    assert "not drawn" not in capsys.readouterr().out and asked == [("b", 0, Method.OURS)]


def test_a_case_that_another_version_draws_differently_is_left_out(asked, tmp_path, monkeypatch, capsys):
    """Its answers would not be to the same campaign. A case is drawn again from the attempt that is known."""
    key, began = CaseKey("b", Split.VARIED, 0), []
    ResultFolder(tmp_path).store_truth(key, Truth("b", "varied", 0, (HIDDEN,), attempt=3))

    def drawn(visible):
        def draw(key, first=0):
            began.append(first)
            return HiddenCase(Truth("b", "varied", 0, (dataclasses.replace(HIDDEN, visible=visible),)), None, ())

        return draw

    monkeypatch.setattr(benchmark, "draw", drawn(1300.0))
    run(tmp_path, "--families", "b", "--cases", "1", "--methods", "previous")
    assert "left out" in capsys.readouterr().out and asked == [] and began == [3]
    monkeypatch.setattr(benchmark, "draw", drawn(1001.0))
    run(tmp_path, "--families", "b", "--cases", "1", "--methods", "previous")
    assert asked == [("b", 0, Method.PREVIOUS)]


def test_answers_to_judging_cases_are_not_shown_while_they_run(asked, tmp_path, capsys):
    assert run(tmp_path, "--split", "judging", "--cases", "17") == 0
    said = [line for line in capsys.readouterr().out.splitlines() if line.startswith("[")]
    assert len(said) == 17 and all(line.endswith("answered by ours") for line in said)
    assert [k.number for k in keys_of(Split.JUDGING, [], 0, 17)] == [number for _, number, _ in asked]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--methods", "ours,guessing"], "no method guessing; there are ours"),
        (["--families", "z"], "invalid choice: 'z'"),
        (["--split", "judging", "--families", "b"], "no judging case of b"),
        (["--split", "tuning", "--families", "c"], "no tuning case of c"),
    ],
)
def test_bad_options_are_refused(arguments, said, tmp_path, capsys):
    with pytest.raises(SystemExit):
        run(tmp_path, *arguments)
    assert said in capsys.readouterr().err


def test_a_method_that_ends_in_an_error_has_a_wrong_answer(monkeypatch):
    def failing(*_):
        raise ValueError("nothing to fit")

    monkeypatch.setattr(methods, "_diagnosed", failing)
    case = HiddenCase(Truth("b", "judging", 0), None, ())
    answer = answer_with(Method.OURS, case, SharedParts(case))
    assert answer.verdict is None and answer.failed == "ValueError: nothing to fit" and answer.first == ""


def test_cases_have_folders_of_their_own(tmp_path):
    results, key = ResultFolder(tmp_path), CaseKey("b", Split.VARIED, 7)
    assert results.of(key) == tmp_path / "varied" / "b00007"
    assert results.of(CaseKey("b", Split.TUNING, 7)) == tmp_path / "tuning" / "b00007"


def test_the_answer_of_a_diagnosis_is_read_from_its_file():
    """A named effect, another that is only in the model, and a fault of a sensor."""
    parameters = {"cogging_amplitude": {"value": 1.0, "std": 0.1, "unit": "N"}}
    plain = {
        "verdict": "ambiguous", "effects": ["sensor_lag", "cogging_force"],
        "answer": {"first": "cogging_force", "set": ["cogging_force", "unknown"],
                   "probabilities": {"cogging_force": 0.8, "sensor_lag on current": 0.7, "unknown": 0.1}},
        "candidates": [
            {"effect": "sensor_lag", "signal": "current", "accepted": True, "parameters": {}},
            {"effect": "cogging_force", "accepted": True, "parameters": parameters},
            {"effect": "eddy_drag", "accepted": True, "parameters": {}},
            {"effect": "backlash", "accepted": False, "parameters": {}},
        ],
        "laws": [{"effect": "cogging_force", "signal": None, "law": "differs"}],
        "where": [{"slot": "mover", "probability": 0.9}, {"slot": "sensor", "probability": 0.7}],
    }  # fmt: skip
    found = answer_of(plain)
    assert found.named == ("cogging_force", "sensor_lag on current") and found.first == "cogging_force"
    assert found.members == {"cogging_force", "unknown"} and found.place == "mover" and found.probability == 0.8
    assert found.law == {"cogging_force": Law.DIFFERS} and found.ranked[1] == "sensor_lag on current"
    assert found.parameters["cogging_force"] == {"cogging_amplitude": (1.0, 0.1)}
    nothing = plain | {"verdict": "adequate", "answer": {"first": "nothing", "set": ["nothing"],
                                                        "probabilities": {"nothing": 0.9}}}  # fmt: skip
    assert answer_of(nothing).named == () and answer_of(nothing).place is None


def test_published_answers_are_kept_with_their_commit_and_never_replaced(asked, tmp_path, capsys):
    """Later answers are added to those in the file; in a folder written from it no answer is computed again."""
    cases, kept = ["--families", "b"], ["--split", "varied", "--file", str(tmp_path / "kept.jsonl")]
    run(tmp_path / "one", *cases, "--cases", "2", "--methods", "ours")
    ResultFolder(tmp_path / "one").store_limit(CaseKey("b", Split.VARIED, 1), Limit(5.0, 1.0, 4.0, (4.0,)))
    assert published.main([*kept, "--add", str(tmp_path / "one"), "--commit", "abc1234"]) == 0
    run(tmp_path / "two", *cases, "--cases", "3", "--methods", "ours,correlation")
    assert published.main([*kept, "--add", str(tmp_path / "two"), "--commit", "def5678"]) == 0
    rows = [json.loads(line) for line in (tmp_path / "kept.jsonl").read_text().splitlines()]
    assert [row["commits"]["ours"] for row in rows] == ["abc1234", "abc1234", "def5678"]
    assert {row["commits"]["correlation"] for row in rows} == {"def5678"}
    capsys.readouterr()
    assert published.main([*kept, "--to", str(tmp_path / "three")]) == 0
    printed = capsys.readouterr().out
    assert "answers of abc1234, def5678" in printed
    assert published.main([*kept, "--families", "c"]) == 1 and "no kept answers of c" in capsys.readouterr().out
    assert published.main([*kept, "--methods", "correlation"]) == 0
    printed_one = capsys.readouterr().out
    assert "answers of def5678\n" in printed_one and "ours_top1" not in printed_one
    asked.clear()
    run(tmp_path / "three", *cases, "--cases", "4", "--methods", "ours,correlation")
    assert [number for _, number, _ in asked] == [3, 3]
    assert printed.strip().splitlines()[-1].startswith("ours_top1=")
    (record,) = ResultFolder(tmp_path / "three").records([CaseKey("b", Split.VARIED, 1)], ())
    assert record.limit == Limit(5.0, 1.0, 4.0, (4.0,))


def test_published_answers_need_a_commit_and_a_folder(tmp_path, capsys):
    kept = ["--file", str(tmp_path / "kept.jsonl")]
    for arguments, said in ((["--add", str(tmp_path)], "--commit"),
                            (["--add", str(tmp_path), "--commit", "abc"], "no folder of results")):  # fmt: skip
        with pytest.raises(SystemExit):
            published.main([*kept, *arguments])
        assert said in capsys.readouterr().err
    assert published.main(kept) == 1 and "no kept answers to judging cases" in capsys.readouterr().out
