"""Examples and links of the README and the documentation: every example is executed as printed."""

import functools
import importlib.util
import os
import re
import shutil
from pathlib import Path

import jax
import pytest

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.core.structs import parameters as parameters_of
from edhas_jax.core.units import format_quantity
from edhas_jax.design.sensitivity.config import load_sensitivity
from edhas_jax.design.sizing.config import load_sizing
from edhas_jax.machine.effects import (
    LIBRARY,
    CoggingForce,
    ForceConstantDroop,
    HoseCompliance,
    InverterDeadTime,
    ParasiticSpring,
    ValveFlowForce,
)
from edhas_jax.machine.interface.slots import SLOTS
from edhas_jax.workbench.workspace import open_workspace
from tests.support import ROOT
from tests.support.headline import quoted_headline

SUSPECTS = (ForceConstantDroop, InverterDeadTime)

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture()
def here(tmp_path, monkeypatch):
    shutil.copytree(ROOT / "configs", tmp_path / "configs")
    for campaign in ("campaign", "bench"):
        shutil.copytree(ROOT / "studies" / "demo" / campaign, tmp_path / "studies" / "demo" / campaign)
    monkeypatch.chdir(tmp_path)
    assert main(["examples", "--all", "--quiet"]) == 0
    return tmp_path


def execute(block: str) -> dict:
    names = {}
    exec(compile(block, "README.md", "exec"), names)
    return names


def comment(block: str, expression: str) -> str:
    """The value of an expression as the README states it beside it."""
    return re.search(rf"^{re.escape(expression)} +# (.*)$", block, re.MULTILINE)[1]


def test_explore_example(here):
    block = blocks("README.md", "python")[0]
    names = execute(block)
    assert (here / "run.png").stat().st_size > 10_000
    reopened = edhas.open_run(here / "runs" / "20hz")
    assert reopened.metrics["mean_flow"] == names["run"].metrics["mean_flow"]
    assert dict(names["swept"].sizes) == {"piston_clearance": 8, "frequency": 2}
    assert (names["swept"]["mean_leakage"] > 0.0).all() and (here / "heat.png").stat().st_size > 10_000


def test_size_example(here):
    names = execute(blocks("README.md", "python")[1])
    flow, h = names["many"]["mean_flow"], 35e-6 / 499
    assert flow.shape == (500,) and (flow[1:] > 0.0).all()
    k = round(10e-6 / h)  # a clearance of 15 µm
    assert float(names["slopes"]["mean_flow"]) == pytest.approx(float(flow[k + 20] - flow[k - 20]) / (40 * h), rel=0.03)


def test_compare_example(here):
    block = blocks("README.md", "python")[2]
    assert execute(block)["patterns"][0].sentence == comment(block, "patterns[0].sentence")


def test_learn_example(here, monkeypatch):
    """With two suspects of the library: every further one has to be compiled, and is rejected."""
    monkeypatch.setattr(edhas, "diagnose", functools.partial(edhas.diagnose, library=SUSPECTS))
    block = blocks("README.md", "python")[3]
    diagnosis = execute(block)["diagnosis"]
    assert diagnosis.verdict.value == comment(block, "diagnosis.verdict.value")
    error = 'diagnosis.errors()["after"]["holdout"]["overall"]'
    assert f"{eval(error, {'diagnosis': diagnosis}):.2f}" == comment(block, error).split()[-1]
    assert (here / "report.html").stat().st_size > 100_000


def test_the_demo_finds_what_the_readme_says(here):
    """With the effects that the whole library leads to, each further one is rejected."""
    library = (InverterDeadTime, CoggingForce, ParasiticSpring, ValveFlowForce, HoseCompliance)
    diagnosis = edhas.diagnose("studies/demo/bench", library=library)
    stated = quoted_headline("README.md", "make demo")
    for state in ("before", "calibrated", "after"):
        assert diagnosis.errors()[state]["holdout"]["overall"] == pytest.approx(float(stated[state]), rel=0.01)
    named = [candidate.id for candidate in diagnosis.named]
    laws = ["differs" if law.differs else "as_in_the_library" for law in diagnosis.laws]
    assert [diagnosis.verdict.value, *named, *laws] == [stated[k] for k in ("verdict", "effects", "laws")]


def test_python_page(here):
    """The optimiser finds the frequency of the flow that was asked for; the sweep opens again."""
    first, second = blocks("docs/python.md", "python")[1:]
    with jax.numpy_dtype_promotion("standard"):  # optax needs it
        names = execute(first)
    assert 18.5 < float(names["start"]["frequency"]) < 20.5 and float(names["value"]) < 0.01
    names = execute(second)
    assert names["figure"].axes and names["again"].sizes == names["swept"].sizes


def test_gradient_page(here):
    table = execute(blocks("docs/gradients.md", "python")[0])["table"]
    assert table.elasticities(1).loc["piston_diameter", "mean_flow"] > 1.0


def test_sweep_page(here):
    names = execute(blocks("docs/sweeps.md", "python")[0])
    assert len(names["table"]) == 100 and len(names["best"]) == 5


def test_fit_page(here):
    shutil.copytree(here / "studies" / "demo" / "campaign", here / "bench")
    names = execute(blocks("docs/fitting.md", "python")[0])
    found = names["found"]
    assert found.at_limit["coil_resistance"] == "upper", "the model of the demo lacks an effect"
    free = set(found.values) - set(found.at_limit)
    assert free and all(found.interval(n)[0] < found.values[n] < found.interval(n)[1] for n in free)


