"""The index of the studies lists what can be run, and each of them starts with the command that is given."""

import re
import runpy
import sys

import pytest

from tests.support import ROOT

README = (ROOT / "studies" / "README.md").read_text(encoding="utf-8")
ROWS = [line for line in README.splitlines() if line.startswith("|")][2:]
RUNNABLE = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__main__"): path
    for path in (ROOT / "studies").rglob("*.py")
    if '__name__ == "__main__"' in path.read_text(encoding="utf-8")
}


def test_every_study_has_a_row_and_every_row_is_a_study():
    commands = [re.search(r"`python -m (studies[\w.]*)", row)[1] for row in ROWS]
    assert sorted(commands) == sorted(RUNNABLE)
    for row in ROWS:
        question, _, time, last = (cell.strip() for cell in row.strip("|").split("|"))
        assert question.endswith("?") and re.match(r"\d+ (s|min)", time) and last.startswith("`")


@pytest.mark.parametrize("name", RUNNABLE)
def test_a_study_explains_its_options(name, monkeypatch, capsys):
    """Run as `python -m` does; the usage in the docstring names the command and only options that there are."""
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    monkeypatch.delitem(sys.modules, name, raising=False)  # run anew even where another test has imported it
    with pytest.raises(SystemExit) as ended:
        runpy.run_module(name, run_name="__main__", alter_sys=True)
    assert ended.value.code == 0
    printed = capsys.readouterr().out
    path = RUNNABLE[name]
    text = path.read_text(encoding="utf-8")
    if path.name == "__main__.py":
        assert len(text.splitlines()) <= 6, "the work belongs to a named module"
        module = re.search(r"from (studies[\w.]+) import main", text)[1]
        text = (ROOT / module.replace(".", "/")).with_suffix(".py").read_text(encoding="utf-8")
    (usage,) = re.findall(rf"^    python -m {re.escape(name)}(?: (.*))?$", text.split('"""')[1], re.MULTILINE)
    assert set(re.findall(r"--\w+", usage)) <= set(re.findall(r"--\w+", printed))
