"""Tables in files of measured data: several rates, numbers, dates, layouts of loggers and of spreadsheets, sizes."""

import datetime
import zipfile

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat

from edhas_jax.config.tables import table as table_module
from edhas_jax.config.tables.table import Layout, TableError
from edhas_jax.config.tables.table_reader import read_table, read_tables
from edhas_jax.measurements.campaign import CampaignError
from edhas_jax.measurements.campaign_reader import read_campaign

DOT, COMMA = Layout(decimal="."), Layout(decimal=",")


def read(path, count=1, layout=Layout()):
    """The tables in a file; `count` of them, and nothing left out."""
    remarks = []
    tables = read_tables(path, remarks.append, layout)
    assert not remarks and len(tables) == count
    return tables


def columns(path, content, layout=Layout()):
    """The values of the columns of a text, by name."""
    path = path / "run.csv"
    path.write_text(content, encoding="utf-8")
    (table,) = read(path, 1, layout)
    assert not any(column.fault for column in table.columns.values())
    return {name: column.values.tolist() for name, column in table.columns.items()}


def fault(path, content, column, layout=Layout()):
    """Why a column of a text cannot be used, with its line."""
    path = path / "run.csv"
    path.write_text(content, encoding="utf-8")
    error = read_table(path, lambda remark: None, layout).columns[column].fault
    return f"{error.line}: {error}"


def refusal(path, layout=Layout()):
    with pytest.raises(TableError) as error:
        read_table(path, lambda remark: None, layout)
    return str(error.value)


def sheet(path, rows, title="Sheet"):
    """Write rows to a sheet of an Excel file."""
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.title = title
    for row in rows:
        book.active.append(row)
    book.save(path)
    return book


# --- several rates


