"""Optional parts of a result: one that fails costs a sentence, never the result."""

import traceback
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from edhas_jax.core.source_location import display_path, first_line

T = TypeVar("T")


class OptionalParts:
    """Computes the optional parts of a result and keeps a sentence on each that failed.

    Attributes:
        failures: a sentence for each part that failed, in the order of the attempts.
    """

    def __init__(self):
        self.failures: list[str] = []

    def attempt(self, what: str, compute: Callable[[], T]) -> T | None:
        """The value of one part; None where it failed.

        Args:
            what: the part, as the subject of a sentence: "The next experiment".
            compute: computes or writes the part. Any error but an interruption by the user counts as a failure.
        """
        try:
            return compute()
        except Exception as error:
            self.failures.append(failure_sentence(what, error))
            return None


def failure_sentence(what: str, error: Exception) -> str:
    """A sentence on a part that failed, with the kind of the error, its message and its place in the code."""
    frames = traceback.extract_tb(error.__traceback__)
    place = f", {display_path(Path(frames[-1].filename))}:{frames[-1].lineno}" if frames else ""
    return f"{what} could not be made: {first_line(error) or 'no message'} ({type(error).__name__}{place})."
