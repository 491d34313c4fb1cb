"""The study that diagnoses campaigns whose answers are known."""

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
    """Names and sizes of the hidden effects are those of the table; a campaign without any has none."""
    answers = read_answers(ANSWERS)
    assert list(answers) == ["first", "second"]
    assert answers["first"].names == {"eddy_drag"}
    assert answers["first"].sizes == {"coefficient": 40.0}
    assert answers["second"].verdict == "adequate"
    assert not answers["second"].names


def test_all_unreadable_campaigns_are_named_before_the_first_diagnosis(tmp_path, capsys):
    """Diagnoses take minutes, so that every campaign that cannot be read is named at once."""
    (tmp_path / "ANSWERS.md").write_text(ANSWERS, encoding="utf-8")
    with pytest.raises(SystemExit) as end:
        main([str(tmp_path)])
    message = capsys.readouterr().err
    assert end.value.code == 2
    assert str(tmp_path / "first") in message
    assert str(tmp_path / "second") in message
