"""The site has a page for everything: every document, every tutorial, and every public name in the reference."""

import importlib
import re

import pytest
import yaml

import edhas_jax
from tests.support import ROOT

NAMED = re.compile(r"^::: (\S+)$", re.MULTILINE)


def pages(entries) -> set[str]:
    """All pages of a navigation."""
    found = set()
    for entry in entries:
        for target in entry.values():
            found |= {target} if isinstance(target, str) else pages(target)
    return found


def test_every_page_is_in_the_navigation():
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").replace("!ENV ", "")
    listed = pages(yaml.safe_load(text)["nav"])
    docs = ROOT / "docs"
    there = {p.relative_to(docs).as_posix() for p in (*docs.glob("*.md"), *(docs / "tutorials").glob("*.py"))}
    assert listed == there


def test_the_reference_has_every_public_name():
    described = NAMED.findall((ROOT / "docs" / "reference.md").read_text(encoding="utf-8"))
    public = {f"edhas_jax.{module}.{name}" for module, name in edhas_jax._PUBLIC.values()}
    assert set(described) == public and len(described) == len(public)


@pytest.mark.parametrize("path", NAMED.findall((ROOT / "docs" / "reference.md").read_text(encoding="utf-8")))
def test_a_name_of_the_reference_has_a_docstring(path):
    module, _, name = path.rpartition(".")
    assert getattr(importlib.import_module(module), name).__doc__
