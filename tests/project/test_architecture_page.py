"""The architecture page agrees with the code: packages, picture, journeys, decisions and equations."""

import importlib
import re
import tomllib
from pathlib import Path

import pytest

from tests.support import ROOT

PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
METHOD = (ROOT / "docs" / "diagnosis_method.md").read_text(encoding="utf-8")
PICTURE = (ROOT / "docs" / "pictures" / "architecture.svg").read_text(encoding="utf-8")
EQUATIONS = {str(number) for number in range(1, 13)}
FUNCTION = r"`[\w/]+\.py: [\w.]+`"
MIN_STEPS = 8  # of a journey; fewer would mean that the pattern below no longer finds them


def contract_packages() -> list[str]:
    """The packages of the import contract, from the highest layer to the lowest."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        contracts = tomllib.load(file)["tool"]["importlinter"]["contracts"]
    (layers,) = (contract["layers"] for contract in contracts if contract.get("containers") == ["edhas_jax"])
    return [name.strip() for layer in layers for name in layer.split("|")]


def section(page: str, heading: str) -> str:
    """The text under a heading, up to the next heading of the same level; empty if there is none."""
    found = re.search(rf"^## {re.escape(heading)}$(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL)
    return found[1] if found else ""


def resolve(module: str, name: str):
    """The object with a qualified name in a module; None if there is no such module or object."""
    try:
        found = importlib.import_module(module)
        for part in name.split("."):
            found = getattr(found, part)
    except (ImportError, AttributeError):
        return None
    return found


def package_problems(page: str, picture: str) -> list[str]:
    """Packages that the table or the picture lacks, and those that the import contract does not know."""
    expected = set(contract_packages())
    listed = set(re.findall(r"^\| `(\w+)` \|", section(page, "Packages"), re.MULTILINE))
    drawn = set(re.findall(r'class="name">(\w+)<', picture))
    return [f"package table: {name}" for name in expected ^ listed] + [f"picture: {name}" for name in expected ^ drawn]


def function_problems(page: str) -> list[str]:
    """Every `file.py: function` of the page that does not exist, and every `file.py` named alone."""
    problems = []
    for path, name in re.findall(r"`([\w/]+\.py): ([\w.]+)`", page):
        module = ".".join(("edhas_jax", *Path(path).with_suffix("").parts))
        if resolve(module, name) is None:
            problems.append(f"{path}: {name}")
    for path in re.findall(r"`([\w/]+\.(?:py|md))`", page):
        if not any((root / path).exists() for root in (ROOT, ROOT / "edhas_jax")):
            problems.append(path)
    return problems


def equation_problems(page: str) -> list[str]:
    """Equations without a row, without a function, or with one whose docstring does not cite them."""
    rows = re.findall(r"^\| (\(\d+\)[^|]*) \|.*\| (.+?) \|$", section(page, "Equations of the paper"), re.MULTILINE)
    listed = {number: cell for numbers, cell in rows for number in re.findall(r"\d+", numbers)}
    problems = [f"Eq. ({number}) is not listed" for number in EQUATIONS - set(listed)]
    for number, cell in listed.items():
        references = re.findall(r"`([\w.]+):([\w.]+)`", cell)
        if not references:
            problems.append(f"Eq. ({number}) has no function")
        for module, name in references:
            found = resolve(module, name)
            if found is None:
                problems.append(f"Eq. ({number}): no {module}:{name}")
            elif f"Eq. ({number})" not in (found.__doc__ or ""):
                problems.append(f"Eq. ({number}): not cited by {module}:{name}")
    return problems


def page_problems(page: str, picture: str) -> list[str]:
    return package_problems(page, picture) + function_problems(page) + equation_problems(page)


def test_page_agrees_with_the_code():
    assert page_problems(PAGE, PICTURE) == []


def test_functions_of_the_page_on_the_diagnosis_exist():
    assert len(re.findall(FUNCTION, METHOD)) >= 8 and function_problems(METHOD) == []
    assert function_problems(METHOD.replace("posterior.py: SetPosterior", "posterior.py: no_such")) == [
        "diagnosis/search/posterior.py: no_such"
    ]


def test_page_has_three_journeys_and_its_tables():
    journeys = re.split(r"^### ", section(PAGE, "Journeys"), flags=re.MULTILINE)[1:]
    assert len(journeys) == 3
    for journey in journeys:
        assert len(re.findall(r"^\d+\. `[\w/]+\.py: [\w.]+`", journey, re.MULTILINE)) >= MIN_STEPS
    decisions = section(PAGE, "Where things are decided")
    assert len(re.findall(r"^\| [^|]+ \| `[\w/]+\.py: [\w.]+`", decisions, re.MULTILINE)) >= 8
    for heading in ("Scales of the diagnosis", "How to change things"):
        assert "`" in section(PAGE, heading)


REFERENCE = r"`edhas_jax[\w.]+:[\w.]+`"


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        (FUNCTION, "`core/units.py: no_such_function`", "core/units.py: no_such_function"),
        (FUNCTION, "`core/no_such_file.py: to_si`", "core/no_such_file.py: to_si"),
        (r"`machine/effects/[\w/]+\.py`", "`machine/effects/no_such_file.py`", "no_such_file.py"),
        (REFERENCE, "`edhas_jax.core.units:no_such_function`", "no edhas_jax.core.units:no_such_function"),
        (REFERENCE, "`edhas_jax.core.units:to_si`", "not cited by edhas_jax.core.units:to_si"),
        (REFERENCE, "not assigned", "Eq. (1) has no function"),
        (r"^\| \(12\) \|", "| (13) |", "Eq. (12) is not listed"),
        (r"^\| `compiler` \|", "| `compilers` |", "package table: compilers"),
    ],
)
def test_wrong_name_on_the_page_is_reported(right, wrong, message):
    page, count = re.subn(right, wrong, PAGE, count=1, flags=re.MULTILINE)
    assert count == 1
    assert any(message in problem for problem in page_problems(page, PICTURE))


def test_missing_package_in_the_picture_is_reported():
    picture = PICTURE.replace('class="name">compiler<', 'class="name">translator<')
    assert {"picture: compiler", "picture: translator"} <= set(page_problems(PAGE, picture))
