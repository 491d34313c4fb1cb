"""Where in a user's file something stands, and how it is told."""

import inspect
import os
import sys
import traceback
from pathlib import Path


def locate(cls: type, member: str = "", error: BaseException | None = None) -> str:
    """`SealDrag.mover_force (my_effects.py:12)`: the line of the error, else of the method, else of the class."""
    name = f"{cls.__name__}.{member}" if member else cls.__name__
    code = getattr(inspect.unwrap(getattr(cls, member, None)), "__code__", None)
    path = code.co_filename if code else getattr(sys.modules.get(cls.__module__), "__file__", None)
    if path is None:
        return f"{name} ({cls.__module__})"
    line = (error_line(error, path) if error else None) or (code.co_firstlineno if code else _line_of(cls))
    return f"{name} ({display_path(Path(path))}{f':{line}' if line else ''})"


def _line_of(cls: type) -> int | None:
    try:
        return inspect.findsource(cls)[1] + 1
    except (OSError, TypeError):
        return None


def error_line(error: BaseException, path: str) -> int | None:
    """The last line of the file `path` that an error went through."""
    lines = [line for frame, line in traceback.walk_tb(error.__traceback__) if frame.f_code.co_filename == path]
    return lines[-1] if lines else None


def display_path(path: Path) -> str:
    """A path as it is told: relative where it lies under the working directory."""
    relative = os.path.relpath(path)
    return str(path) if relative.startswith("..") else relative


def first_line(error: BaseException) -> str:
    """The first line of an error's text, cut where it is long."""
    text = str(error).strip().split("\n")[0]
    return text if len(text) <= 200 else text[:197] + "…"
