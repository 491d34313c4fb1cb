"""Locations in source files for error messages about classes that a user has written."""

import dis
import inspect
import os
import re
import sys
import traceback
from pathlib import Path

PACKAGE = __name__.partition(".")[0]
MAX_MESSAGE_LENGTH = 200  # characters of an error's message that are quoted


def locate(cls: type, member: str = "", error: BaseException | None = None) -> str:
    """The location of a class or one of its members as text: "SealDrag.mover_force (my_effects.py:12)".

    Args:
        cls: the class.
        member: a method or field of it.
        error: an error raised there; its line is given instead of the first line of the method or class.
    """
    name = f"{cls.__name__}.{member}" if member else cls.__name__
    code = getattr(inspect.unwrap(getattr(cls, member, None)), "__code__", None)
    path = code.co_filename if code else getattr(sys.modules.get(cls.__module__), "__file__", None)
    if path is None:
        return f"{name} ({cls.__module__})"
    line = (error_line(error, path) if error else None) or (code.co_firstlineno if code else _line_of(cls, member))
    return f"{name} ({display_path(Path(path))}{f':{line}' if line else ''})"


def is_users_code(cls: type) -> bool:
    """Whether a class is code of the user, not of this package."""
    return cls.__module__.partition(".")[0] != PACKAGE


def _line_of(cls: type, member: str) -> int | None:
    """The line of a class that assigns `member`, else its first line; None if the source is not available."""
    try:
        lines, first = inspect.getsourcelines(cls)
    except (OSError, TypeError):
        return None
    assigns = re.compile(rf"\s+([\w, ]+, *)?{re.escape(member)}\s*[:=,]")
    return next((first + k for k, line in enumerate(lines) if member and assigns.match(line)), first)


def reraise_interrupt(error: BaseException) -> None:
    """Raise a KeyboardInterrupt again that comes from Ctrl-C; one that the user's code raises itself is its error."""
    if not isinstance(error, KeyboardInterrupt):
        return
    last = error.__traceback__
    while last.tb_next is not None:
        last = last.tb_next
    code = last.tb_frame.f_code
    is_own = code.co_filename.startswith(str(Path(__file__).parents[1]))  # a handler of signals
    if is_own or dis.opname[code.co_code[last.tb_lasti]] != "RAISE_VARARGS":
        raise error


def error_line(error: BaseException, path: str) -> int | None:
    """The innermost line of the file `path` in the traceback of an error, None if it is not in the traceback."""
    lines = [line for frame, line in traceback.walk_tb(error.__traceback__) if frame.f_code.co_filename == path]
    return lines[-1] if lines else None


def display_path(path: Path) -> str:
    """A path as text, relative if it lies under the working directory."""
    relative = os.path.relpath(path)
    return str(path) if relative.startswith("..") else relative


def first_line(error: BaseException) -> str:
    """The first line of an error's message, shortened if it is long."""
    text = str(error).strip().split("\n")[0]
    return text if len(text) <= MAX_MESSAGE_LENGTH else text[: MAX_MESSAGE_LENGTH - 3] + "…"
