"""The package as it is published: built, checked, and used in a fresh environment outside the repository."""

import json
import os
import shutil
import site
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

from tests.support import ROOT

pytest.importorskip("build")
SOURCES = ("edhas_jax", "pyproject.toml", "README.md", "LICENSE")
PROGRAM = """
import json, sys
import edhas_jax as edhas

machine = edhas.load("my_actuator.yaml").machine
swept = edhas.sweep(machine, coil_resistance=("1 ohm", "2 ohm", 2), frequency=[8, 12])
swept.plot_heat("rms_current").savefig("heat.png")
print(json.dumps({"from": edhas.__file__, "ok": int((swept.status == "ok").sum()),
                  "saved": str(edhas.open_result("runs/my_actuator").status)}))
"""


def run(*command, **options) -> str:
    done = subprocess.run(command, capture_output=True, text=True, timeout=900, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Wheel and source archive, built from a copy of the sources, without the network."""
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("dist")
    for name in SOURCES:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copyfile(ROOT / name, source / name)
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), str(source))
    return {p.suffix: p for p in out.iterdir()}


def test_the_description_is_valid(built):
    pytest.importorskip("twine")
    assert set(built) == {".whl", ".gz"}
    run(sys.executable, "-m", "twine", "check", "--strict", *map(str, built.values()))


def test_examples_schema_and_data_files_are_in_the_wheel(built):
    with zipfile.ZipFile(built[".whl"]) as wheel:
        names = set(wheel.namelist())
    folder = ROOT / "edhas_jax" / "examples"
    examples = {f"edhas_jax/examples/{p.relative_to(folder)}" for p in folder.rglob("*") if p.is_file()}
    assert len(examples) > 15 and examples <= names
    assert {"edhas_jax/py.typed", "edhas_jax/export/fmu_unit.c", "edhas_jax/diagnosis/report/trace_viewer.js"} <= names
    assert not [name for name in names if name.startswith(("tests", "studies", "benchmarks"))]


def test_a_fresh_environment(built, tmp_path):
    """From the wheel to a run, a sweep and its heat map, with the dependencies of this environment."""
    environment, here = tmp_path / "environment", tmp_path / "work"
    here.mkdir()
    venv.create(environment, with_pip=False)
    packages = next((environment / "lib").glob("python*")) / "site-packages"
    with zipfile.ZipFile(built[".whl"]) as wheel:
        wheel.extractall(packages)
    # a path file of another environment's folder is not read there: its own edhas_jax, if any, stays out
    (packages / "dependencies.pth").write_text("\n".join(site.getsitepackages()) + "\n")
    variables = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    python = str(environment / "bin" / "python")

    def edhas(*arguments: str) -> str:
        return run(python, "-m", "edhas_jax.commands.cli", *arguments, cwd=here, env=variables)

    assert "usage: edhas" in edhas()
    edhas("new", "actuator")
    printed = json.loads(edhas("simulate", "my_actuator.yaml", "--set", "duration=0.3s", "--json"))
    assert printed["written"] == "runs/my_actuator"
    assert (here / "runs" / "my_actuator" / "figure.png").stat().st_size > 10_000
    edhas("examples", "campaign", "paper.yaml")
    assert "run8.csv" in {p.name for p in (here / "examples" / "campaign").iterdir()}
    assert json.loads(edhas("schema"))["title"]
    found = json.loads(run(python, "-c", PROGRAM, cwd=here, env=variables).splitlines()[-1])
    assert Path(found["from"]).is_relative_to(packages) and found["ok"] == 4 and found["saved"] == "ok"
    assert (here / "heat.png").stat().st_size > 10_000
