"""The exact message of every malformed configuration; `tests.support.golden` describes how they are stored."""

import pytest

from edhas_jax.config.machine_config import read_config
from tests.support.golden import ROOT, Messages

MESSAGES = Messages("malformed", read_config)


def test_update(monkeypatch):
    monkeypatch.chdir(ROOT)
    MESSAGES.update()


@pytest.mark.parametrize("name", MESSAGES.files)
def test_message(name, monkeypatch):
    monkeypatch.chdir(ROOT)
    assert MESSAGES.message(name) == MESSAGES.expected()[name]
