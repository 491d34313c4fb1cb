"""Base class of the readers of campaigns: collects all problems for one report."""

from collections.abc import Mapping
from typing import Any

from edhas_jax.config.declared_keys import Quantity
from edhas_jax.config.document import Entry
from edhas_jax.config.yaml_with_lines import KeyPath
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.structs import Parameter


class ProblemList:
    """Collects the problems found on the way, each with the key that causes it."""

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
        """The value of the parameter `p` in SI; None after a problem."""
        return Quantity(p).read(Entry(value, key, self.problems))
