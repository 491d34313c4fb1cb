"""Inputs that would take all memory or never end are refused at once, with a sentence that says what is allowed."""

import base64
import os
import zlib

import numpy as np
import pytest

from edhas_jax.commands.cli import main
from edhas_jax.config.recorded_signal import MAX_SAMPLES
from edhas_jax.config.run_settings import MAX_SAMPLES as MAX_RUN_SAMPLES
from edhas_jax.config.yaml_with_lines import MAX_BYTES, MAX_DEPTH, MAX_VALUES
from edhas_jax.core import runtime
from edhas_jax.core.units import MAX_UNIT_LENGTH, UnitError, to_si
from edhas_jax.design.batch.experiment_design import MAX_DESIGNS, first_repeated
from edhas_jax.design.sweep.dask_cluster import MAX_WORKERS_PER_CORE
from tests.support import ROOT

BENCH = "rig: actuator_bench\n"


@pytest.fixture
def refused(tmp_path, monkeypatch, capsys):
    """`refused(text, command)`: the one sentence with which a command refuses a file `given.yaml` with this text."""
    monkeypatch.chdir(tmp_path)

    def refuse(text, command="parameters given.yaml"):
        if text is not None:
            (tmp_path / "given.yaml").write_text(text)
        assert main(command.split()) == 2
        return capsys.readouterr().err

    return refuse


def recorded(values):
    samples = base64.b64encode(zlib.compress(values, 1)).decode()
    return BENCH + f'reference: {{kind: recorded, interval: 1 ms, samples: "{samples}"}}\n'


def test_samples(refused):
    error = refused(recorded(bytes(8 * MAX_SAMPLES + 8)))
    assert "reference.samples: there are more than 20,000,000 of them, which is the most allowed" in error
    damaged = zlib.compress(np.zeros(100).tobytes())[:-1]
    text = recorded(b"").replace(base64.b64encode(zlib.compress(b"", 1)).decode(), base64.b64encode(damaged).decode())
    assert "not as a run writes them" in refused(text)


@pytest.mark.parametrize(
    "unit",
    [
        "um*9**9**9", "um*9^9^9", "um*9⁹⁹⁹⁹⁹⁹⁹⁹", "um*(9^9)^9^9", "um^(9**9**9)", "um^999999999", "um*10**-9**9",
        "um*9 ** 9 ** 9", "um*(99999999)^99", "um+" * 5000 + "um", "(" * 5000, "um*９**９**９", "um*9_9**9_9**9_9",
        "um**-(9)**9**9",
    ],
)  # fmt: skip
def test_units_are_not_computed(unit):
    with pytest.raises(UnitError) as caught:
        to_si(f"2 {unit}", "m")
    assert "powers of names up to 99" in str(caught.value) and "any unit of length" in str(caught.value)
    assert len(str(caught.value)) < 500


def test_usual_units_are_understood():
    usual = {
        "m^3/(s*Pa)": 1.0, "L/(min·MPa)": 1 / 6e10, "N/(m/s)^2": 1.0, "µm²": 1e-12, "kg m^-1 s^-1": 1.0,
        "Hz^(1/2)": 1.0, "mm**2": 1e-6, "m/s⁻²": 1.0, "m^0.5": 1.0,
    }  # fmt: skip
    si = {"L/(min·MPa)": "m^3/(s*Pa)", "µm²": "m^2", "kg m^-1 s^-1": "Pa*s", "mm**2": "m^2", "m/s⁻²": "m*s^2"}
    for unit, size in usual.items():
        assert to_si(f"1 {unit}", si.get(unit, unit)) == pytest.approx(size)


def test_a_unit_in_a_file(refused):
    error = refused(BENCH + "parameters: {mover_mass: 1 kg*9**9**9}\n")
    assert "given.yaml:2: parameters.mover_mass:" in error and "no powers of numbers" in error


@pytest.mark.parametrize("command", ["parameters given.yaml", "sweep given.yaml", "size given.yaml", "compare ."])
def test_large_yaml(refused, tmp_path, command):
    many = "a:\n" + "- {b: 1, c: 2}\n" * (MAX_VALUES // 4)
    if command.startswith("compare"):
        (tmp_path / "campaign.yaml").write_text(many)
        error = refused(None, command)
    else:
        error = refused(many, command)
    assert f"too large; at most {MAX_VALUES:,} keys and values" in error and len(error.splitlines()) == 1


@pytest.mark.parametrize("levels", [MAX_DEPTH + 1, 100_000])
@pytest.mark.parametrize("brackets", ["[]", "{}"])
def test_deep_yaml(refused, levels, brackets):
    text = BENCH + "effects: " + "".join(brackets[0] * levels) + brackets[1] * levels + "\n"
    assert f"given.yaml:2: nested too deeply; at most {MAX_DEPTH} levels" in refused(text)


def test_many_problems(refused):
    error = refused(BENCH + "".join(f"key{i}: 1\n" for i in range(2000)))
    assert len(error.splitlines()) == 51 and "and 1,950 more problems like these" in error


def test_aliases(refused):
    text = "a: &a [x, x]\n" + "".join(f"{chr(98 + i)}: &{chr(98 + i)} [*{chr(97 + i)}]\n" for i in range(20))
    assert "given.yaml:2: an alias (*a) is not supported" in refused(text)


def test_a_file_larger_than_any_configuration(refused, tmp_path):
    with (tmp_path / "given.yaml").open("wb") as file:
        file.truncate(300_000_000)  # takes no space on the disk
    assert "given.yaml: has 300 MB; at most 250 MB are read" in refused(None)


@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "socket"])
@pytest.mark.parametrize("command", ["parameters given", "sweep given", "campaign check .", "sensitivity given"])
def test_what_is_no_file_is_not_waited_for(refused, tmp_path, kind, command):
    path = tmp_path / ("campaign.yaml" if command.startswith("campaign") else "given")
    make_special_file(path, kind)
    assert f"{path.name}: is a {kind}, not a file" in refused(None, command)


