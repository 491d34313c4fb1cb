"""Interruption of a command by its user or by the system."""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator

STATUS_INTERRUPTED = 130  # exit status of a command that its user has interrupted
RESEND_AFTER = 0.05  # s


@contextlib.contextmanager
def terminate_as_interrupt() -> Iterator[None]:
    """Within the block SIGTERM raises KeyboardInterrupt, as Ctrl-C does, so that a command can keep what is finished.

    An interruption that strikes where Python lets nothing be raised (in a destructor, a callback of the garbage
    collector or of a library in C) would be printed and forgotten; it is sent once more.

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
