"""Progress of a command: a bar in a terminal, a line every few seconds where there is none, and a file for programs."""

import json
import os
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from edhas_jax.commands.console import PlainConsole
from edhas_jax.core.literal_text import terminal_text

LINE_INTERVAL = 5.0  # s, between lines where there is no terminal
FIRST_LINE = 2.0  # s after the program has begun, so that no one waits longer without a word
VARIABLE = "EDHAS_PROGRESS"  # names a file of progress for the program that has started the command


class WorkProgress:
    """Shows what a command is doing, on the standard error and in the file of progress; a context manager.

    Args:
        options: of the command line; with `--quiet` nothing is shown on the standard error.
        sentence: what is done first.
    """

    def __init__(self, options=None, sentence: str = "reading"):
        self._quiet, self._bar, self._task = getattr(options, "quiet", False), None, None
        self._sentence = sentence
        self._next_line = getattr(options, "began", time.monotonic()) + FIRST_LINE
        self._file, self._last = os.environ.get(VARIABLE) or None, None

    def __enter__(self) -> "WorkProgress":
        self._report()
        if not self._quiet and sys.stderr.isatty():
            from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn

            text = TextColumn("{task.description}", markup=False)
            columns = SpinnerColumn(), text, BarColumn(), TimeRemainingColumn()
            self._bar = Progress(*columns, transient=True, console=PlainConsole(stderr=True))
            self._task = self._bar.add_task(terminal_text(self._sentence), total=None)
            self._bar.start()
        self._line(self._sentence)
        return self

    def __exit__(self, *_) -> None:
        if self._bar is not None:
            self._bar.stop()

    def __call__(self, sentence: str, share: float | None = None) -> None:
        """Show what is being done, and the share of it that is done, 0 … 1, where it is known."""
        self._sentence = sentence
        self._report(share)
        if self._bar is not None:
            known = {} if share is None else {"total": 1.0, "completed": share}
            self._bar.update(self._task, description=terminal_text(sentence), **known)
        self._line(sentence, share)

    def _line(self, sentence: str, share: float | None = None) -> None:
        """Print a line where there is no terminal and none was printed for a while."""
        if self._bar is None and not self._quiet and time.monotonic() > self._next_line:
            self._next_line = time.monotonic() + LINE_INTERVAL
            done = "" if share is None else f", {100.0 * share:.0f} %"
            print(terminal_text(f"edhas: {sentence}{done}"), file=sys.stderr, flush=True)

    def numbers(self, numbers: Mapping[str, Any]) -> None:
        """Hand numbers on the present work to the program that has started the command."""
        self._report(numbers=numbers)

    def share(self, share: float) -> None:
        """Show the share of the present work that is done, 0 … 1."""
        self(self._sentence, share)

    def _report(self, share: float | None = None, numbers: Mapping[str, Any] | None = None) -> None:
        """Append a line of JSON to the file of progress, unless it says the same as the last one.

        It has `at` [s since 1970], `what`, the `share` done (0 … 1) and `numbers` (SI). A file that cannot be written
        ends the reports.
        """
        shown = self._sentence, -1 if share is None else int(100.0 * share)
        if self._file is None or (shown == self._last and numbers is None):
            return
        self._last = shown
        line = {"at": time.time(), "what": self._sentence} | ({} if share is None else {"share": round(share, 4)})
        line |= {} if numbers is None else {"numbers": dict(numbers)}
        try:
            with Path(self._file).open("a", encoding="utf-8") as file:
                file.write(json.dumps(line, ensure_ascii=False) + "\n")
        except OSError:
            self._file = None
