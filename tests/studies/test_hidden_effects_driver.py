"""The driver of the benchmark of hidden effects: command line, stored answers, resumption; with stubbed methods."""

import dataclasses
import json

import pytest

from studies.hidden_effects import benchmark, methods, published
from studies.hidden_effects.answers import Answer, Truth, Verdict
from studies.hidden_effects.calibrated_case import CalibratedCase
from studies.hidden_effects.cases import FIRST_EARLIER_CASE, FIRST_TEST_CASE
from studies.hidden_effects.drawing import CaseKey, DrawnCase
from studies.hidden_effects.generators.hidden_case import Split
from studies.hidden_effects.methods import Method, answer_with
from studies.hidden_effects.store import ResultFolder


@pytest.fixture
def asked(monkeypatch):
    """Cases without a campaign and methods that find nothing; the list of what was asked."""
    calls = []

    def answer(method, case, shared):
        calls.append((case.truth.family, case.truth.number, method))
        return Answer(Verdict.ADEQUATE, probability=0.9, seconds=1.0)

    monkeypatch.setattr(
        benchmark, "draw", lambda key: DrawnCase(Truth(key.family, key.split.value, key.number), None, ())
    )
    monkeypatch.setattr(benchmark, "answer_with", answer)
    return calls


def run(folder, *arguments):
    return benchmark.main([*arguments, "--workers", "1", "--out", str(folder)])


def test_every_answer_is_stored_and_none_is_repeated(asked, tmp_path, capsys):
    assert run(tmp_path, "--cases", "2", "--seed", "0", "--methods", "ours") == 0
    assert asked == [("a", 0, Method.OURS), ("a", 1, Method.OURS)]
    printed = capsys.readouterr().out
    assert "[2/2" in printed and "min left" in printed and "development cases a00000 … a00001" in printed
    assert "ours_adequate_on_nulls=1.000" in printed.strip().splitlines()[-1]
    stored = json.loads((tmp_path / "tuning" / "a00001" / "ours.json").read_text())
    assert stored["verdict"] == "adequate" and stored["probability"] == 0.9
    asked.clear()
    assert run(tmp_path, "--cases", "3", "--seed", "0", "--methods", "ours,correlation") == 0
    assert asked == [
        ("a", 0, Method.CORRELATION), ("a", 1, Method.CORRELATION), ("a", 2, Method.OURS), ("a", 2, Method.CORRELATION),
    ]  # fmt: skip
    assert capsys.readouterr().out.strip().splitlines()[-1].count("adequate_on_nulls=1.000") == 2


def test_what_is_finished_survives_an_interruption(asked, tmp_path, monkeypatch, capsys):
    answer = benchmark.answer_with

    def interrupted(method, case, shared):
        if case.truth.number == 1 and method is Method.CORRELATION:
            raise KeyboardInterrupt
        return answer(method, case, shared)

    monkeypatch.setattr(benchmark, "answer_with", interrupted)
    arguments = ["--cases", "2", "--first", "0", "--methods", "ours,correlation"]
    assert run(tmp_path, *arguments) == 130
    assert "the same command continues" in capsys.readouterr().err
    monkeypatch.setattr(benchmark, "answer_with", answer)
    asked.clear()
    assert run(tmp_path, *arguments) == 0
    assert asked == [("a", 1, Method.CORRELATION)]


def test_a_case_that_cannot_be_drawn_is_said_and_tried_again(asked, tmp_path, monkeypatch, capsys):
    draw = benchmark.draw

    def nothing_visible(key):
        raise RuntimeError("nothing visible in 12 draws")

    monkeypatch.setattr(benchmark, "draw", nothing_visible)
    assert run(tmp_path, "--cases", "1", "--first", "0", "--methods", "ours") == 0
    assert "not drawn: a00000: nothing visible in 12 draws" in capsys.readouterr().out
    monkeypatch.setattr(benchmark, "draw", draw)
    assert run(tmp_path, "--cases", "1", "--first", "0", "--methods", "ours") == 0
    assert "not drawn" not in capsys.readouterr().out and asked == [("a", 0, Method.OURS)]