def make_special_file(path, kind):
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "folder":
        path.mkdir()
    else:
        import socket

        here = os.getcwd()
        os.chdir(path.parent)  # the name of a socket is short
        socket.socket(socket.AF_UNIX).bind(path.name)
        os.chdir(here)


@pytest.mark.parametrize("name", ["manifest.json", "table.parquet", "designs.parquet"])
def test_pipes_in_the_folder_of_a_sweep(refused, tmp_path, name):
    folder = tmp_path / "swept"
    (folder / "chunks").mkdir(parents=True)
    state = "finished" if name == "table.parquet" else "unfinished"
    (folder / "manifest.json").write_text(f'{{"format": 1, "hash": "", "identity": {{}}, "state": "{state}"}}')
    (folder / name).unlink(missing_ok=True)
    os.mkfifo(folder / name)
    os.mkfifo(folder / "chunks/000000.parquet")
    assert "pipe" in refused(None, "plot sweep swept")


def test_the_lock_of_a_sweep_is_no_link(refused, tmp_path):
    (tmp_path / "precious").write_text("precious")
    (tmp_path / "swept").mkdir()
    (tmp_path / "swept/.lock").symlink_to(tmp_path / "precious")
    text = f"machine: {{{BENCH.strip()}}}\nsweep: {{kind: grid, parameters: {{frequency: [5 Hz, 10 Hz]}}}}\n"
    assert "swept" in refused(text, "sweep given.yaml --out swept")
    assert (tmp_path / "precious").read_text() == "precious"


@pytest.mark.parametrize(
    ("axis", "message"),
    [
        ("{from: 5 Hz, to: 10 Hz, count: 1000000000000}", "a whole number from 2 to 10,000,000"),
        ("{from: 5 Hz, to: 10 Hz, count: 10000000}, mover_mass: {from: 0.1 kg, to: 1 kg, count: 10000000}", "at most"),
    ],
)
def test_designs(refused, axis, message):
    text = f"machine: {{{BENCH.strip()}}}\nsweep: {{kind: grid, parameters: {{frequency: {axis}}}}}\n"
    assert message in refused(text, "sweep given.yaml")


def test_many_values_of_an_axis():
    values = tuple(np.linspace(1.0, 2.0, 300_000))
    assert first_repeated(values) is None and first_repeated((*values, 2.0)) == 2.0


def test_samples_of_a_run(refused):
    error = refused(BENCH + "simulation: {duration: 1000 s, sample_rate: 10 MHz}\n")
    assert "a run has at most 5,000,000 samples; 10,000,000,000 are asked for" in error
    longer = "simulate given.yaml --set duration=0.6s --set sample_rate=10MHz"
    assert "at most 5,000,000 samples" in refused(BENCH, longer)


@pytest.mark.parametrize("text", ["100000", "0", "-1", "two", "²", "9" * 5000, "1.5"])
def test_cores(refused, monkeypatch, text):
    monkeypatch.setenv("EDHAS_CORES", text)
    error = refused(BENCH, "device")
    assert "EDHAS_CORES=" in error and "a whole number from 1 to 1024 belongs here" in error and len(error) < 200


def test_a_number_of_cores_that_is_allowed(monkeypatch):
    monkeypatch.setenv("EDHAS_CORES", " 3 ")
    assert runtime.cores() == 3


def test_workers(refused, monkeypatch):
    monkeypatch.setenv("EDHAS_CORES", "2")
    text = f"machine: {{{BENCH.strip()}}}\nsweep: {{kind: grid, parameters: {{frequency: [5 Hz, 10 Hz]}}}}\n"
    assert "at most 8 processes on the 2 cores" in refused(text, "sweep given.yaml --cluster local:9999")


def test_the_page_states_the_limits():
    page = (ROOT / "docs/configuration.md").read_text(encoding="utf-8").partition("## Limits")[2]
    for limit in (MAX_VALUES, MAX_SAMPLES, MAX_RUN_SAMPLES, MAX_DESIGNS):
        assert f"{limit:,}" in page
    for text in (f"{MAX_BYTES // 10**6} MB", f"{MAX_DEPTH} levels", f"{MAX_UNIT_LENGTH} characters"):
        assert text in page
    assert f"| {runtime.MAX_CORES} |" in page and f"| {MAX_WORKERS_PER_CORE} per core |" in page
