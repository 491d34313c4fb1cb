"""How the package is made: who may import whom, how long a module is, what is documented, what an import costs."""

import ast
import subprocess
import sys

import pytest

import edhas_jax
from edhas_jax.machine.interface.slots import SLOTS
from tests.support import ROOT

MODULES = sorted((ROOT / "edhas_jax").rglob("*.py"))
LONGEST = 300
HEAVY = ("matplotlib", "pint", "rich")


def python(code: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=300)


def test_import_contracts():
    done = python("from importlinter.cli import lint_imports; raise SystemExit(lint_imports(no_cache=True))")
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_module(path):
    text = path.read_text(encoding="utf-8")
    module = ast.parse(text)
    assert len(text.splitlines()) <= LONGEST
    assert ast.get_docstring(module), "no docstring"
    silent = [name for name, node in public(module) if not ast.get_docstring(node)]
    assert not silent, f"without a docstring: {', '.join(silent)}"


def test_no_public_name_is_that_of_a_module():
    """Importing the module would put it in the place of the function."""
    named = {path.stem for path in MODULES if path.parent.name == "edhas_jax"}
    assert not named & set(edhas_jax.__all__)


def public(node: ast.Module | ast.ClassDef, owner: str = ""):
    """The public functions, classes and methods of a module, by dotted name; what fills a slot is told by the slot."""
    for inner in node.body:
        if isinstance(inner, ast.FunctionDef | ast.ClassDef) and not inner.name.startswith("_"):
            if not (owner and (inner.name in SLOTS or inner.name == "rates")):
                yield owner + inner.name, inner
            if isinstance(inner, ast.ClassDef):
                yield from public(inner, f"{owner}{inner.name}.")


def test_the_core_imports_no_heavy_package():
    done = python("import sys, edhas_jax, edhas_jax.machine.rigs; print(*sys.modules)")
    assert done.returncode == 0, done.stderr
    loaded = set(done.stdout.split())
    assert "edhas_jax.machine.rigs" in loaded
    assert not loaded & set(HEAVY)
