"""Progress of a command for the program that has started it: a file of lines that the variable EDHAS_PROGRESS names."""

import json
import os
import time
from pathlib import Path

VARIABLE = "EDHAS_PROGRESS"  # names the file; nothing is written without it


class ProgressFile:
    """Appends a line of JSON for each report of progress: `at` [s since 1970], `what`, and `share` done (0 … 1)."""

    def __init__(self):
        named = os.environ.get(VARIABLE)
        self._path = Path(named) if named else None
        self._last: tuple[str, int] | None = None

    def report(self, what: str, share: float | None = None) -> None:
        """Append a line, unless it says the same as the last one; a file that cannot be written ends the reports."""
        shown = what, -1 if share is None else int(100.0 * share)
        if self._path is None or shown == self._last:
            return
        self._last = shown
        line = {"at": time.time(), "what": what} | ({} if share is None else {"share": round(share, 4)})
        try:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line, ensure_ascii=False) + "\n")
        except OSError:
            self._path = None
