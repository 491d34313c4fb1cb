"""Strictness for every test, and the runs that several of them read."""

import functools

import jax
import pytest

from edhas_jax.compiler.engines import ENGINES, VARIABLE
from edhas_jax.core import runtime
from tests.support.compilations import compilations as count_compilations
from tests.support.reference import run_of

jax.config.update("jax_enable_x64", True)  # for what tests compute by themselves; the package does not need it
runtime.keep_xla_programs()
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

SLOW_FOLDERS_FIRST = (
    "design", "studies", "diagnosis", "inference", "contract", "reference", "measurements", "export", "project"
)  # fmt: skip


def pytest_configure(config):
    """A warning that our own code causes is an error; those of others are theirs."""
    config.addinivalue_line("filterwarnings", "error:::edhas_jax")


def pytest_collection_modifyitems(items):
    """Files that take long first: both workers then end with short ones, at about the same time."""
    order = {folder: k for k, folder in enumerate(SLOW_FOLDERS_FIRST)}
    items.sort(key=lambda item: order.get(item.path.parent.name, len(order)))


@pytest.fixture(scope="session")
def run():
    """`run(name, step, precision)`: the run beside a trajectory, made once."""
    return functools.cache(run_of)


@pytest.fixture
def compilations(tmp_path, monkeypatch):
    """`compilations()`: how many programs have been compiled so far; machine code is cached in an empty folder."""
    cache = tmp_path / "cache"
    cache.mkdir()
    monkeypatch.setenv("EDHAS_CACHE", str(cache))
    return functools.partial(count_compilations, cache)


@pytest.fixture(params=[engine.name for engine in ENGINES if not engine.unavailable()])
def engine(request, monkeypatch):
    """The name of each loop engine that this machine has; it serves during the test."""
    monkeypatch.setenv(VARIABLE, request.param)
    return request.param
