"""A name that somebody has given is data, whatever it is written into: C, XML, YAML, HTML, a path, a figure."""

import ctypes
import html.parser
import io
import json
import re
import shutil
import subprocess
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.commands.console import PlainConsole, headed, table
from edhas_jax.config.run_folder import unused_folder
from edhas_jax.config.writer import dump_config
from edhas_jax.core.html_page import heading, json_element
from edhas_jax.core.literal_text import (
    MAX_FILE_NAME,
    c_comment,
    c_string,
    figure_text,
    file_name,
    one_line,
    terminal_text,
    xml_text,
    yaml_text,
)
from tests.support import ROOT

CODE = 'static void __attribute__((constructor)) f(void) { fclose(fopen("ran", "w")); }'
NAMES = [
    f"x\r{CODE}//", f"x\n{CODE}//", f"*\\\r/ {CODE} /*", f"*\\\n/ {CODE} /*", f"*/ {CODE} /*", f"\\\n{CODE}",
    f"*??/\n/ {CODE} /*", '"; int bad; //', "a [/b]", "[bold]b[/bold]", ":smile:", "costs $x^2$ or $", r"\$\frac",
    "../../../x", "/etc/passwd", "..", "", " ", ".hidden", "a/b\\c", "nul\0nul", "\x1b]0;title\x07\x1b[31mred",
    "a" * 5000,
    "</script><script>alert(1)</script>", "<b>&amp;", "\ud800", "\u202etxt.exe", "\u2028", "x\ncontroller: {kind: bad}",
    "yes", "null", "1e5", "%s %n", "é ü 名", "\ufffe", "~", "- a", "# a", "a: b", "x\x85y", "\ufeff", "${HOME} $(ls)",
]  # fmt: skip
MACHINE = "rig: actuator_bench\nsimulation: {duration: 0.1 s}\n"
by_name = pytest.mark.parametrize("name", NAMES, ids=lambda name: repr(name)[:30])
texts = st.text() | st.text(alphabet='*/\\?"\n\r\0 $[]<>&:#-\x1b\u2028\ud800')


@given(texts)
def test_c_comment(text):
    inside = c_comment(text)
    assert "*/" not in inside and "\\\n" not in inside and len(f"/* {inside} */".splitlines()) == 1
    assert "\\" not in inside.replace("\\ ", "")


@given(texts)
def test_c_string(text):
    literal = c_string(text)
    body = literal[1:-1]
    assert literal[0] == literal[-1] == '"' and len(literal.splitlines()) == 1 and "??" not in literal
    assert not re.search(r'(?<!\\)(\\\\)*"', body)
    plain = re.sub(rb"\\([0-7]{3}|.)", lambda m: bytes([int(m[1], 8)]) if len(m[1]) == 3 else m[1], body.encode())
    assert plain == text.encode("utf-8", "replace")


@given(texts)
def test_xml(text):
    element = ElementTree.Element("a", {"name": xml_text(text)})
    read = ElementTree.fromstring(ElementTree.tostring(element, encoding="unicode").encode("utf-8"))
    assert read.get("name") == xml_text(text)


@given(texts)
def test_yaml(text):
    assert yaml.safe_load(f"name: {yaml_text(text)}\nnext: 1\n") == {"name": text, "next": 1}
    assert yaml.safe_load(f"names: {{file: {yaml_text(text)}, next: 1}}\n") == {"names": {"file": text, "next": 1}}
    assert yaml.safe_load(f"# {one_line(text)}\nnext: 1\n".encode()) == {"next": 1}


@given(texts)
def test_file_names(text):
    name = file_name(text)
    assert name == Path(name).name and name not in ("", ".", "..") and not name.startswith(".")
    assert 0 < len(name.encode()) <= MAX_FILE_NAME and file_name(name) == name
    assert unused_folder(Path("comparisons"), text).parent == Path("comparisons")


@given(texts)
@settings(deadline=None)
def test_console(text):
    """What is printed is what was given, up to line breaks and what is invisible."""
    out = PlainConsole(width=200, file=io.StringIO(), force_terminal=False)
    out.print(text, soft_wrap=True)
    out.print(headed(text, ": more"), soft_wrap=True)
    rows = table(text, "column")
    rows.add_row(text)
    out.print(rows)
    printed = out.file.getvalue()
    words = terminal_text(text).split()
    assert all(word in printed for word in words if len(word) < 50) and "\x1b" not in printed


@given(texts)
@settings(deadline=None)
def test_figures(text):
    from matplotlib.text import Text

    shown, is_formula = Text()._preprocess_math(figure_text(text))
    assert is_formula is False and shown == text


class Elements(html.parser.HTMLParser):
    """The tags of a page."""

    def __init__(self, page):
        super().__init__()
        self.tags = []
        self.feed(page)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)


