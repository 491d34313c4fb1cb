"""Interruption: a command that is interrupted anywhere ends with status 130 and one sentence."""

import contextlib
import gc
import signal
import subprocess
import sys
import threading
import time
from importlib.machinery import ExtensionFileLoader

import pytest

from edhas_jax.commands import lists
from edhas_jax.commands.cli import main
from edhas_jax.commands.interruption import REPEAT_AFTER, STATUS_INTERRUPTED, Interruption
from tests.fuzz.interrupts import attack

SENTENCE = "edhas: interrupted; what was finished until then is kept\n"


def interrupted(monkeypatch, capsys, work) -> tuple[int, str]:
    """The exit status of a command that does this work, and what it prints on the standard error."""
    monkeypatch.setattr(lists, "parameters", lambda options: work())
    return main(["parameters"]), capsys.readouterr().err


def go_on() -> None:
    """What a command does that does not know of an interruption: ten seconds of work."""
    for _ in range(1000):
        time.sleep(0.01)


def in_a_destructor() -> None:
    class Interrupted:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)

    del [Interrupted()][0]
    go_on()


def in_a_callback_of_the_garbage_collector() -> None:
    def callback(phase, info):
        gc.callbacks.remove(callback)
        signal.raise_signal(signal.SIGINT)

    gc.callbacks.append(callback)
    gc.collect()
    go_on()


def caught_in(module: str) -> None:
    """An interruption that a function of this module catches."""
    names = {"__name__": module, "signal": signal}
    exec("def call():\n try:\n  signal.raise_signal(signal.SIGINT)\n except BaseException:\n  pass\n", names)
    names["call"]()


def in_a_library_that_catches_it() -> None:
    caught_in("library")
    go_on()


def in_a_library_that_makes_another_error_of_it() -> None:
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        raise AttributeError("partially initialised module") from None


def twice() -> None:
    try:
        signal.raise_signal(signal.SIGINT)
    finally:
        signal.raise_signal(signal.SIGTERM)


def at_its_end() -> None:
    with contextlib.suppress(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize(
    "work",
    [
        go_on, in_a_destructor, in_a_callback_of_the_garbage_collector, in_a_library_that_catches_it,
        in_a_library_that_makes_another_error_of_it, twice, at_its_end,
    ],
    ids=lambda work: work.__name__,
)  # fmt: skip
def test_an_interruption_is_never_lost(work, monkeypatch, capsys):
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)]
    if work is go_on:
        threading.Timer(0.1, signal.raise_signal, [signal.SIGINT]).start()
    assert interrupted(monkeypatch, capsys, work) == (STATUS_INTERRUPTED, SENTENCE)
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)] == before


def test_a_command_that_keeps_what_is_finished_is_left_in_peace():
    with Interruption(is_whole_process=False) as interruption:
        caught_in("edhas_jax.design.sizing.optimiser")
        time.sleep(3 * REPEAT_AFTER)  # writes what is finished
        assert interruption.asked


def test_the_import_of_a_library_in_c_is_not_interrupted():
    """An exception within one may end the process with a message of C++."""
    names = {"signal": signal, "ended": []}
    text = "def exec_module(self):\n signal.raise_signal(signal.SIGINT)\n ended.append(True)\n"
    exec(compile(text, "<frozen importlib._bootstrap_external>", "exec"), names)
    with pytest.raises(KeyboardInterrupt), Interruption(is_whole_process=False):
        names["exec_module"](ExtensionFileLoader("library", "library.so"))
        assert names["ended"]
        go_on()


def test_an_interruption_while_the_process_ends_counts_too():
    code = (
        "import atexit, signal, sys; from edhas_jax.commands.cli import main\n"
        "atexit.register(signal.raise_signal, signal.SIGINT); sys.argv[1:] = ['parameters']; main()"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (ended.returncode, ended.stderr) == (STATUS_INTERRUPTED, SENTENCE)


def test_a_signal_that_the_process_ignores_stays_ignored():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with Interruption(is_whole_process=False) as interruption:
            signal.raise_signal(signal.SIGINT)
        assert not interruption.asked and signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_the_command_line_interrupted_at_random_moments():
    assert attack(8, seed=0, longest=4.0) == []
