"""What the readers of binary files share: the library of a format, and the error of a file that is damaged."""

import contextlib
import importlib
from collections.abc import Iterator
from types import ModuleType

from edhas_jax.measurements.tables.table import TableError


def reader_library(module: str, what: str, extra: str, otherwise: str) -> ModuleType:
    """The library that reads a format.

    Args:
        module: its name.
        what: the kind of file, such as "an MDF file".
        extra: the extra of this package that installs it.
        otherwise: what else one can do.

    Raises:
        TableError: it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        remedy = f"{otherwise}, or install what reads it: pip install 'edhas_jax[{extra}]'"
        raise TableError(0, f"is {what}; {remedy}") from None


@contextlib.contextmanager
def damaged_unless(what: str) -> Iterator[None]:
    """Within the context a file of this kind is read; a damaged one raises whatever its bytes lead to.

    Raises:
        TableError: the block raised an error that is neither one nor a FileNotFoundError.
    """
    try:
        yield
    except (FileNotFoundError, TableError):
        raise
    except Exception:
        raise TableError(0, f"is damaged or not {what}") from None
