"""Interruption: SIGTERM acts as Ctrl-C does, also where Python cannot raise an exception."""

import signal
import time

import pytest

from edhas_jax.commands.interruption import interruptible, terminate_as_interrupt


class InterruptedDestructor:
    """Is interrupted in its destructor, where Python prints an exception and goes on."""

    def __del__(self):
        signal.raise_signal(signal.SIGTERM)
        time.sleep(0.01)  # the handler runs before this ends


def test_termination_interrupts():
    with pytest.raises(KeyboardInterrupt), terminate_as_interrupt():
        signal.raise_signal(signal.SIGTERM)
        time.sleep(10.0)


def test_an_interruption_that_a_destructor_has_swallowed_comes_again():
    found = InterruptedDestructor()
    with pytest.raises(KeyboardInterrupt), terminate_as_interrupt():
        del found
        for _ in range(1000):
            time.sleep(0.01)


def test_the_handler_of_before_is_restored():
    before = signal.getsignal(signal.SIGTERM)
    with terminate_as_interrupt():
        pass
    assert signal.getsignal(signal.SIGTERM) is before


def test_all_of_a_command_can_be_interrupted():
    @interruptible
    def command(options):
        del options[0]  # swallowed where a command imports its modules, long before its work
        for _ in range(1000):
            time.sleep(0.01)

    options = [InterruptedDestructor()]
    with pytest.raises(KeyboardInterrupt):
        command(options)
