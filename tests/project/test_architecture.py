"""Import contract, documentation of modules, and the cost of an import."""

import ast
import re
import subprocess
import sys
import tomllib

import pytest

import edhas_jax
from edhas_jax.machine.interface.slots import SLOTS
from tests.support import ROOT

PACKAGE = sorted((ROOT / "edhas_jax").rglob("*.py"))
STUDIES = sorted((ROOT / "studies").rglob("*.py"))
TESTS = sorted(p for p in (ROOT / "tests").rglob("*.py") if not p.parent.name.startswith("malformed"))
MAX_LAYERS = 11
HEAVY = ("matplotlib", "pint", "rich")


def relative(path) -> str:
    return str(path.relative_to(ROOT))


def python(code: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=300)


def test_import_contracts_hold():
    done = python("from importlinter.cli import lint_imports; raise SystemExit(lint_imports(no_cache=True))")
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_layers_of_the_contract_are_the_packages():
    """An exhaustive contract of at most eleven layers, whose entries are all packages in the folder and no modules."""
    config = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = config["tool"]["importlinter"]["contracts"]
    (contract,) = (c for c in contracts if c.get("containers") == ["edhas_jax"])
    assert contract["type"] == "layers" and contract["exhaustive"] and not contract.get("ignore_imports")
    assert len(contract["layers"]) <= MAX_LAYERS
    listed = {name.strip() for layer in contract["layers"] for name in layer.split("|")}
    assert listed == {path.parent.name for path in (ROOT / "edhas_jax").glob("*/__init__.py")}


@pytest.mark.parametrize("path", PACKAGE + STUDIES, ids=relative)
def test_a_module_is_documented(path):
    module = ast.parse(path.read_text(encoding="utf-8"))
    assert ast.get_docstring(module), "no docstring"
    undocumented = [name for name, node in public(module) if not ast.get_docstring(node)]
    assert not undocumented, f"without a docstring: {', '.join(undocumented)}"


@pytest.mark.parametrize("path", [p for p in TESTS if p.stat().st_size], ids=relative)
def test_a_test_module_is_documented(path):
    assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))), "no docstring"


def test_studies_do_not_import_in_circles():
    imports = {module_name(path): imported(path) for path in STUDIES}
    while leaves := [name for name, others in imports.items() if not others & imports.keys()]:
        for name in leaves:
            del imports[name]
    assert not imports, f"circle among {', '.join(sorted(imports))}"


def test_no_public_name_is_that_of_a_module():
    """Importing the module would put it in the place of the function."""
    modules = {path.stem for path in PACKAGE if path.parent.name == "edhas_jax"}
    assert not modules & set(edhas_jax.__all__)


def test_the_core_imports_no_heavy_package():
    done = python("import sys, edhas_jax, edhas_jax.machine.rigs; print(*sys.modules)")
    assert done.returncode == 0, done.stderr
    loaded = set(done.stdout.split())
    assert "edhas_jax.machine.rigs" in loaded
    assert not loaded & set(HEAVY)


def test_a_notebook_draws_every_figure():
    """All figures are of the class that draws itself."""
    plain = [path for path in PACKAGE if "matplotlib.figure.Figure" in imported(path)]
    assert not plain, f"import edhas_jax.core.figure.Figure: {', '.join(map(relative, plain))}"


def public(node: ast.Module | ast.ClassDef, owner: str = ""):
    """The public functions, classes and methods of a module by dotted name; a slot documents what fills it."""
    for inner in node.body:
        if isinstance(inner, ast.FunctionDef | ast.ClassDef) and not inner.name.startswith("_"):
            if not (owner and (inner.name in SLOTS or inner.name == "rates")):
                yield owner + inner.name, inner
            if isinstance(inner, ast.ClassDef):
                yield from public(inner, f"{owner}{inner.name}.")


def module_name(path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def imported(path) -> set[str]:
    """Every module named by an import of a file, wherever in the file it stands; `from a import b` names a and a.b."""
    out = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            out |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            out |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return out


def test_commands_print_texts_as_they_are():
    """No command interprets markup: the console shows names that users give as they are."""
    for path in sorted((ROOT / "edhas_jax/commands").glob("*.py")):
        code = path.read_text(encoding="utf-8")
        markup = re.search(r"rich\.markup|\[/?(bold|red|green|yellow)\]|\[/\]", code)
        assert markup is None, f"{path.name}: {markup[0]}; use headed or Toned"
