"""A remark on what a file of the user holds."""

import dataclasses
import enum
from pathlib import Path


class Severity(enum.Enum):
    """How serious a remark is."""

    ERROR = "error"  # some data are left out
    WARNING = "warning"  # the data are used as they are, but look wrong
    NOTE = "note"  # information, nothing is wrong


@dataclasses.dataclass(frozen=True)
class Remark:
    """A message about a file; `line` is the line (or row) that it refers to, 0 for the file as a whole."""

    severity: Severity
    file: Path
    line: int
    sentence: str

    def __str__(self):
        place = f"{self.file}:{self.line}" if self.line else str(self.file)
        return f"{place}: {self.sentence}"