def test_groups_of_channels_are_tables_with_their_own_time(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for group, step, count in (("fast", 1e-3, 100), ("slow/oil", 0.1, 5)):
            file[f"{group}/time"], file[f"{group}/p"] = step * np.arange(count), np.full(count, step)
            file[f"{group}/time"].attrs["unit"] = "s"
    fast, slow = read(tmp_path / "a.h5", 2)
    assert (fast.name, slow.name) == ("fast", "slow/oil")
    assert fast.own_name("fast/p") == fast.own_name("p") == "p" and slow.own_name("fast/p") is None
    assert slow.columns["time"].unit == "s" and slow.columns["time"].values == pytest.approx(0.1 * np.arange(5))
    remarks = []
    assert len(read_table(tmp_path / "a.h5", remarks.append).lines) == 100
    assert [r.sentence for r in remarks] == ["`p` has 5 samples where others have 100; it is left out"]


def test_groups_of_a_tdms_file_with_other_rates(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    channels = [
        nptdms.ChannelObject(group, "p", np.arange(float(count)), {"wf_increment": step})  # no wf_start_offset
        for group, step, count in (("fast", 1e-3, 100), ("slow", 0.5, 4))
    ]
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as file:
        file.write_segment(channels)
    fast, slow = read(tmp_path / "a.tdms", 2)
    assert fast.columns["time"].values[-1] == pytest.approx(0.099)
    assert list(slow.columns["time"].values) == [0.0, 0.5, 1.0, 1.5]


# --- separators of thousands


GROUPS = {
    "groups and decimals": ('t,p\n0.1,"1,096.1"\n0.2,"102.7"\n', [1096.1, 102.7], Layout()),
    "groups and other cells with decimals": ('t,p\n0.1,"1,096"\n0.2,"102.7"\n', [1096.0, 102.7], Layout()),
    "two groups": ("t;p\n0,1;1.096.100\n0,2;101.234\n", [1096100.0, 101234.0], Layout()),
    "two groups beside points": ("t;p\n0.1;1.096.100\n0.2;101.234\n", [1096100.0, 101234.0], Layout()),
    "decimal commas with groups": ("t;p\n0,1;1.096,5\n0,2;-3,25\n", [1096.5, -3.25], Layout()),
    "spaces": ("t;p\n0,1;1 096,5\n0,2;12 003 096,5\n", [1096.5, 12003096.5], Layout()),
    "apostrophes": ("t;p\n0.1;1'096.5\n0.2;3.5\n", [1096.5, 3.5], Layout()),
    "zero before the mark": ("t;p\n0,1;0.234\n0,2;1.234\n", [0.234, 1.234], Layout()),
    "other digits than groups have": ("t;p\n0,1;1.096\n0,2;1.0961\n", [1.096, 1.0961], Layout()),
    "decimals of three digits alone": ("t;p\n0.1;1.096\n0.2;2.096\n", [1.096, 2.096], Layout()),
    "decimal commas of three digits": ("t;p\n0,1;1,096\n0,2;2,096\n", [1.096, 2.096], Layout()),
    "stated decimal comma": ("t;p\n0,1;101.234\n0,2;102.234\n", [101234.0, 102234.0], COMMA),
    "stated decimal point": ("t;p\n1;101,234\n2;102,234\n", [101234.0, 102234.0], DOT),
}  # fmt: skip


@pytest.mark.parametrize(("content", "values", "layout"), GROUPS.values(), ids=GROUPS)
def test_separators_of_thousands(tmp_path, content, values, layout):
    assert columns(tmp_path, content, layout)["p"] == values


UNCLEAR = {
    "points among decimal commas": "t;p\n0,1;101.234\n0,2;102.234\n",
    "commas among decimal points": 't,p\n0.1,"101,234"\n0.2,"102,234"\n',
    "commas alone": "t;p\n1;101,234\n2;102,234\n",
}


@pytest.mark.parametrize("content", UNCLEAR.values(), ids=UNCLEAR)
def test_what_may_be_thousands_or_decimals_is_asked(tmp_path, content):
    said = fault(tmp_path, content, "p")
    assert said.startswith('2: `p`: "101') and " is 101234.0 or 101.234; " in said
    assert '`decimal: "."` or `decimal: ","` in campaign.yaml' in said
    assert read_table(tmp_path / "run.csv", lambda remark: None).columns["t"].fault is None


def test_many_cells_that_fail_alike_are_a_fault(tmp_path):
    rows = "".join(f"{k},{k}.5 V\n" for k in range(40))
    said = fault(tmp_path, "t,u\n0,1\n" + rows, "u")
    assert said == '3: `u`: "0.5 V" is not a number (and 39 more in this column); write numbers without their unit'
    rows = "".join(f"{k}.5;1.00{k % 9},5\n" for k in range(40))
    said = fault(tmp_path, "t;u\n" + rows, "u", DOT)
    assert said.startswith('2: `u`: "1.000,5" is not a number (and 39') and 'write `decimal: ","`' in said


def test_words_are_missing_values(tmp_path):
    (tmp_path / "run.csv").write_text("t,u\n" + "".join(f"{k},{'OVR' if k % 2 else k}\n" for k in range(40)))
    remarks = []
    column = read_table(tmp_path / "run.csv", remarks.append).columns["u"]
    assert column.fault is None and np.isnan(column.values[1]) and column.values[2] == 2.0
    (remark,) = remarks
    assert remark.sentence == '`u`: "OVR" is not a number (and 19 more in this column); taken as missing'


# --- dates and clock times


CLOCKS = {
    "ISO": ["2024-03-11 09:51:40.000", "2024-03-11 09:51:40.005", "2024-03-12T09:51:40"],
    "universal time": ["2024-03-11T08:51:40Z", "2024-03-11T09:51:40.005+01:00", "2024-03-12T08:51:40Z"],
    "German": ["11.03.2024 09:51:40,000", "11.03.2024 09:51:40,005", "12.03.2024 09:51:40,000"],
    "American": ["3/11/2024 9:51:40.000 AM", "3/11/2024 9:51:40.005 AM", "3/12/2024 9:51:40 AM"],
    "the order that makes the record short": ["11/03/2024 09:51:40", "11/03/2024 09:51:40.005", "12/03/2024 09:51:40"],
    "names of months": ["11-Mar-2024 12:51:40 PM", "11-Mar-2024 12:51:40.005 PM", "12-Mar-2024 12:51:40 PM"],
}  # fmt: skip


@pytest.mark.parametrize("stamps", CLOCKS.values(), ids=CLOCKS)
def test_dates_are_seconds_since_the_first(tmp_path, stamps):
    found = columns(tmp_path, "time;p\n" + "".join(f"{stamp};{k}\n" for k, stamp in enumerate(stamps)))
    assert found["time"] == pytest.approx([0.0, 0.005, 86400.0], abs=1e-9) and found["p"] == [0.0, 1.0, 2.0]


def test_clock_times_pass_midnight_and_keep_a_jump(tmp_path):
    times = ["23:59:59.5", "00:00:00.5", "01:59:00", "01:00:00"]  # the clock is set back by an hour
    found = columns(tmp_path, "Uhrzeit [hh:mm:ss],p\n" + "".join(f"{time},1\n" for time in times))
    assert found["Uhrzeit"] == pytest.approx([0.0, 1.0, 7140.5, 3600.5])
    assert columns(tmp_path, "t,p\n59:58.5,1\n59:59.75,2\n")["t"] == pytest.approx([0.0, 1.25])


def test_dates_in_cells_of_excel_and_in_columns_of_parquet(tmp_path):
    first = datetime.datetime(2024, 3, 11, 9, 51, 40)
    stamps = [first + datetime.timedelta(milliseconds=5 * k) for k in range(4)]
    sheet(tmp_path / "a.xlsx", [["time", "p [bar]"], *([stamp, 1.5] for stamp in stamps)])
    pq.write_table(pa.table({"time": stamps, "p [bar]": [1.5] * 4}), tmp_path / "a.parquet")
    for name in ("a.xlsx", "a.parquet"):
        (table,) = read(tmp_path / name)
        assert table.columns["time"].unit == "s"
        assert table.columns["time"].values == pytest.approx([0.0, 0.005, 0.01, 0.015])


# --- sheets


def test_merged_cells_and_units_below_the_names(tmp_path):
    rows = [["Valve bench 3"], ["Operator", "NN"], [], ["Zeit", "Ventil", "Druck", None, "Rate", "Flow"],
            [None, "Soll", "P1", "P2", "max", "max"], ["s", "V", "bar", "bar", "rpm", "L/min"]]  # fmt: skip
    book = sheet(tmp_path / "a.xlsx", rows + [[0.1 * k, 1, 2, 3, 4, 5] for k in range(4)])
    book.active.merge_cells("C4:D4")
    book.save(tmp_path / "a.xlsx")
    (table,) = read(tmp_path / "a.xlsx")
    assert {name: column.unit for name, column in table.columns.items()} == {
        "Zeit": "s", "Soll": "V", "P1": "bar", "P2": "bar", "Rate/max": "rpm", "Flow/max": "L/min"
    }  # fmt: skip


def test_the_first_sheet_with_a_table_or_the_stated_one(tmp_path):
    book = sheet(tmp_path / "a.xlsx", [["see sheet Data"]], "Info")
    for title, value in (("Data", 1.0), ("Later", 2.0)):
        book.create_sheet(title)
        for row in [["time [s]", "p [bar]"], [0.0, value], [1.0, value]]:
            book[title].append(row)
    book.save(tmp_path / "a.xlsx")
    assert read(tmp_path / "a.xlsx")[0].columns["p"].values[0] == 1.0
    assert read(tmp_path / "a.xlsx", layout=Layout(sheet="Later"))[0].columns["p"].values[0] == 2.0
    assert refusal(tmp_path / "a.xlsx", Layout(sheet="data")) == "has no sheet `data`; its sheets: Info, Data, Later"


def test_a_cell_far_away_is_a_note_and_text_has_thousands(tmp_path):
    book = sheet(tmp_path / "a.csv.xlsx", [["time [s]", "p [kPa]"], [0, "1,096.1"], [1, "102.7"]])
    book.active.cell(1_048_576, 16_384, "see sheet 2")
    book.save(tmp_path / "a.xlsx")
    (tmp_path / "a.xlsx").rename(tmp_path / "a.csv")  # the content counts
    (table,) = read(tmp_path / "a.csv")
    assert table.columns["p"].values.tolist() == [1096.1, 102.7]


# --- LabVIEW


def lvm(head, *segments):
    head = ["LabVIEW Measurement\t", "Writer_Version\t2", "Separator\tTab", *head, "***End_of_Header***\t", ""]
    return "\n".join(["\n".join(head), *("\n".join([*lines, ""]) for lines in segments)])


def segment(channels, rows, **entries):
    header = [f"Channels\t{channels}"] + [f"{key}\t" + "\t".join([value] * channels) for key, value in entries.items()]
    return [*header, "***End_of_Header***\t", *rows]


def test_labview_text_with_x_values_and_comments(tmp_path):
    rows = ["X_Value\tSoll\tDruck\tComment", "0,000\t1,5\t2,5\tstart", "0,001\t1,5\t2,5", "0,002\t1,5\t3,5\t"]
    content = lvm(["Decimal_Separator\t,", "X_Columns\tOne"], segment(2, rows, Y_Unit_Label="V", X_Dimension="Time"))
    found = columns(tmp_path, content)
    assert found == {"X_Value": [0.0, 0.001, 0.002], "Soll": [1.5] * 3, "Druck": [2.5, 2.5, 3.5]}
    (table,) = read(tmp_path / "run.csv")
    assert table.columns["X_Value"].unit == "s" and table.columns["Druck"].unit == "V" and table.lines[0] == 13


def test_labview_text_without_a_line_end(tmp_path):
    """A last line with all values is used; one that ends before the last value is left out."""
    rows = ["X_Value\tu\tp\tComment", "0.0\t1.0\t2.5\tstart", "0.5\t1.5\t3.5"]
    whole = lvm(["X_Columns\tOne"], segment(2, rows)).rstrip("\n")
    for text, expected, sentence in (
        (whole, [1.0, 1.5], "the last line has no line end; it is used"), (whole[:-4], [1.0], "line left out"),
    ):  # fmt: skip
        (tmp_path / "a.lvm").write_text(text)
        remarks = []
        if len(expected) == 1:  # too few for a table, but for the message
            with pytest.raises(TableError):
                read_tables(tmp_path / "a.lvm", remarks.append)
        else:
            (table,) = read_tables(tmp_path / "a.lvm", remarks.append)
            assert table.columns["u"].values.tolist() == expected
        (remark,) = remarks
        assert sentence in remark.sentence


def test_labview_text_without_x_values_in_several_segments(tmp_path):
    """The samples follow from X0 and Delta_X, those of a later segment from the time in its header."""
    rows, entries = ["X_Value\tu\tComment", "\t1.0", "\t2.0", "\t3.0"], {"X0": "0.0", "Delta_X": "0.5", "Samples": "3"}
    stamps = [{"Date": "2024/03/11", "Time": time} for time in ("09:51:40.25", "09:51:50.5")]
    found = columns(tmp_path, lvm(["X_Columns\tNo"], *(segment(1, rows, **entries, **stamp) for stamp in stamps)))
    assert found["X_Value"] == [0.0, 0.5, 1.0, 10.25, 10.75, 11.25] and found["u"] == [1.0, 2.0, 3.0] * 2
    entries["X0"] = "7.0"
    second = segment(1, rows, **entries)
    found = columns(tmp_path, lvm(["X_Columns\tNo"], segment(1, rows, **entries | {"X0": "0.0"}), second))
    assert found["X_Value"] == [0.0, 0.5, 1.0, 7.0, 7.5, 8.0]


def test_labview_text_with_x_values_of_each_channel(tmp_path):
    rows = ["X_Value\tu\tX_Value\tT\tComment", "0.0\t1.0\t0.0\t20.0", "0.5\t2.0\t10.0\t21.0", "1.0\t3.0\t\t"]
    (tmp_path / "a.lvm").write_text(lvm(["X_Columns\tMulti"], segment(2, rows)))
    fast, slow = read(tmp_path / "a.lvm", 2)
    assert {n: c.values.tolist() for n, c in fast.columns.items()} == {"X_Value": [0.0, 0.5, 1.0], "u": [1.0, 2.0, 3.0]}
    assert {n: c.values.tolist() for n, c in slow.columns.items()} == {"X_Value": [0.0, 10.0], "T": [20.0, 21.0]}


# --- MATLAB


def sign_as_matlab(path):
    """Write the head of MATLAB 7.3 into the user block of an HDF5 file."""
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_matrices_and_structures_of_matlab(tmp_path, version):
    time = 0.1 * np.arange(5)
    signals = [{"values": np.full((5, 1), 7.0), "label": "p"}, {"values": np.full((5, 2), 8.0)}]
    data = {"M": np.column_stack([time, 2 * time]), "out": {"time": time, "signals": {"values": 3 * time}}}
    if version == "5":
        data["log"] = {"time": time, "signals": np.array(signals, object)}
        data["units"] = {"M": np.array(["s", "bar"], object), "out": {"time": "ms"}}
        savemat(tmp_path / "a.mat", data)
    else:
        h5py = pytest.importorskip("h5py")
        with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
            file["M"], file["out/time"], file["out/signals/values"] = data["M"].T, time[None, :], 3 * time[None, :]
            file["units/out/time"] = np.array([[ord(c)] for c in "ms"], np.uint16)
        sign_as_matlab(tmp_path / "a.mat")
    (table,) = read(tmp_path / "a.mat")
    names = {"M.1", "M.2", "out.time", "out.signals.values"}
    more = {"log.time", "log.signals.1.values", "log.signals.2.values.1", "log.signals.2.values.2"}
    assert set(table.columns) == names | (more if version == "5" else set())
    assert np.array_equal(table.columns["M.2"].values, 2 * time) and table.columns["out.time"].unit == "ms"
    assert version == "7.3" or table.columns["M.2"].unit == "bar"


def test_objects_of_matlab_are_named_with_what_to_do(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
        file["t"], file["ts"] = np.arange(4.0), np.arange(6, dtype=np.uint32)
        file["ts"].attrs["MATLAB_object_decode"] = 3
    sign_as_matlab(tmp_path / "a.mat")
    remarks = []
    assert list(read_table(tmp_path / "a.mat", remarks.append).columns) == ["t"]
    assert "`ts` is an object of MATLAB" in remarks[0].sentence and "ts.Data" in remarks[0].sentence


# --- sizes, and other files


def test_what_a_file_unpacks_to_is_limited_before_it_is_read(tmp_path, monkeypatch):
    """Each file is small and would need more than the limit, here 8 MB."""
    monkeypatch.setattr(table_module, "MAX_BYTES", 8_000_000)
    monkeypatch.setattr("edhas_jax.config.tables.binary_tables.MAX_BYTES", 8_000_000)
    many = np.zeros(1_000_001)
    pq.write_table(pa.table({"time": many}), tmp_path / "a.parquet")
    savemat(tmp_path / "a.mat", {"x": many}, do_compression=True)
    savemat(tmp_path / "b.mat", {"s": {"x": many.astype(np.int8)}}, do_compression=True)
    (tmp_path / "a.csv").write_text("a,b\n" + "1,2\n" * 500_001)
    with zipfile.ZipFile(tmp_path / "a.xlsx", "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("xl/worksheets/sheet1.xml", b"0" * 8_000_008)
    names = ["a.parquet", "a.mat", "b.mat", "a.csv", "a.xlsx"]
    if (h5py := pytest.importorskip("h5py")) is not None:
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file.create_dataset("time", (1_000_001,), "f4", chunks=(1000,), compression="gzip")
        names.append("a.h5")
    for name in names:
        assert (tmp_path / name).stat().st_size < 4_000_000
        assert refusal(tmp_path / name).startswith("unpacks to more than 0.008 GB, the most that is read"), name


def test_numbers_in_other_files_are_not_read(tmp_path):
    h5py = pytest.importorskip("h5py")
    np.arange(100.0).tofile(tmp_path / "secret.bin")
    with h5py.File(tmp_path / "source.h5", "w") as file:
        file["x"] = np.arange(100.0)
    with h5py.File(tmp_path / "external.h5", "w") as file:
        file.create_dataset("t", (100,), "f8", external=[(str(tmp_path / "secret.bin"), 0, 800)])
    with h5py.File(tmp_path / "virtual.h5", "w") as file:
        layout = h5py.VirtualLayout((100,), "f8")
        layout[:] = h5py.VirtualSource(tmp_path / "source.h5", "x", (100,))
        file.create_virtual_dataset("units/t", layout)
    with h5py.File(tmp_path / "link.h5", "w") as file:
        file["g/t"] = h5py.ExternalLink(str(tmp_path / "source.h5"), "x")
        file["t"] = h5py.SoftLink("/g/t")
    for name, what in {"external": "`t` is kept in", "virtual": "`units/t` is a virtual", "link": "`g/t` is a"}.items():
        said = refusal(tmp_path / f"{name}.h5")
        assert said.startswith(what) and "no other file is read" in said
    with h5py.File(tmp_path / "inside.h5", "w") as file:
        file["x"] = np.arange(4.0)
        file["y"], file["loop"] = h5py.SoftLink("/x"), file["/"]
    assert set(read(tmp_path / "inside.h5")[0].columns) == {"x", "y"}


# --- campaigns


def campaign_of(folder, content, more="", run=""):
    folder.mkdir(exist_ok=True)
    (folder / "run.csv").write_text(content)
    (folder / "campaign.yaml").write_text(
        f"rig: actuator_bench\n{more}signals: {{current: {{unit: A, noise: 1}}}}\n"
        f"runs: [{{file: run.csv, use: fit, frequency: 20 Hz{run}}}]\n"
    )
    return folder


def test_a_campaign_says_what_stands_before_the_decimals(tmp_path):
    """The run is refused with a question; the answer holds for all files, or for a run."""
    content = "time [s];current [A]\n" + "".join(f"0,{k:02d};101.2{k:02d}\n" for k in range(20))
    with pytest.raises(CampaignError, match=r'run.csv:2: `current`: "101.200" is 101200.0 or 101.2; say what'):
        read_campaign(campaign_of(tmp_path / "a", content))
    for more, run in (('decimal: ","\n', ""), ("", ', decimal: ","'), ('decimal: "."\n', ', decimal: ","')):
        (read_run,) = read_campaign(campaign_of(tmp_path / "a", content, more, run)).runs
        assert read_run.signals["current"][1] == 101201.0 and read_run.time[-1] == pytest.approx(0.19)
    with pytest.raises(CampaignError, match=r'decimal: what stands .* belongs here, "." or ","; got ;'):
        read_campaign(campaign_of(tmp_path / "a", content, 'decimal: ";"\n'))


def test_samples_are_not_dropped_because_of_their_form(tmp_path):
    content = "time [s],current [A],supply\n" + "".join(f"0.{k:02d},{k} A,7\n" for k in range(20))
    with pytest.raises(CampaignError, match=r'run.csv:2: `current`: "0 A" is not a number \(and 19 more'):
        read_campaign(campaign_of(tmp_path / "a", content))
    content = content.replace(",7", ",7 V").replace(" A,", ",")  # a column that is not used
    assert len(read_campaign(campaign_of(tmp_path / "a", content)).runs[0].time) == 20
