"""Options, names and files that no command can use: one sentence and status 2, whatever the command."""

import io
import re
import sys
import warnings

import pytest

from edhas_jax.commands import cli
from edhas_jax.commands.cli import main
from edhas_jax.inference.fit.fit import fit
from edhas_jax.inference.fit.fit_problem import FitError, FitProblem
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.unknown_parameters import uncertain_unknowns
from tests.support import CONFIGS
from tests.support.faulty_campaign import VALID_CAMPAIGN, copy_campaign, replace_in_yaml

CONFIG, CAMPAIGN = str(CONFIGS / "paper.yaml"), str(VALID_CAMPAIGN)
MANY_DIGITS = "9" * 5000


@pytest.fixture(autouse=True)
def working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refused(capsys, arguments):
    """The message of a refused command line; argparse leaves by SystemExit, and shows the usage first."""
    try:
        status = main(arguments)
    except SystemExit as ended:
        status = ended.code
    assert status == 2
    (message,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("edhas") and ": " in line]
    return message


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        *((["fit", CAMPAIGN, "--starts", text], "a whole number from 1 to 100 belongs here")
          for text in ("0", "-3", "101", "1.5", "", "two", MANY_DIGITS)),
        (["plan", CAMPAIGN, "--rate", "1e12 Hz"], "has 3e+11 samples at 1e6 MHz, at most 200,000 can be planned"),
        (["plan", CAMPAIGN, "--rate", "1e300 Hz"], "at most 200,000 can be planned"),
        *((["plan", CAMPAIGN, "--rate", text], "must be above 0") for text in ("0 Hz", "-1 kHz")),
        (["plan", CAMPAIGN, "--rate", MANY_DIGITS + " Hz"], "is not a finite number"),
        (["export", CONFIG, "--compiler", 'cc -DX="'], 'cc -DX="` has a quotation mark that is not closed'),
        (["simulate", CONFIG, "--set", f"duration={MANY_DIGITS} s"], "is not a finite number"),
        (["simulate", CONFIG, "--set", f"piston_clearance=0.{MANY_DIGITS} m"], "must lie in 0 m … 1 mm"),
        (["simulate", CONFIG, "--set", f"step={MANY_DIGITS}"], "is not a finite number"),
    ],
)  # fmt: skip
def test_values_of_options(capsys, arguments, sentence):
    message = refused(capsys, arguments)
    assert sentence in message and len(message) < 400


def test_no_starting_point_from_python():
    campaign = read_campaign(VALID_CAMPAIGN)
    with pytest.raises(FitError, match="at least 1 starting point is needed, not 0"):
        fit(FitProblem(campaign, campaign.machine, uncertain_unknowns(campaign)), starts=0)


@pytest.mark.parametrize("kind", ["[a]", "{a: b}", "1", "''"])
@pytest.mark.parametrize("section", ["controller", "amplifier", "reference"])
def test_the_kind_of_a_component(capsys, tmp_path, section, kind):
    folder = copy_campaign(tmp_path / "bench")
    replace_in_yaml(folder, "rig: pump_bench", f"rig: pump_bench\n{section}: {{kind: {kind}}}")
    assert f"campaign.yaml:4: {section}.kind: " in refused(capsys, ["campaign", "check", str(folder)])


COMMANDS_WITH_A_NAME = [
    ["simulate", "NAME"], ["simulate", CONFIG, "--out", "NAME"], ["sweep", "NAME"], ["campaign", "check", "NAME"],
    ["campaign", "new", "NAME"], ["compare", "NAME"], ["compare", CAMPAIGN, "--out", "NAME"],
    ["compare", CAMPAIGN, "--model", "NAME"], ["fit", "NAME"], ["fit", CAMPAIGN, "--out", "NAME"], ["plan", "NAME"],
    ["diagnose", "NAME"], ["diagnose", CAMPAIGN, "--effect", "NAME.py:A"], ["size", "NAME"], ["sensitivity", "NAME"],
    ["export", "NAME"], ["export", CONFIG, "--sources-only", "--out", "NAME"], ["parameters", "NAME"],
    ["effects", "NAME.py:A"], ["effects", "--config", "NAME"], ["plot", "sweep", "NAME"],
    ["add", "NAME", "entrained_air"],
]  # fmt: skip


@pytest.mark.parametrize("arguments", COMMANDS_WITH_A_NAME, ids=" ".join)
@pytest.mark.parametrize("name", ["a" * 300, "a\0b", "a\udcff"], ids=["long", "NUL", "no UTF-8"])
def test_names_that_no_file_can_have(capsys, working_folder, arguments, name):
    message = refused(capsys, [text.replace("NAME", name) for text in arguments])
    assert ("File name too long" in message or "no name in UTF-8" in message) and len(message) < 1000
    assert not list(working_folder.iterdir())


@pytest.mark.parametrize("name", ["a" * 300 + ".csv", '"a\\0b.csv"', '"a\\uD800.csv"'])
def test_names_in_a_campaign(capsys, tmp_path, name):
    folder = copy_campaign(tmp_path / "bench")
    replace_in_yaml(folder, "file: run8.csv", f"file: {name}")
    if "\\" in name:
        assert "campaign.yaml:19: the character of code" in refused(capsys, ["campaign", "check", str(folder)])
    else:
        (remark,) = read_campaign(folder).remarks
        assert remark.sentence == "cannot be read: File name too long; the run is left out"


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp437"])
@pytest.mark.parametrize(
    ("arguments", "status", "text"),
    [
        (["parameters", CONFIG], 0, "piston_clearance"),
        (["effects", "entrained_air"], 0, "air_fraction"),
        (["schema"], 0, "piston_clearance"),
        (["simulate", CONFIG, "--set", "step=3"], 2, ""),
    ],
)
def test_a_terminal_that_is_not_unicode(monkeypatch, encoding, arguments, status, text):
    streams = [io.TextIOWrapper(io.BytesIO(), encoding=encoding) for _ in range(2)]
    monkeypatch.setattr(sys, "stdout", streams[0])
    monkeypatch.setattr(sys, "stderr", streams[1])
    assert main(arguments) == status
    for stream in streams:
        stream.flush()
    printed, messages = (stream.buffer.getvalue().decode(encoding) for stream in streams)
    assert text in printed and [stream.errors for stream in streams] == ["strict", "strict"]
    if encoding == "ascii" and arguments[0] == "effects":
        assert "+-" in printed or "---" in printed
    if status == 2:
        assert ("20 us" if encoding == "ascii" else "20 µs") in messages


@pytest.mark.parametrize(
    ("name", "sentence"),
    [(".", r"\.: is a folder; name the file of the picture, such as picture\.png"),
     ("drag.xyz", "drag.xyz: ends in no format of pictures; known: .*png"), ("drag", "ends in no format of pictures")],
)  # fmt: skip
def test_a_picture_of_no_format_is_refused_before_anything_is_drawn(
    capsys, monkeypatch, working_folder, name, sentence
):
    monkeypatch.setattr("edhas_jax.simulation.effect_preview.preview_effect", None)
    assert re.search(sentence, refused(capsys, ["effects", "cogging_force", "--picture", name]))
    assert not list(working_folder.iterdir())


def test_a_warning_of_numpy_is_not_shown_and_others_are():
    shown = []
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.showwarning = lambda message, *_, **__: shown.append(str(message))
        cli._prepare_process()
        warnings.warn("overflow encountered in exp", RuntimeWarning, stacklevel=1)
        warnings.warn("a remark", UserWarning, stacklevel=1)
    assert shown == ["a remark"]
