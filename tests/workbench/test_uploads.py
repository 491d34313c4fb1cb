"""Thirty malformed files: what each got; all are refused with a sentence, or read with a remark."""

import numpy as np
import pandas as pd
import pytest

from edhas_jax.workbench.data_calculations import DataCalculations
from edhas_jax.workbench.workspace import Workspace, WorkspaceError

GOOD = "time [s],current [A]\n" + "".join(f"{1e-3 * k:.3f},{np.sin(k):.4f}\n" for k in range(30))
# content by name, and a part of the sentence; None: it is read
MALFORMED = {
    "empty.csv": (b"", "is empty"),
    "blank.csv": (b"\n\n  \n", "is empty"),
    "zeros.csv": (b"\x00" * 500, "is not a text file"),
    "noise.csv": (bytes(range(256)) * 8, "is not a text file"),
    "picture.csv": (b"\x89PNG\r\n\x1a\n" + bytes(200), "is not a text file"),
    "paper.csv": (b"%PDF-1.7\n1 0 obj", "is a PDF file"),
    "packed.csv": (b"\x1f\x8b\x08" + bytes(60), "is compressed with gzip"),
    "labview.csv": (b"TDSm" + bytes(60), "TDMS"),
    "new.mat": (b"\x89HDF\r\n\x1a\n" + bytes(60), "HDF5"),
    "old.xls": (b"\xd0\xcf\x11\xe0" + bytes(60), "Excel 97"),
    "cut.xlsx": (b"PK\x03\x04" + bytes(60), ""),
    "cut.parquet": (b"PAR1" + bytes(60), ""),
    "cut.mat": (b"MATLAB 5.0 MAT-file" + bytes(60), ""),
    "empty.parquet": (b"", ""),
    "words.csv": (b"time [s],current [A]\n" + b"a,b\n" * 30, "no table of numbers"),
    "names only.csv": (b"time [s],current [A]\n", "no table of numbers"),
    "one sample.csv": (b"time [s],current [A]\n0,1\n", ""),
    "no names.csv": (b"0,1\n" * 30, "no names"),
    "twice.csv": (b"time [s],time [s]\n" + b"0,1\n" * 30, "several columns"),
    "more values than names.csv": (GOOD.replace("\n", ",7\n").replace("],7", "]").encode(), None),
    "decimal commas.csv": (b"time [s],current [A]\n" + b"0,1,0,2\n" * 30, "decimal commas"),
    "page.csv": (b"<html><script>alert(1)</script></html>", ""),
    "object.csv": (b'{"time": [1, 2]}', ""),
    "quote.csv": (GOOD.replace("0.005", '"0.005').encode(), None),
    "cut line.csv": (GOOD.rstrip("\n").encode()[:-4], None),
    "infinite.csv": (GOOD.replace("0.8415", "inf").encode(), None),
    "huge.csv": (GOOD.replace("0.8415", "1e400").encode(), None),
    "holes.csv": (GOOD.replace("0.8415", "").encode(), None),
    "backwards.csv": (GOOD.replace("0.007", "0.001").encode(), None),
    "markup.csv": (GOOD.replace("current", "<img src=x onerror=alert(1)>").encode(), None),
    "wide text.csv": (b"\xff\xfe" + GOOD.encode("utf-16-le"), None),
}  # fmt: skip


def test_there_are_thirty():
    assert len(MALFORMED) >= 30


@pytest.mark.parametrize("name", MALFORMED)
def test_a_malformed_file_is_refused_with_a_sentence_or_read(name, tmp_path):
    content, expected = MALFORMED[name]
    (tmp_path / name).write_bytes(content)
    calculations = DataCalculations(Workspace(tmp_path), lambda sentence: None)
    if expected is None:
        found = calculations.table(name, "actuator_bench", 500)
        assert found["samples"] >= 28 and len(found["columns"]) == 2
        return
    with pytest.raises(WorkspaceError) as refused:
        calculations.table(name, "actuator_bench", 500)
    text = str(refused.value)
    assert name in text and expected in text and len(text) < 1000 and "Traceback" not in text


def write_mf4(table, path):
    asammdf = pytest.importorskip("asammdf")
    file = asammdf.MDF(version="4.10")
    file.append(asammdf.Signal(table["Strom [A]"].to_numpy(), table["time [s]"].to_numpy(), unit="A", name="Strom"))
    file.save(path)
    file.close()


def write_hdf5(table, path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name in table:
            file[name] = table[name].to_numpy()[None]


WRITERS = {
    ".xlsx": lambda table, path: table.to_excel(path, index=False),
    ".parquet": lambda table, path: table.to_parquet(path),
    ".mf4": write_mf4,
    ".h5": write_hdf5,
}


@pytest.mark.parametrize("suffix", WRITERS)
def test_tables_of_other_programs_are_read(suffix, tmp_path):
    table = pd.DataFrame({"time [s]": 1e-3 * np.arange(30), "Strom [A]": np.sin(np.arange(30.0))})
    path = tmp_path / f"run{suffix}"
    WRITERS[suffix](table, path)
    found = DataCalculations(Workspace(tmp_path), lambda sentence: None).table(path.name, "actuator_bench", 500)
    assert sorted(column["signal"] for column in found["columns"]) == ["", "current"]


def test_a_path_outside_the_folder_is_refused(tmp_path):
    (tmp_path / "inside").mkdir()
    (tmp_path / "run.csv").write_text(GOOD)
    with pytest.raises(WorkspaceError, match="lies outside"):
        DataCalculations(Workspace(tmp_path / "inside"), lambda sentence: None).table("../run.csv", "actuator_bench", 9)
