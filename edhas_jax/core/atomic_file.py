"""Files that are either whole or not there, whatever stops the process that writes them."""

import contextlib
import os
import uuid
from collections.abc import Iterator
from pathlib import Path

PARTIAL_SUFFIX = ".partial"  # how the names of files that are being written end


@contextlib.contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """A path beside `path` to write to; what was written there takes its place in the end, or is gone if that failed.

    Raises:
        OSError: the file cannot be written.
    """
    beside = path.with_name(f".{path.name}.{uuid.uuid4().hex[:12]}{PARTIAL_SUFFIX}")
    try:
        yield beside
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)
