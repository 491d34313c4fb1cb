"""Designs of experiments: grids, samples and files."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from edhas_jax.design.batch.design_table import read_design_table
from edhas_jax.design.batch.experiment_design import Axis, DesignError, full_factorial, latin_hypercube, sobol_sequence
from edhas_jax.machine.effects import LIBRARY
from edhas_jax.machine.rigs import PumpBench

CLEARANCE = Axis("piston_clearance", 5e-6, 40e-6, 4, log=True)
FREQUENCY = Axis("frequency", values=(5.0, 10.0, 30.0))


@pytest.fixture(scope="module")
def machine():
    effects = {e.id: e for e in LIBRARY}
    return PumpBench(effects=(effects["piston_leakage"](), effects["lugre_friction"]()))


def test_a_grid_has_every_combination():
    table = full_factorial([CLEARANCE, FREQUENCY])
    assert list(table) == ["piston_clearance", "frequency"]
    assert len(set(zip(*table.values(), strict=True))) == 12
    np.testing.assert_array_equal(table["frequency"][:4], [5.0, 10.0, 30.0, 5.0])
    np.testing.assert_allclose(table["piston_clearance"][::3], [5e-6, 1e-5, 2e-5, 4e-5])
    assert table["piston_clearance"][0] == 5e-6 and table["piston_clearance"][-1] == 40e-6


def test_a_latin_hypercube_has_one_design_in_each_part_of_each_axis():
    axes = [Axis("frequency", 5.0, 30.0), Axis("piston_clearance", 1e-6, 1e-4, log=True)]
    table = latin_hypercube(axes, 50, seed=3)
    part = np.floor((table["frequency"] - 5.0) / 25.0 * 50).astype(int)
    assert sorted(part) == list(range(50))
    part = np.floor(np.log(table["piston_clearance"] / 1e-6) / np.log(100.0) * 50).astype(int)
    assert sorted(part) == list(range(50))
    same_seed, other_seed = latin_hypercube(axes, 50, 3), latin_hypercube(axes, 50, 4)
    np.testing.assert_array_equal(table["frequency"], same_seed["frequency"])
    assert (table["frequency"] != other_seed["frequency"]).any()


@pytest.mark.filterwarnings("error")
def test_a_longer_sobol_sequence_begins_with_the_shorter_one():
    axes = [Axis("frequency", 5.0, 30.0), Axis("piston_diameter", values=(0.01, 0.012))]
    short, long = sobol_sequence(axes, 10, 1), sobol_sequence(axes, 100, 1)
    for name in short:
        np.testing.assert_array_equal(short[name], long[name][:10])
    assert set(long["piston_diameter"]) == {0.01, 0.012}
    assert long["frequency"].min() >= 5.0 and long["frequency"].max() <= 30.0
    lower_half = sobol_sequence(axes, 64, 1)["frequency"] < 17.5
    assert lower_half.sum() == 32
    assert len(sobol_sequence(axes, 1, 0)["frequency"]) == 1


def test_invalid_axes_are_refused():
    for generate in (
        lambda: Axis("a", 2.0, 1.0), lambda: Axis("a", 1.0, 1.0), lambda: Axis("a", 0.0, 1.0, log=True),
        lambda: Axis("a", values=(1.0, 1.0)), lambda: full_factorial([]),
        lambda: full_factorial([Axis("a", 0.0, 1.0, 1)]),
        lambda: full_factorial([FREQUENCY, FREQUENCY]), lambda: sobol_sequence([FREQUENCY], 0),
        lambda: full_factorial([Axis("a", 0.0, 1.0, 10**5), Axis("b", 0.0, 1.0, 10**5)]),
    ):  # fmt: skip
        with pytest.raises(DesignError):
            generate()


def test_csv_and_parquet_give_the_same_designs(machine, tmp_path):
    (tmp_path / "a.csv").write_text("piston_clearance [um], lugre_friction.coulomb_friction [N]\n20,4\n15,3\n")
    table = read_design_table(tmp_path / "a.csv", machine)
    assert table["piston_clearance"][0] == 20e-6 and list(table) == ["piston_clearance", "coulomb_friction"]
    frame = pd.DataFrame({"piston_clearance [um]": [20.0, 15.0], "coulomb_friction [N]": [4, 3]})
    frame.to_parquet(tmp_path / "b.parquet")
    other = read_design_table(tmp_path / "b.parquet", machine)
    fields = [pa.field(n, pa.float64(), metadata={"unit": u}) for n, u in (("piston_clearance", "m"),)]
    pq.write_table(pa.table([table["piston_clearance"]], schema=pa.schema(fields)), tmp_path / "c.parquet")
    third = read_design_table(tmp_path / "c.parquet", machine)
    for name in table:
        np.testing.assert_array_equal(table[name], other[name])
    np.testing.assert_array_equal(table["piston_clearance"], third["piston_clearance"])


def test_a_table_of_a_spreadsheet_gives_the_same_designs(machine, tmp_path):
    (tmp_path / "a.csv").write_text("piston_clearance [um],frequency [Hz]\n20,10\n12.5,8\n")
    (tmp_path / "b.csv").write_text("piston_clearance [um];frequency [Hz]\n20;10\n12,5;8\n")
    pd.DataFrame({"piston_clearance [um]": [20.0, 12.5], "frequency [Hz]": [10, 8]}).to_excel(
        tmp_path / "c.xlsx", index=False
    )
    one, *others = (read_design_table(tmp_path / name, machine) for name in ("a.csv", "b.csv", "c.xlsx"))
    for other in others:
        assert {n: v.tolist() for n, v in other.items()} == {n: v.tolist() for n, v in one.items()}


def test_one_design_is_a_table(machine, tmp_path):
    (tmp_path / "a.csv").write_text("piston_clearance [um]\n20\n")
    assert read_design_table(tmp_path / "a.csv", machine)["piston_clearance"].tolist() == [20e-6]


def test_parquet_with_missing_values_or_text_is_refused(machine, tmp_path):
    pd.DataFrame({"frequency [Hz]": [10.0, None]}).to_parquet(tmp_path / "a.parquet")
    with pytest.raises(DesignError, match="a.parquet:2: `frequency .Hz.`: a number is missing"):
        read_design_table(tmp_path / "a.parquet", machine)
    pd.DataFrame({"frequency [Hz]": ["x"]}).to_parquet(tmp_path / "b.parquet")
    with pytest.raises(DesignError, match="column `frequency .Hz.` does not hold numbers"):
        read_design_table(tmp_path / "b.parquet", machine)
    (tmp_path / "c.parquet").write_bytes(b"PAR1 not really")
    with pytest.raises(DesignError, match="damaged"):
        read_design_table(tmp_path / "c.parquet", machine)
    with pytest.raises(DesignError, match="no such file"):
        read_design_table(tmp_path / "d.csv", machine)
