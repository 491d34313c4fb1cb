"""Every malformed sweep, and the exact message it gives; see `golden` for how the messages are kept."""

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