def test_imports_of_the_diagnosis_and_its_curves():
    codes = [*blocks("docs/diagnosis.md", "python"), blocks("docs/effects.md", "python")[1]]
    lines = "\n".join(codes).splitlines()
    names = execute("\n".join(line for line in lines if "import" in line))
    assert all(callable(names[name]) for name in ("diagnose", "estimate_law_curve", "write_curve_model"))


def test_make_targets():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for line in blocks("README.md", "sh")[0].strip().splitlines():
        make, target = line.split("#")[0].split()
        assert make == "make" and re.search(rf"^{target}: setup$", makefile, re.MULTILINE)


def test_shell_lines(here):
    """Every `edhas` line of the README; the slow ones only as far as their arguments and files are read."""
    shell = blocks("README.md", "sh")[1:]
    lines = [line.split("#")[0].split() for block in shell for line in block.strip().splitlines()]
    assert {line[1] for line in lines} == {
        "examples", "simulate", "sweep", "plot", "sensitivity", "size", "compare", "diagnose", "workbench",
    }  # fmt: skip
    for program, command, *arguments in lines:
        assert program == "edhas"
        if command == "size":
            assert load_sizing(arguments[0]).starts
        elif command == "sensitivity":
            assert load_sensitivity(arguments[0]).metrics
        elif command == "diagnose":
            assert edhas.read_campaign(arguments[0]).runs
        elif command == "workbench":
            assert open_workspace(Path(arguments[0])).has_campaign
        else:
            assert main([command, *arguments]) == 0


def test_own_effect(here):
    code = blocks("docs/effects.md", "python")[0]
    name = re.search(r"class (\w+)\(Effect\)", code)[1]
    (here / "my_effects.py").write_text(code)
    (here / "my_pump.yaml").write_text(f"rig: actuator_bench\neffects: [my_effects.py:{name}]\n")
    assert main(["simulate", "my_pump.yaml", "--no-figure"]) == 2  # nobody has allowed the file to run
    assert main(["simulate", "my_pump.yaml", "--no-figure", "--effect", f"my_effects.py:{name}"]) == 0
    assert main(["effects", f"my_effects.py:{name}"]) == 0


def test_configuration_page(here):
    (config,) = blocks("docs/configuration.md", "yaml")
    (here / "page.yaml").write_text(config)
    assert edhas.load("page.yaml").simulation.accuracy == pytest.approx(1e-3)


def test_every_slot_is_on_its_page():
    page = (ROOT / "docs" / "effects.md").read_text(encoding="utf-8")
    for slot in SLOTS.values():
        assert f"`{slot.name}` | {slot.location} |" in page and slot.doc in page


def test_every_effect_is_on_its_page_with_its_plausible_ranges():
    path = ROOT / "docs" / "effects.md"
    page, rows = path.read_text(encoding="utf-8"), []
    for kind in LIBRARY:
        where = ", ".join(dict.fromkeys(slot.location for slot in kind.slots))
        parameters = "; ".join(f"`{p.name}` {interval(p)}" for p in parameters_of(kind))
        rows.append(f"| `{kind.id}` | {where} | {parameters} |\n")
    head = "| effect | acts on | parameters, plausible range |\n| --- | --- | --- |\n"
    before, table, after = re.split(rf"(?<={re.escape(head)})((?:\|.*\n)+)", page)
    if os.environ.get("EDHAS_UPDATE_GOLDEN") == "1":
        path.write_text(before + "".join(rows) + after, encoding="utf-8")
        table = "".join(rows)
    assert table.splitlines(keepends=True) == rows


def interval(p) -> str:
    """The plausible range of a parameter as the page states it; its default in brackets where it has none."""
    if p.plausible is None:
        return f"({format_quantity(p.default, p.unit)})"
    return " … ".join(format_quantity(limit, p.unit) for limit in p.plausible)


def test_links_lead_somewhere():
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_named_programs_and_files_exist():
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for module in re.findall(r"python -m (studies[\w.]*)", text):
            assert (ROOT / module.replace(".", "/")).with_suffix(".py").exists() or (
                ROOT / module.replace(".", "/") / "__main__.py"
            ).exists(), f"{page.name}: {module}"
        for path in re.findall(r"\b((?:edhas_jax|tests|studies|benchmarks|configs)/[\w/]+\.(?:py|yaml|json))", text):
            assert (ROOT / path).exists(), f"{page.name}: {path}"
        for name in re.findall(r"`(edhas_jax(?:\.\w+)+)", text):
            assert is_importable(name), f"{page.name}: {name}"


def is_importable(name: str) -> bool:
    """Whether a dotted name is a module of the package, or something in one."""
    module, _, attribute = name.rpartition(".")
    try:
        return hasattr(importlib.import_module(module), attribute) or bool(importlib.util.find_spec(name))
    except ImportError:
        return False


def test_wrong_name_is_not_importable():
    assert is_importable("edhas_jax.measurements.sensor_models") and is_importable("edhas_jax.open_run")
    assert not is_importable("edhas_jax.measurements.no_such_module")
    assert not is_importable("edhas_jax.no_such_package.module")