def test_baselines_are_all_methods_but_ours_that_can_run(asked, tmp_path, capsys):
    run(tmp_path, "--cases", "1", "--first", "0", "--baselines")
    said = {Method(line.split()[1].rstrip(":")) for line in capsys.readouterr().out.splitlines() if "without" in line}
    assert Method.CLASSIFIER in said
    assert [method for _, _, method in asked] == [m for m in Method if m is not Method.OURS and m not in said]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--cases", "20", "--seed", str(FIRST_TEST_CASE - 5)], "do not mix"),
        (["--cases", "20", "--seed", str(FIRST_EARLIER_CASE - 5)], "do not mix"),
        (["--cases", "40000", "--seed", "10000"], "do not mix"),
        (["--methods", "ours,guessing"], "no method guessing; there are ours"),
        (["--families", "z"], "invalid choice: 'z'"),
        (["--methods", "ours,classifier"], "classifier"),
    ],
)
def test_bad_options_are_refused(arguments, said, tmp_path, capsys):
    with pytest.raises(SystemExit):
        run(tmp_path, *arguments)
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "folder", "kind"),
    [
        (["--first", "10000"], "tuning/a10000", "development"),
        (["--split", "earlier", "--first", "30000"], "earlier/a30000", "development"),
        (["--split", "earlier"], "earlier/a11000", "development"),
        (["--first", "39999"], "earlier/a39999", "development"),
        ([], "judging/a40000", "test"),
        (["--families", "b", "--first", "30000"], "judging/b30000", "test"),
        (["--families", "b", "--split", "earlier"], "earlier/b00000", "development"),
    ],
)
def test_numbers_of_the_first_family_tell_the_split(asked, tmp_path, capsys, arguments, folder, kind):
    assert run(tmp_path, *arguments, "--cases", "1", "--methods", "ours") == 0
    assert (tmp_path / folder / "ours.json").exists() and f"\n{kind} cases" in capsys.readouterr().out


def test_a_method_that_ends_in_an_error_has_a_wrong_answer(monkeypatch):
    def failing(*_):
        raise ValueError("nothing to fit")

    monkeypatch.setattr(methods, "diagnose", failing)
    case = DrawnCase(Truth("a", "judging", 0), None, ())
    answer = answer_with(Method.OURS, case, CalibratedCase(case))
    assert answer.verdict is None and answer.failed == "ValueError: nothing to fit" and answer.first == ""


def test_cases_of_a_family_have_folders_of_their_own(tmp_path):
    results, key = ResultFolder(tmp_path), CaseKey("b", Split.JUDGING, 7)
    folders = {results.of(k) for k in (key, dataclasses.replace(key, sensor_lags=True), CaseKey("b", Split.TUNING, 7))}
    assert len(folders) == 3 and results.of(key) == tmp_path / "judging" / "b00007"
    assert results.of(CaseKey("b", Split.EARLIER, 7)) == tmp_path / "earlier" / "b00007"


def test_published_answers_are_kept_with_their_commit_and_never_replaced(asked, tmp_path, capsys):
    """Later answers are added to those in the file; in a folder written from it no answer is computed again."""
    numbers, kept = ["--first", str(FIRST_TEST_CASE)], ["--file", str(tmp_path / "kept.jsonl")]
    run(tmp_path / "one", *numbers, "--cases", "2", "--methods", "ours")
    assert published.main([*kept, "--add", str(tmp_path / "one"), "--commit", "abc1234"]) == 0
    run(tmp_path / "two", *numbers, "--cases", "3", "--methods", "ours,correlation")
    assert published.main([*kept, "--add", str(tmp_path / "two"), "--commit", "def5678"]) == 0
    rows = [json.loads(line) for line in (tmp_path / "kept.jsonl").read_text().splitlines()]
    assert [row["commits"]["ours"] for row in rows] == ["abc1234", "abc1234", "def5678"]
    assert {row["commits"]["correlation"] for row in rows} == {"def5678"}
    capsys.readouterr()
    assert published.main([*kept, "--to", str(tmp_path / "three"), "--out", str(tmp_path / "figures")]) == 0
    printed = capsys.readouterr().out
    assert "answers of abc1234, def5678" in printed and (tmp_path / "figures" / "rates.png").exists()
    assert published.main([*kept, "--families", "b"]) == 1 and "no kept answers of b" in capsys.readouterr().out
    assert published.main([*kept, "--commits", "abc1234"]) == 0
    printed_one = capsys.readouterr().out
    assert "answers of abc1234\n" in printed_one and "correlation_top1" not in printed_one
    assert published.main([*kept, "--commits", "0000000"]) == 1 and "by 0000000" in capsys.readouterr().out
    asked.clear()
    run(tmp_path / "three", *numbers, "--cases", "4", "--methods", "ours,correlation")
    assert [number for _, number, _ in asked] == [FIRST_TEST_CASE + 3] * 2
    assert printed.strip().splitlines()[-1].startswith("ours_top1=")


def test_published_answers_need_a_commit_and_a_folder(tmp_path, capsys):
    kept = ["--file", str(tmp_path / "kept.jsonl")]
    for arguments, said in ((["--add", str(tmp_path)], "--commit"),
                            (["--add", str(tmp_path), "--commit", "abc"], "no folder of results")):  # fmt: skip
        with pytest.raises(SystemExit):
            published.main([*kept, *arguments])
        assert said in capsys.readouterr().err
    assert published.main(kept) == 1 and "no kept answers" in capsys.readouterr().out


def test_missing_answers_are_said_with_the_split(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(published, "file_of", lambda split: tmp_path / f"published_{split.value}.jsonl")
    for arguments, split in (([], "judging"), (["--families", "b"], "judging"), (["--split", "earlier"], "earlier")):
        assert published.main(arguments) == 1
        assert capsys.readouterr().out.strip().endswith(f"published_{split}.jsonl: no kept answers to {split} cases")
