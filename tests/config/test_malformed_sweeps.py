"""The exact message of every malformed sweep; `tests.support.golden` describes how they are stored."""

import pytest

from edhas_jax.design.sweep.config import load_sweep
from tests.support.golden import ROOT, Messages

MESSAGES = Messages("malformed_sweeps", load_sweep)


def test_update(monkeypatch):
    monkeypatch.chdir(ROOT)
    MESSAGES.update()


@pytest.mark.parametrize("name", MESSAGES.files)
def test_message(name, monkeypatch):
    monkeypatch.chdir(ROOT)
    assert MESSAGES.message(name) == MESSAGES.expected()[name]
