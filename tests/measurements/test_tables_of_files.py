"""Tables in files of measured data: several rates, numbers, dates, layouts of loggers and of spreadsheets."""

import numpy as np
import pytest

from edhas_jax.measurements.tables.table_reader import read_table, read_tables


def read(path, count=1):
    """The tables in a file; `count` of them, and nothing left out."""
    remarks = []
    tables = read_tables(path, remarks.append)
    assert not remarks and len(tables) == count
    return tables


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
    assert [r.sentence for r in remarks] == ["`p`, `time` have 5 samples where others have 100; they are left out"]


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
