"""Thirty malformed files: what each got; all are refused with a sentence, or read with a remark."""

import numpy as np
import pandas as pd
import pytest

from edhas_jax.workbench.data_calculations import DataCalculations
from edhas_jax.workbench.workspace import Workspace, WorkspaceError
from tests.workbench.malformed_files import GOOD, MALFORMED


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
