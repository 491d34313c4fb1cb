"""Files of data loggers and spreadsheets: read by their content, or refused with the cause and the remedy."""

import re
import sys

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rich.console import Console
from scipy.io import savemat

from edhas_jax.commands.cli import main
from edhas_jax.commands.console import print_remarks
from edhas_jax.measurements.campaign import Severity
from edhas_jax.measurements.campaign_reader import read_campaign
from tests.support.faulty_campaign import VALID_CAMPAIGN, copy_campaign, modify_table, replace_in_yaml

RUNS = ("run3.csv", "run4.csv", "run8.csv")
MAX_LINES = 10


@pytest.fixture(scope="module")
def valid():
    return read_campaign(VALID_CAMPAIGN)


@pytest.fixture()
def folder(tmp_path):
    return copy_campaign(tmp_path / "bench")


def rewrite(folder, change, run="run3.csv", name=None):
    """Replace the text of a run by what `change` makes of its lines, in a file of another name if one is given."""
    text = change((folder / run).read_text().splitlines())
    (folder / (name or run)).write_bytes(text if isinstance(text, bytes) else ("\n".join(text) + "\n").encode())
    if name:
        replace_in_yaml(folder, run, name)


def faults(campaign):
    return [remark for remark in campaign.remarks if remark.severity is not Severity.NOTE]


def same_signals(run, expected):
    assert np.allclose(run.time, expected.time, rtol=1e-12)
    assert all(np.allclose(run.signals[n], values, rtol=1e-9) for n, values in expected.signals.items())


def units_below(lines):
    parts = [cell.rstrip("]").split(" [") for cell in lines[0].split(",")]
    return [",".join(column) for column in zip(*parts, strict=True)] + lines[1:]


def bracketed_units_below(lines):
    names, units, *rest = units_below(lines)
    return [names, ",".join(f"({unit})" for unit in units.split(",")), "", *rest]


NOTES = ["Logger 4711;firmware 2.1", "", "Date,22.11.2026", "Rate [Hz],5000", "Channels,6", "Comment: cold oil", ""]
READABLE = {
    "notes above": lambda lines: NOTES + lines,
    "a long list of settings above": lambda lines: [f"Setting {k},{k}" for k in range(600)] + lines,
    "sep=,": lambda lines: ["sep=,", *lines],
    "sep=;": lambda lines: ["sep=;", *(line.replace(",", ";") for line in lines)],
    "blank lines first": lambda lines: ["", "   ", *lines],
    "semicolons": lambda lines: [line.replace(",", ";") for line in lines],
    "semicolons and decimal commas": lambda lines: [line.replace(",", ";").replace(".", ",") for line in lines],
    "tabs and decimal commas": lambda lines: [line.replace(",", "\t").replace(".", ",") for line in lines],
    "spaces": lambda lines: [line.replace(",", "   ") for line in lines],
    "spaces and decimal commas": lambda lines: ["  " + line.replace(",", "  ").replace(".", ",") for line in lines],
    "comma and space": lambda lines: [line.replace(",", ", ") for line in lines],
    "a comma at every end": lambda lines: [line + "," for line in lines],
    "a semicolon after every number": lambda lines: [lines[0].replace(",", ";")]
    + [line.replace(",", ";") + ";" for line in lines[1:]],
    "units below the names": units_below,
    "units in brackets and a blank line": bracketed_units_below,
    "line ends of Windows": lambda lines: ("\r\n".join(lines) + "\r\n").encode(),
    "UTF-16": lambda lines: ("\n".join(lines) + "\n").encode("utf-16"),
    "code of Windows": lambda lines: ("Öltemperatur 40 °C\n" + "\n".join(lines) + "\n").encode("cp1252"),
    "numbers in quotation marks": lambda lines: [",".join(f'"{cell}"' for cell in line.split(",")) for line in lines],
}  # fmt: skip


