"""The exact message of every malformed configuration; `tests.support.golden` describes how they are stored."""

import functools

import pytest

from edhas_jax.config.machine_config import read_config
from tests.support.golden import ROOT, Messages

OWN_CODE = sorted((ROOT / "tests/config/malformed").glob("*.py"))
MESSAGES = Messages("malformed", functools.partial(read_config, trust=OWN_CODE))


def test_update(monkeypatch):
    monkeypatch.chdir(ROOT)
    MESSAGES.update()


@pytest.mark.parametrize("name", MESSAGES.files)
def test_message(name, monkeypatch):
    monkeypatch.chdir(ROOT)
    assert MESSAGES.message(name) == MESSAGES.expected()[name]