@given(texts | st.just("</script><script>alert(1)</script>"))
def test_html(text):
    assert Elements(heading(text)).tags == ["h2"]
    element = json_element({"name": text}, "data")
    assert Elements(element).tags == ["script"] and element.count("<") == 2
    assert json.loads(re.fullmatch(r"<script[^>]*>(.*)</script>", element, re.DOTALL)[1]) == {"name": text}


@by_name
def test_configuration(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("a.yaml").write_text(f"name: {yaml_text(name)}\n{MACHINE}", encoding="utf-8")
    if "\0" in name or "\ud800" in name:  # no part of a text
        assert main(["simulate", "a.yaml"]) == 2 and "is no part of a text or name" in capsys.readouterr().err
        return
    config = edhas.load("a.yaml")
    assert config.name == name
    Path("b.yaml").write_text(dump_config(config), encoding="utf-8")
    assert edhas.load("b.yaml").name == name
    assert main(["simulate", "a.yaml", "--out", "run", "--no-figure"]) == 0
    printed = capsys.readouterr().out
    assert "\x1b" not in printed and all(w in printed for w in terminal_text(name).split() if len(w) < 50)


def test_a_unit_with_such_a_name_runs_no_code(tmp_path, monkeypatch):
    """All names together in one unit; one by one they would take a compilation each."""
    monkeypatch.chdir(tmp_path)
    compiler = shutil.which("cc") or pytest.skip("no C compiler")
    name = " ".join(NAMES).replace("\ud800", "").replace("\0", "")
    Path("a.yaml").write_text(f"name: {yaml_text(name)}\n{MACHINE}", encoding="utf-8")
    assert main(["export", "a.yaml", "--sources-only"]) == 0
    with zipfile.ZipFile("a.fmu") as archive:
        archive.extractall("unit")
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    assert root.get("modelName") == xml_text(name)
    head = Path("unit/sources/machine.h").read_text(encoding="utf-8").splitlines()[0]
    assert head.startswith("/* ") and head.endswith("*/") and head.count("*/") == 1
    # the comments alone, as a library that is loaded: with the code of a name in it, the file `ran` would appear
    Path("head.c").write_text(
        "#include <stdio.h>\n"
        + "".join(f"/* {c_comment(n)} */\nconst char *s{k} = {c_string(n)};\n" for k, n in enumerate(NAMES)),
        encoding="utf-8",
    )
    subprocess.run([compiler, "-trigraphs", "-w", "-shared", "-fPIC", "head.c", "-o", "head.so"], check=True)
    ctypes.CDLL(str(tmp_path / "head.so"))
    assert not Path("ran").exists()


def test_comparison(tmp_path, monkeypatch, capsys):
    folder, bench = tmp_path / "bench", ROOT / "tests/data/campaign_bench"
    folder.mkdir()
    data = yaml.safe_load((bench / "campaign.yaml").read_text(encoding="utf-8"))
    data["name"], run = f"../../../x [/b] $y^{{$ <b>\r{CODE}\n# */", data["runs"][0]
    shutil.copy(bench / run["file"], folder / "=1+a [$x^{$ [b].csv")
    data["runs"] = [run | {"file": "=1+a [$x^{$ [b].csv"}]
    (folder / "campaign.yaml").write_text(json.dumps(data), encoding="utf-8")
    (tmp_path / "here/below/deep/down").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "here/below/deep/down")
    assert main(["compare", str(folder)]) == 0
    assert "=1+a [$x^{$ [b]" in capsys.readouterr().out
    (written,) = Path("comparisons").iterdir()
    assert {p.name for p in written.iterdir()} >= {"report.html", "figures.csv"}
    assert [p.name for p in tmp_path.iterdir() if p.name not in ("here", "bench")] == []
    assert set(pd.read_csv(written / "figures.csv")["run"]) == {"'=1+a [$x^{$ [b]"}, "a formula of a spreadsheet"
    tags = Elements((written / "report.html").read_text(encoding="utf-8")).tags
    assert "b" not in tags and "script" not in tags


def test_a_sweep_with_such_a_name(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    name = "a [/b] $x^{$ \x1b[31m"
    Path("s.yaml").write_text(
        f"name: {yaml_text(name)}\nmachine: {{rig: actuator_bench}}\n"
        "sweep: {kind: grid, parameters: {frequency: [5 Hz, 10 Hz], mover_mass: [0.1 kg, 0.2 kg]}}\n"
    )
    assert main(["sweep", "s.yaml"]) == 0 and main(["plot", "sweep", "runs/s"]) == 0
    printed = capsys.readouterr().out
    assert "a [/b] $x^{$" in printed and "\x1b" not in printed
    assert np.isfinite(edhas.open_sweep("runs/s").frame["rms_current"]).all()