@pytest.mark.parametrize("change", READABLE.values(), ids=READABLE)
def test_files_of_loggers_are_read(folder, valid, change):
    rewrite(folder, change)
    campaign = read_campaign(folder)
    assert not faults(campaign)
    same_signals(campaign.runs[0], valid.runs[0])


@pytest.mark.parametrize("name", ["run3.CSV", "run3.txt", "run3.dat", "run3.tsv", "run3", "run3.Log"])
def test_the_content_of_a_file_counts_and_not_its_ending(folder, valid, name):
    rewrite(folder, lambda lines: [line.replace(",", "\t") for line in lines], name=name)
    campaign = read_campaign(folder)
    assert not faults(campaign)
    same_signals(campaign.runs[0], valid.runs[0])


def test_a_parquet_and_a_matlab_file_with_another_ending(folder, valid):
    for run, name in (("run3.csv", "run3.dat"), ("run4.csv", "run4.MAT")):
        frame = pd.read_csv(folder / run)
        if run == "run3.csv":
            pq.write_table(pa.Table.from_pandas(frame), folder / name)
        else:
            vectors = {cell.partition(" ")[0]: frame[cell].to_numpy() for cell in frame}
            with (folder / name).open("wb") as file:
                savemat(file, vectors | {"units": {"time": "ms"}})
        replace_in_yaml(folder, run, name)
    campaign = read_campaign(folder)
    assert not faults(campaign)
    for run, expected in zip(campaign.runs, valid.runs, strict=True):
        same_signals(run, expected)


