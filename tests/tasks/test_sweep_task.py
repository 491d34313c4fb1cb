"""`edhas_jax.sweep`: an xarray Dataset with units, the same numbers as the command, saved and opened again."""

import json

import numpy as np
import pytest
import xarray as xr

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.config.machine_config import ConfigError
from edhas_jax.config.result_files import ResultFileError
from edhas_jax.design.batch.batch import BatchSettings
from edhas_jax.machine.effects import EntrainedAir
from edhas_jax.machine.parameters import ParameterError

BENCH = edhas.ActuatorBench()
SETTINGS = BatchSettings(step=1e-4, tolerance=1e-3, max_cycles=12)


@pytest.fixture(scope="module")
def swept():
    return edhas.sweep(
        BENCH, coil_resistance=("1 ohm", "2 ohm", 3), frequency=[8, "12 Hz"], mover_mass="130 g", settings=SETTINGS
    )


def test_a_dataset_with_units_and_coordinates(swept):
    assert isinstance(swept, xr.Dataset) and dict(swept.sizes) == {"coil_resistance": 3, "frequency": 2}
    np.testing.assert_allclose(swept.coil_resistance, [1.0, 1.5, 2.0])
    assert swept.coil_resistance.attrs["units"] == "ohm" and swept.rms_current.attrs["units"] == "A"
    assert swept.rms_current.attrs["long_name"] == "rms current" and (swept.status == "ok").all()
    assert len(swept.to_dataframe()) == 6
    assert "mover_mass: 130 g" in swept.attrs["machine"] and swept.attrs["edhas_jax"] == edhas.__version__


def test_the_numbers_are_those_of_the_command(swept, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.yaml").write_text(
        "machine: {rig: actuator_bench, parameters: {mover_mass: 130 g}}\n"
        "sweep: {kind: grid, parameters: {coil_resistance: {from: 1 ohm, to: 2 ohm, count: 3}, "
        "frequency: [8 Hz, 12 Hz]}}\nbatch: {step: 100 us, tolerance: 0.1 %, max_cycles: 12}\n"
    )
    assert main(["sweep", "s.yaml", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["statuses"] == [
        {"status": "ok", "designs": 6, "meaning": "periodic, within the model's validity"}
    ]
    assert printed["next"] == "edhas plot sweep runs/s"
    again = edhas.open_result("runs/s")
    xr.testing.assert_equal(again.drop_attrs(), swept.drop_attrs())
    assert again.frequency.attrs["units"] == "Hz"
    in_folder = edhas.sweep("s.yaml", folder="runs/s")  # finished: nothing is computed
    xr.testing.assert_equal(in_folder.drop_attrs(), swept.drop_attrs())


def test_saved_and_opened_again(swept, tmp_path):
    path = swept.save(tmp_path / "swept.nc")
    again = edhas.open_result(path)
    xr.testing.assert_identical(again, swept)
    assert str(again.summary()) == str(swept.summary())
    with pytest.raises(ResultFileError, match="exists already"):
        swept.save(path)
    swept.save(path, overwrite=True)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(ResultFileError, match="cannot be read"):
        edhas.open_result(path)


def test_pictures_and_summary(swept):
    assert "6 designs" in str(swept.summary()) and "ok" in str(swept.summary())
    assert "<table" in swept.summary()._repr_html_()
    figure = swept.plot_heat("rms_current", x="frequency", y="coil_resistance")
    assert "rms current over frequency and coil resistance" in figure.get_suptitle()
    assert swept.plot_parallel("rms_current").axes and swept.sel(frequency=8.0).summary().title.count("3 designs")


def test_an_efficiency_has_the_unit_that_a_run_shows():
    pump = edhas.PumpBench(effects=(EntrainedAir(),))
    swept = edhas.sweep(pump, frequency=[10.0], settings=BatchSettings(step=1e-4, max_cycles=12))
    rows = {row[0]: row[2] for row in swept.summary().tables["ranges"].rows}
    for name in ("overall_efficiency", "volumetric_efficiency"):
        number, unit = rows[name].split()
        assert unit == "%" and float(number) == pytest.approx(100.0 * swept[name].item(), rel=1e-3)
    assert rows["amplitude_ratio"] == f"{swept['amplitude_ratio'].item():.4g}"


def test_samples_have_one_dimension():
    sampled = edhas.sweep(BENCH, coil_resistance=(1.0, 2.0), frequency=("8 Hz", "12 Hz"), samples=5, settings=SETTINGS)
    assert dict(sampled.sizes) == {"design": 5} and sampled.frequency.dims == ("design",)
    assert np.isfinite(sampled.rms_current).all() and sampled.plot_pareto(("rms_current:min", "phase_lag:min")).axes


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"coil_resistence": (1.0, 2.0, 3)}, "coil_resistance"),
        ({"coil_resistance": ("1 m", "2 ohm", 3)}, "coil_resistance.from"),
        ({"coil_resistance": (2.0, 1.0, 3)}, "is empty"),
        ({"coil_resistance": (1.0, 2.0)}, "count"),
        ({"frequency": [8, 8]}, "listed twice"),
        ({"frequency": [8], "mover_mass": "2 kN"}, "mover_mass"),
        ({}, "at least one parameter"),
    ],
)
def test_wrong_parameters_are_named(parameters, message):
    with pytest.raises((ConfigError, ParameterError), match=message):
        edhas.sweep(BENCH, **parameters)


def test_a_design_that_fails_has_no_metrics():
    swept = edhas.sweep(BENCH, supply_voltage=[0.05, 48.0], frequency=10.0, settings=SETTINGS)
    assert list(swept.status.values) == ["stalled", "ok"]
    assert np.isnan(swept.rms_current[0]) and np.isfinite(swept.rms_current[1])
