"""The process that calculates for the page; it keeps the campaign and fitted models in memory, to answer quickly.

It is started by spawn and ends with the server. A calculation that is cancelled, or that ends the process, costs only
what was kept in memory.
"""

import asyncio
import contextlib
import multiprocessing
import signal
import threading
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

PROGRESS, RESULT, USER_ERROR, DEFECT = "progress", "result", "user error", "defect"
POLL = 0.02  # s, between two looks for an answer


class CalculationError(ValueError):
    """A calculation was not possible; the text says why, one line per problem."""


class CalculationCancelled(Exception):
    """A calculation was cancelled by the user."""


class Calculator:
    """Hands calculations to the process, one after the other.

    Args:
        folder: the folder that the process works on.
        allowed: effects of files that may run; grows while the process runs.
    """

    def __init__(self, folder: Path, allowed: Sequence[str] = ()):
        self._folder, self._allowed = folder, allowed
        self._context = multiprocessing.get_context("spawn")
        self._process: multiprocessing.Process | None = None
        self._connection = None
        self._lock = asyncio.Lock()
        self._reading = threading.Lock()
        self._asked = 0  # questions so far: the number of the last one
        self._cancelled = False
        self.busy_with = ""

    async def call(self, name: str, *arguments: Any, say: Callable[[str], None] | None = None) -> Any:
        """The answer to a question, see `Calculations`.

        Args:
            name: of the question, such as "campaign.compare".
            arguments: plain data.
            say: called with a sentence on the progress.

        Raises:
            CalculationError: the input is wrong, or the process has ended.
            CalculationCancelled: `cancel` was called.
        """
        async with self._lock:
            self.busy_with, self._cancelled = name, False
            try:
                self._start()
                self._asked += 1
                self._connection.send((self._asked, name, arguments, list(self._allowed)))
                return await self._answer(self._asked, say)
            except (EOFError, OSError) as error:
                self.stop()
                if self._cancelled:
                    raise CalculationCancelled from None
                raise CalculationError(f"the calculating process has ended ({type(error).__name__})") from None
            finally:
                self.busy_with = ""

    async def _answer(self, number: int, say: Callable[[str], None] | None) -> Any:
        """The answer to the question of a number.

        Answers to earlier ones are passed over: who asked them, such as a window that was closed, no longer waits.
        """
        process, connection = self._process, self._connection  # `cancel` closes them
        while True:
            while not connection.poll():
                await asyncio.sleep(POLL)
                if not process.is_alive() and not connection.poll():
                    raise EOFError
            of, kind, value = await asyncio.to_thread(self._receive, connection)
            if of != number:
                continue
            if kind == PROGRESS:
                (say or str)(value)
            elif kind == RESULT:
                return value
            else:
                raise CalculationError(value)

    def _receive(self, connection) -> tuple[int, str, Any]:
        """What has come; number 0 where another thread, whose question was given up, has taken it."""
        with self._reading:
            return connection.recv() if connection.poll() else (0, "", None)

    def warm_up(self) -> None:
        """Start the process, so that it has imported what it needs when the first calculation comes."""
        self._start()

    def cancel(self) -> None:
        """End the present calculation, and the process with it."""
        self._cancelled = True
        self.stop()

    def stop(self) -> None:
        """End the process."""
        process, connection, self._process, self._connection = self._process, self._connection, None, None
        if process is not None:
            process.kill()
            process.join(5.0)
        if connection is not None:
            connection.close()

    def _start(self) -> None:
        if self._process is not None and self._process.is_alive():
            return
        ours, theirs = self._context.Pipe()
        self._process = self._context.Process(target=serve, args=(theirs, str(self._folder)), daemon=True)
        self._process.start()
        theirs.close()
        self._connection = ours


def serve(connection, folder: str) -> None:
    """Calculate what comes through a connection until it is closed: the process itself.

    Args:
        connection: end of a pipe; receives (number, name, arguments, allowed effects), sends (number, kind, value).
        folder: the folder to work on.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C in the terminal ends the server, and that ends this process
    from edhas_jax.workbench.calculations import Calculations, is_user_error

    number = 0
    calculations = Calculations(Path(folder), lambda sentence: connection.send((number, PROGRESS, sentence)))
    with contextlib.suppress(EOFError, BrokenPipeError):
        while True:
            number, name, arguments, allowed = connection.recv()
            try:
                answer = RESULT, calculations.answer(name, arguments, allowed)
            except Exception as error:
                if is_user_error(error):
                    answer = USER_ERROR, str(error)
                else:
                    traceback.print_exc()
                    answer = DEFECT, f"A defect of the program: {type(error).__name__}: {error}"
            connection.send((number, *answer))