def test_the_first_sheet_of_an_excel_file(folder, valid):
    pytest.importorskip("openpyxl")
    frame = pd.read_csv(folder / "run3.csv")
    with pd.ExcelWriter(folder / "run3.xlsx") as book:
        frame.to_excel(book, index=False, startrow=4)
        book.sheets["Sheet1"]["A1"] = "Logger 4711"
    replace_in_yaml(folder, "run3.csv", "run3.xlsx")
    campaign = read_campaign(folder)
    assert not faults(campaign)
    same_signals(campaign.runs[0], valid.runs[0])
    assert campaign.runs[0].lines[0] == 6
    content = (folder / "run3.xlsx").read_bytes()
    (folder / "run3.xlsx").write_bytes(content[: len(content) // 2])
    (remark,) = read_campaign(folder).remarks
    assert "is damaged or not an Excel file" in remark.sentence


def test_an_excel_file_without_its_reader(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    rewrite(folder, lambda lines: b"PK\x03\x04....", name="run3.xlsx")
    (remark,) = read_campaign(folder).remarks
    assert "save it as CSV, or install what reads it: pip install 'edhas_jax[excel]'" in remark.sentence


def decimal_commas(lines):
    return [lines[0]] + [line.replace(".", ",") for line in lines[1:]]


def with_cell(row, column, text):
    def change(lines):
        cells = lines[row].split(",")
        cells[column] = text
        return [*lines[:row], ",".join(cells), *lines[row + 1 :]]

    return change


REFUSED = {
    "decimal commas and commas": (
        decimal_commas, ":1: numbers have decimal commas.*export with decimal points, or with semicolons"
    ),
    "no names": (lambda lines: lines[1:], ":1: the columns have no names above their numbers; the first line names"),
    "one name too few": (
        lambda lines: [lines[0].rpartition(",")[0].rpartition(",")[0], *lines[1:]],
        ":2: 6 values where line 1 names 4 columns; name every column",
    ),
    "no table": (lambda lines: ["Dear customer,", "the logger was out of order."], "holds no table of numbers"),
    "only blank lines": (lambda lines: ["", " ", ""], "is empty; the first line names the columns"),
    "empty": (lambda lines: b"", "is empty; the first line names the columns"),
    "gzip": (lambda lines: b"\x1f\x8b\x08\x00....", "is compressed with gzip; unpack it"),
    "old Excel": (lambda lines: b"\xd0\xcf\x11\xe0....", "save it as CSV or .xlsx"),
    "other bytes": (lambda lines: bytes(range(256)) * 4, "is not a text file; a table is needed"),
    "3 samples": (lambda lines: lines[:4], "at least 10 samples are needed; there are 3"),
    "a time column of another name": (
        lambda lines: ["t" + lines[0], *lines[1:]], ":1: no column `time` with the time; name it in the campaign"
    ),
    "one column twice": (
        lambda lines: [lines[0].replace("current [A]", "voltage [mV]"), *lines[1:]], ":1: has several columns `voltage`"
    ),
}  # fmt: skip


@pytest.mark.parametrize(("change", "sentence"), REFUSED.values(), ids=REFUSED)
def test_the_cause_and_the_remedy_are_one_sentence(folder, change, sentence):
    rewrite(folder, change)
    (remark,) = faults(read_campaign(folder))
    assert re.search(sentence, str(remark))
    assert str(remark).endswith("the run is left out")


@pytest.mark.parametrize("change", [decimal_commas, lambda lines: lines[1:], lambda lines: lines[:4]])
def test_a_campaign_of_such_files_is_refused_in_few_lines(folder, change, capsys):
    for run in RUNS:
        rewrite(folder, change, run)
    assert main(["campaign", "check", str(folder)]) == 2
    first, *others = capsys.readouterr().err.splitlines()
    assert "run3.csv" in first and "(also run4.csv, run8.csv)" in first and len(others) == 1


def test_a_stray_quotation_mark_damages_its_own_line_only(folder, valid):
    rewrite(folder, lambda lines: [*lines[:500], '"' + lines[500], *lines[501:]])
    campaign = read_campaign(folder)
    (remark,) = faults(campaign)
    assert remark.line == 501 and remark.sentence == "a quotation mark is not closed; line left out"
    assert len(campaign.runs[0].time) == len(valid.runs[0].time) - 1


def test_a_quotation_mark_in_a_file_of_150_kilobytes(folder):
    rewrite(folder, lambda lines: [lines[0], *lines[1:500], '"' + lines[500], *lines[501:], *lines[1:] * 2])
    campaign = read_campaign(folder)
    assert any(remark.line == 501 and "quotation mark" in remark.sentence for remark in campaign.remarks)


def test_a_long_line_without_commas(folder, valid):
    rewrite(folder, lambda lines: [*lines[:500], '"' + "9" * 200_000 + '"', *lines[500:]])
    campaign = read_campaign(folder)
    assert len(campaign.runs[0].time) == len(valid.runs[0].time)
    assert [remark.line for remark in faults(campaign)] == [501] and len(str(faults(campaign)[0])) < 300


def test_many_missing_samples_are_one_remark(folder):
    def with_holes(frame):
        frame.iloc[::2, 1:] = np.nan
        return frame

    modify_table(folder, "run3.csv", with_holes)
    (remark,) = faults(read_campaign(folder))
    assert remark.sentence.startswith("voltage, current, piston_position, outlet_pressure, outlet_flow: 676 missing")
    assert "in 676 places up to line 1352" in remark.sentence


def test_no_file_has_more_than_ten_remarks(folder):
    """Every second line lacks a value, every third has one that is no number, time goes backwards, quotes are open."""

    def spoiled(lines):
        for k in range(1, len(lines), 7):
            lines[k] = lines[k].rpartition(",")[0]
        for column in range(1, 5):
            for k in range(3 + column, len(lines), 49):
                lines = with_cell(k, column, "over")(lines)
        for k in range(2, len(lines), 98):
            lines[k] = '"' + lines[k]
        for k in range(5, len(lines), 98):
            lines = with_cell(k, 0, "0")(lines)
        return lines

    rewrite(folder, spoiled)
    remarks = read_campaign(folder).remarks
    assert 5 < len(remarks) <= MAX_LINES and all(len(remark.sentence) < 200 for remark in remarks)


def test_commands_print_at_most_ten_remarks(folder, capsys):
    for number, run in enumerate(RUNS):
        for k in range(1, 5):
            rewrite(folder, with_cell(100 * k + number, k, f"over {number}"), run)
    print_remarks(Console(width=400), read_campaign(folder).remarks)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == MAX_LINES and lines[-1].startswith("and ")
    assert "`edhas campaign check` lists all" in lines[-1]


def test_impossible_values_are_missing(folder, valid):
    modify_table(folder, "run3.csv", lambda f: f.assign(**{"current [A]": 1e200 * f["current [A]"]}))
    modify_table(folder, "run4.csv", lambda f: f.assign(**{c: np.nan for c in f if not c.startswith("time")}))
    campaign = read_campaign(folder)
    assert [run.name for run in campaign.runs] == ["run3", "run8"] and "current" not in campaign.runs[0].signals
    assert main(["campaign", "check", str(folder)]) == 1
    sentences = [remark.sentence for remark in campaign.remarks]
    assert "current: 1351 values beyond 1e+30 A; taken as missing" in sentences
    assert "voltage: there is not a single value; it is missing in this run" in sentences
    assert "none of its columns can be used; the run is left out" in sentences


def test_a_campaign_without_a_value_is_refused(folder, capsys):
    for run in RUNS:
        modify_table(folder, run, lambda f: f.assign(**{c: np.nan for c in f if not c.startswith("time")}))
    for command in ("check", "compare", "fit"):
        arguments = ["campaign", "check"] if command == "check" else [command]
        assert main([*arguments, str(folder)]) == 2
        assert "there is not a single value" in (lines := capsys.readouterr().err.splitlines())[0]
        assert len(lines) <= MAX_LINES and lines[-1].endswith("no run can be used")


def damaged(content, how):
    middle = len(content) // 2
    flipped = bytes([content[middle] ^ 0xFF])
    return {"cut": content[:middle], "flipped": content[:middle] + flipped + content[middle + 1 :],
            "header only": content[:130], "empty": b""}[how]  # fmt: skip


@pytest.mark.parametrize("how", ["cut", "flipped", "header only", "empty"])
def test_damaged_binary_files(folder, how):
    frame = pd.read_csv(folder / "run3.csv")
    vectors = {cell.partition(" ")[0]: frame[cell].to_numpy() for cell in frame}
    savemat(folder / "run3.mat", vectors | {"units": {"time": "ms"}}, do_compression=True)
    pq.write_table(pa.Table.from_pandas(frame), folder / "run4.parquet", write_page_checksum=True)
    for name, run in (("run3.mat", "run3.csv"), ("run4.parquet", "run4.csv")):
        (folder / name).write_bytes(damaged((folder / name).read_bytes(), how))
        replace_in_yaml(folder, run, name)
    campaign = read_campaign(folder)
    sentences = {remark.file.suffix: remark.sentence for remark in campaign.remarks}
    assert sentences[".mat"] == "is damaged or not a MATLAB file; the run is left out"
    assert sentences[".parquet"] == "is damaged or not a Parquet file; the run is left out"


def test_a_unit_in_the_code_of_windows(folder, valid):
    frame = pd.read_csv(folder / "run3.csv")
    units = [cell.partition("[")[2].rstrip("]").encode() for cell in frame]
    units[3] = b"\xb5m"  # µm in the code of Windows
    fields = [
        pa.field(cell.partition(" ")[0], pa.float64(), metadata={b"unit": unit})
        for cell, unit in zip(frame, units, strict=True)
    ]
    columns = [pa.array(frame[cell]) for cell in frame]
    pq.write_table(pa.table(columns, schema=pa.schema(fields)), folder / "run3.parquet")
    replace_in_yaml(folder, "run3.csv", "run3.parquet")
    (run, *_), expected = read_campaign(folder).runs, valid.runs[0]
    assert np.allclose(1e3 * run.signals["piston_position"], expected.signals["piston_position"], rtol=1e-9)
