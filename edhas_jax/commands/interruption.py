"""Interruption of a command by its user or by the system: it ends with status 130 and one sentence."""

import atexit
import contextlib
import os
import signal
import sys
import threading
from importlib.machinery import ExtensionFileLoader

STATUS_INTERRUPTED = 130  # exit status of a command that its user has interrupted
REPEAT_AFTER = 0.1  # s, until an interruption that something has swallowed is raised again
CAN_REPEAT = hasattr(signal, "setitimer")  # not on Windows
KEPT = "edhas: interrupted; what was finished until then is kept"


class Interruption:
    """Within the block Ctrl-C and SIGTERM raise KeyboardInterrupt, so that a command can keep what is finished.

    Something may swallow the exception: Python prints and drops one that is raised in a destructor or in a callback of
    the garbage collector, a library in C may do so in an import, and a library may catch it or make another error of
    it. It is therefore raised again until code of this package has caught it; `asked` tells whatever became of it.

    Outside the main thread, where no signal can be handled, and of signals that the process was told to ignore, the
    block changes nothing.

    Args:
        is_whole_process: whether the process runs nothing but the command, and ends with it.

    Attributes:
        asked: whether an interruption has come.
    """

    def __init__(self, is_whole_process: bool):
        self.asked, self._settled, self._is_whole_process = False, False, is_whole_process
        self._raised: KeyboardInterrupt | None = None
        self._previous = {}

    def __enter__(self) -> "Interruption":
        self._hooks = sys.unraisablehook, sys.excepthook
        if threading.current_thread() is threading.main_thread():
            handlers = {signal.SIGINT: self._interrupt, signal.SIGTERM: self._interrupt}
            if CAN_REPEAT:
                handlers[signal.SIGALRM] = self._repeat
            for number, handler in handlers.items():
                if signal.getsignal(number) is not signal.SIG_IGN:
                    self._previous[number] = signal.signal(number, handler)
            sys.unraisablehook = lambda lost: self._drop(lost.exc_value) or self._hooks[0](lost)
            sys.excepthook = lambda kind, error, where: self._drop(error) or self._hooks[1](kind, error, where)
        return self

    def __exit__(self, *_) -> None:
        self._settled = True
        if CAN_REPEAT:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        sys.unraisablehook, sys.excepthook = self._hooks
        for number, handler in self._previous.items():
            late = signal.SIG_IGN if CAN_REPEAT and number == signal.SIGALRM else self._note
            signal.signal(number, late if self._is_whole_process else handler)

    def end(self, status: int, sentence: str = KEPT) -> int:
        """End the command: its exit status, and where it was interrupted the sentence on the standard error.

        A process of its own ends here, after what libraries have registered for its end, but without the end of Python,
        which is deaf to signals: one that came meanwhile would be lost.
        """
        if self._is_whole_process:
            if self.asked:  # a library whose import was interrupted cannot clean up, and need not
                sys.unraisablehook = lambda lost: None
            atexit._run_exitfuncs()
        if self.asked:
            status = STATUS_INTERRUPTED
            print(sentence, file=sys.stderr)
        if self._is_whole_process:
            for stream in (sys.stdout, sys.stderr):
                with contextlib.suppress(OSError, ValueError, AttributeError):  # it is closed, or has no reader
                    stream.flush()
            os._exit(status)
        return status

    def _interrupt(self, number, frame) -> None:
        self.asked = True
        self._raise(frame)

    def _note(self, number, frame) -> None:
        """An interruption at the end of the process, when nothing is left to be stopped."""
        self.asked = True

    def _raise(self, frame) -> None:
        if self._settled:
            return
        if CAN_REPEAT:
            signal.setitimer(signal.ITIMER_REAL, REPEAT_AFTER)
            if _starts_a_library(frame):
                return
        self._raised = KeyboardInterrupt()
        raise self._raised

    def _repeat(self, number, frame) -> None:
        """Raise the interruption again where it was swallowed; look again later where it is still on its way."""
        handled = sys.exception()
        while handled is not None:
            if handled is self._raised:
                signal.setitimer(signal.ITIMER_REAL, REPEAT_AFTER)
                return
            handled = handled.__context__
        if not self._is_caught_here():
            self._raise(frame)

    def _is_caught_here(self) -> bool:
        """Whether code of this package has caught the exception: the outermost function that it has reached."""
        if self._raised is None:
            return False
        module = self._raised.__traceback__.tb_frame.f_globals.get("__name__", "")
        return module.startswith("edhas_jax.") and module != __name__

    def _drop(self, error: BaseException) -> bool:
        """Whether an error that Python would print and forget is of no use to anybody, as after an interruption."""
        if error is self._raised:
            self._raised = None
        return self.asked


def _starts_a_library(frame) -> bool:
    """Whether a library in C is being imported, which may end the whole process where an exception is raised in it."""
    while frame is not None:
        is_import = frame.f_code.co_filename.startswith("<frozen importlib")
        if is_import and isinstance(frame.f_locals.get("self"), ExtensionFileLoader):
            return True
        frame = frame.f_back
    return False
