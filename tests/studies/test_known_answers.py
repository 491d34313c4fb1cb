"""The study `known_answers`: diagnoses of simulated campaigns, compared with what is hidden in them."""

import pytest

from studies.identification.known_answers import main, read_answers

ANSWERS = """# Answers

| campaign | verdict | hidden | size |
| --- | --- | --- | --- |
| first | `missing_effect` | eddy_drag | coefficient, N·s/m = 40 |
| second | `adequate` | nothing | |

The end.
"""


def test_table_of_answers_is_read():
    """Each campaign has the verdict, effect and parameter of its row; where nothing is hidden, no effect."""
    answers = read_answers(ANSWERS)
    assert list(answers) == ["first", "second"]
    assert answers["first"].names == {"eddy_drag"}
    assert answers["first"].sizes == {"coefficient": 40.0}
    assert answers["second"].verdict == "adequate"
    assert not answers["second"].names


def test_all_unreadable_campaigns_are_named_before_the_first_diagnosis(tmp_path, capsys):
    """The error message lists every campaign that cannot be read, before any diagnosis is started."""
    (tmp_path / "ANSWERS.md").write_text(ANSWERS, encoding="utf-8")
    with pytest.raises(SystemExit) as end:
        main([str(tmp_path)])
    message = capsys.readouterr().err
    assert end.value.code == 2
    assert str(tmp_path / "first") in message
    assert str(tmp_path / "second") in message
