"""Base class of configuration readers: reads single values and collects all problems for one report."""

from collections.abc import Iterable, Mapping
from typing import Any

from edhas_jax.config.run_settings import quantity_text
from edhas_jax.config.yaml_with_lines import KeyPath
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.structs import Parameter
from edhas_jax.core.units import UnitError
from edhas_jax.machine.parameters import ParameterError, parse_value

MAX_LISTED = 50  # problems of one file


def problem_lines(messages: Iterable[str]) -> str:
    """All problems of a file as one text, a line each, every one once; at most `MAX_LISTED` of them."""
    lines = list(dict.fromkeys(messages))
    more = len(lines) - MAX_LISTED
    return "\n".join([*lines[:MAX_LISTED], *([f"and {more:,} more problems like these"] if more > 0 else [])])


class ProblemList:
    """Reads values and collects the problems found on the way, each with the key that causes it.

    Args:
        problems: the list to append to, as pairs of key and message.
    """

    def __init__(self, problems: list[tuple[KeyPath, str]]):
        self.problems = problems

    def add(self, key: KeyPath, message: str) -> None:
        """Append a problem."""
        self.problems.append((key, message))

    def add_unknown_keys(self, key: KeyPath, given: Mapping[str, Any], valid: tuple[str, ...]) -> None:
        """Append a problem for every key of the mapping `given` at `key` that is not among `valid`."""
        for name in given:
            if name not in valid:
                self.add((*key, name), f"unknown key; {suggest(str(name), valid)}")

    def read_quantity(self, key: KeyPath, p: Parameter, value: Any) -> float | None:
        """Read a value of the parameter `p`.

        Returns:
            The value in SI units, or None after a problem.
        """
        try:
            return parse_value(p, quantity_text(p, value))
        except (ParameterError, UnitError) as error:
            self.add(key, str(error))
            return None

    def read_integer(self, key: KeyPath, value: Any, low: int, high: int) -> int:
        """Read a whole number from `low` to `high`.

        Returns:
            The number, or `low` after a problem.
        """
        try:
            number = int(str(value))
        except ValueError:
            number = None
        if number is None or not low <= number <= high:
            got = "it is missing" if value is None else f"got {value}"
            self.add(key, f"a whole number from {low:,} to {high:,} belongs here; {got}")
            return low
        return number
