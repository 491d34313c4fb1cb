"""Interruption of a command by its user or by the system."""

import contextlib
import functools
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator

STATUS_INTERRUPTED = 130  # exit status of a command that its user has interrupted
RESEND_AFTER = 0.05  # s, until a signal whose exception was lost is sent again


@contextlib.contextmanager
def terminate_as_interrupt() -> Iterator[None]:
    """Within the block SIGTERM raises KeyboardInterrupt, as Ctrl-C does, so that a command can keep what is finished.

    Where Python cannot raise an exception (in a destructor, or in a callback of the garbage collector or of a C
    library), it prints the KeyboardInterrupt and goes on; the signal is then sent again.

    Does nothing outside the main thread, where no signal can be handled.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(number, frame):
        raise KeyboardInterrupt

    timers = []

    def resend(lost):
        if not issubclass(lost.exc_type, KeyboardInterrupt):
            previous_hook(lost)
            return
        timers.append(threading.Timer(RESEND_AFTER, os.kill, (os.getpid(), signal.SIGTERM)))
        timers[-1].start()

    previous, previous_hook = signal.signal(signal.SIGTERM, interrupt), sys.unraisablehook
    sys.unraisablehook = resend
    try:
        yield
    finally:
        for timer in timers:
            timer.cancel()
        sys.unraisablehook = previous_hook
        signal.signal(signal.SIGTERM, previous)


def interruptible(command: Callable[..., int]) -> Callable[..., int]:
    """A command all of which runs within `terminate_as_interrupt`, its imports and the reading of its files too."""

    @functools.wraps(command)
    def run(options) -> int:
        with terminate_as_interrupt():
            return command(options)

    return run
