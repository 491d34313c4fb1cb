"""Run files with faults: each costs as little data as possible, is named at its line, and takes few words."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rich.console import Console
from scipy.io import savemat

from edhas_jax.commands.cli import main
from edhas_jax.commands.console import print_data_check
from edhas_jax.measurements.campaign_reader import read_campaign
from tests.support.faulty_campaign import (
    RUNS,
    VALID_CAMPAIGN,
    copy_campaign,
    faults,
    modify_table,
    replace_in_yaml,
    rewrite,
    with_cell,
)

MAX_LINES = 10


@pytest.fixture(scope="module")
def valid():
    return read_campaign(VALID_CAMPAIGN)


@pytest.fixture()
def folder(tmp_path):
    return copy_campaign(tmp_path / "bench")


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
    print_data_check(Console(width=400), read_campaign(folder))
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
