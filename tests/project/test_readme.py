"""What the README and the docs show is run as it stands there."""

import re
import shutil

import pytest

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.machine.interface.slots import SLOTS
from tests.support import ROOT


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture()
def here(tmp_path, monkeypatch):
    shutil.copytree(ROOT / "configs", tmp_path / "configs")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_python_lines(here):
    (six_lines, _) = blocks("README.md", "python")
    names = {}
    exec(compile(six_lines, "README.md", "exec"), names)
    assert (here / "run.png").stat().st_size > 10_000
    reopened = edhas.open_run(here / "runs" / "20hz")
    assert reopened.metrics["mean_flow"] == names["run"].metrics["mean_flow"]
    assert f"{len(reopened.metrics)} metrics" in six_lines


def test_shell_lines(here):
    (shell,) = blocks("README.md", "sh")
    demo, simulate = (line.split("#")[0].split() for line in shell.strip().splitlines())
    assert demo == ["make", "demo"] and "demo: setup" in (ROOT / "Makefile").read_text()
    assert simulate[0].endswith("bin/edhas")
    assert main(simulate[1:]) == 0


@pytest.mark.parametrize("page", ["README.md", "docs/effects.md"])
def test_own_effect(here, page):
    code = blocks(page, "python")[-1]
    name = re.search(r"class (\w+)\(Effect\)", code)[1]
    (here / "my_effects.py").write_text(code)
    if page == "README.md":
        config = blocks(page, "yaml")[0]
        (here / "my_pump.yaml").write_text(config)
    else:
        (here / "my_pump.yaml").write_text(f"rig: actuator_bench\neffects: [my_effects.py:{name}]\n")
    assert main(["simulate", "my_pump.yaml", "--no-figure"]) == 0
    assert main(["effects", f"my_effects.py:{name}"]) == 0


def test_configuration_page(here):
    (config,) = blocks("docs/configuration.md", "yaml")
    (here / "page.yaml").write_text(config)
    assert edhas.load("page.yaml").simulation.accuracy == pytest.approx(1e-3)


def test_every_slot_is_on_its_page():
    page = (ROOT / "docs" / "effects.md").read_text(encoding="utf-8")
    for slot in SLOTS.values():
        assert f"`{slot.name}` | {slot.location} |" in page and slot.doc in page


def test_links_lead_somewhere():
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"
