"""Files of data loggers and spreadsheets: read by their content, or refused with the cause and the remedy."""

import re
import sys

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat

from edhas_jax.commands.cli import main
from edhas_jax.core.remark import Severity
from edhas_jax.measurements.campaign_reader import read_campaign
from tests.support.faulty_campaign import RUNS, VALID_CAMPAIGN, copy_campaign, faults, replace_in_yaml, rewrite


@pytest.fixture(scope="module")
def valid():
    return read_campaign(VALID_CAMPAIGN)


@pytest.fixture()
def folder(tmp_path):
    return copy_campaign(tmp_path / "bench")


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


@pytest.mark.parametrize("code", ["utf-8", "utf-16"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_file_without_a_line_end_loses_no_sample_and_is_noted_once(folder, valid, code, end):
    rewrite(folder, lambda lines: end.join(lines).encode(code))
    campaign = read_campaign(folder)
    same_signals(campaign.runs[0], valid.runs[0])
    (note,) = campaign.remarks
    assert note.severity is Severity.NOTE and note.line == len(valid.runs[0].time) + 1
    assert note.sentence.startswith("the last line has no line end; it is used")


def test_a_file_that_ends_within_a_line_is_truncated(folder, valid):
    rewrite(folder, lambda lines: "\n".join([*lines[:-1], lines[-1].rpartition(",")[0]]).encode())
    campaign = read_campaign(folder)
    (error,) = campaign.remarks
    assert error.severity is Severity.ERROR and error.sentence.endswith("to be truncated; line left out")
    assert len(campaign.runs[0].time) == len(valid.runs[0].time) - 1


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


def vectors_of(folder, run="run3.csv"):
    """Name, unit and values of each column of a run."""
    frame = pd.read_csv(folder / run)
    return [(cell.partition(" [")[0], cell.partition("[")[2].rstrip("]"), frame[cell].to_numpy()) for cell in frame]


def write_hdf5(folder, name, matlab: bool):
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / name, "w", userblock_size=512 if matlab else 0) as file:
        for column, unit, values in vectors_of(folder):
            file[column] = values[None, :] if matlab else values
            if matlab:
                file[f"units/{column}"] = np.array([[ord(c)] for c in unit], np.uint16)
            else:
                file[column].attrs["unit"] = unit
        file["comment"] = "cold oil"
    if matlab:
        with (folder / name).open("r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def write_tdms(folder, name, stamps: bool):
    nptdms = pytest.importorskip("nptdms")
    columns = {column: (unit, values) for column, unit, values in vectors_of(folder)}
    _, time = columns["time"]  # ms
    implied = {"wf_increment": 1e-3 * (time[1] - time[0]), "wf_start_offset": 1e-3 * time[0]}
    channels = [
        nptdms.ChannelObject("bench", column, values, {"unit_string": unit} | ({} if stamps else implied))
        for column, (unit, values) in columns.items()
        if stamps or column != "time"
    ]
    with nptdms.TdmsWriter(folder / name) as file:
        file.write_segment(channels)


def write_mdf(folder, name):
    asammdf = pytest.importorskip("asammdf")
    columns = {column: (unit, values) for column, unit, values in vectors_of(folder)}
    _, time = columns.pop("time")
    signals = [asammdf.Signal(v, 1e-3 * time, unit=unit, name=column) for column, (unit, v) in columns.items()]
    file = asammdf.MDF(version="4.10")
    file.append(signals)
    file.append(asammdf.Signal(np.arange(3.0), np.arange(3.0), unit="K", name="room"))
    file.save(folder / name, overwrite=True)
    file.close()


LOGGERS = {
    "MATLAB 7.3": (lambda folder: write_hdf5(folder, "run3.mat", True), "run3.mat"),
    "HDF5": (lambda folder: write_hdf5(folder, "run3.h5", False), "run3.h5"),
    "TDMS with time stamps": (lambda folder: write_tdms(folder, "run3.tdms", True), "run3.tdms"),
    "TDMS without": (lambda folder: write_tdms(folder, "run3.tdms", False), "run3.tdms"),
    "MDF": (lambda folder: write_mdf(folder, "run3.mf4"), "run3.mf4"),
}


@pytest.mark.parametrize(("write", "name"), LOGGERS.values(), ids=LOGGERS)
def test_files_of_channels(folder, valid, write, name):
    """The same signals as from text; a file that is cut is refused, and what it is, is said."""
    write(folder)
    replace_in_yaml(folder, "run3.csv", name)
    campaign = read_campaign(folder)
    assert [r.sentence for r in faults(campaign)] == (
        ["`room` has 3 samples where others have 1351; it is left out"] if name.endswith("mf4") else []
    )
    same_signals(campaign.runs[0], valid.runs[0])
    content = (folder / name).read_bytes()
    # what is left of a TDMS file that was cut is a shorter file, unless its header is cut
    kept = 20 if name.endswith("tdms") else len(content) // 3
    (folder / name).write_bytes(content[:kept])
    said = [r.sentence for r in read_campaign(folder).remarks]
    assert any(word in s for s in said for word in ("damaged", "missing", "at least 2 samples")), said


READERS = [("h5py", b"\x89HDF", "hdf5"), ("nptdms", b"TDSm", "tdms"), ("asammdf", b"MDF ", "mdf")]


@pytest.mark.parametrize(("module", "start", "extra"), READERS)
def test_channels_without_their_reader(folder, monkeypatch, module, start, extra):
    monkeypatch.setitem(sys.modules, module, None)
    rewrite(folder, lambda lines: start + b"....", name="run3.bin")
    (remark,) = read_campaign(folder).remarks
    assert f"pip install 'edhas_jax[{extra}]'" in remark.sentence and "CSV" in remark.sentence


def test_an_excel_file_without_its_reader(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    rewrite(folder, lambda lines: b"PK\x03\x04....", name="run3.xlsx")
    (remark,) = read_campaign(folder).remarks
    assert "save it as CSV, or install what reads it: pip install 'edhas_jax[excel]'" in remark.sentence


def decimal_commas(lines):
    return [lines[0]] + [line.replace(".", ",") for line in lines[1:]]


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
