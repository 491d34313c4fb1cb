"""Problems of a configuration, gathered so that all are told at once."""

from collections.abc import Mapping
from typing import Any

from edhas_jax.config.run_settings import quantity_text
from edhas_jax.config.yaml_with_lines import KeyPath
from edhas_jax.core.names import nearest
from edhas_jax.core.structs import Parameter
from edhas_jax.core.units import UnitError
from edhas_jax.machine.parameters import ParameterError, read_value


class ProblemList:
    """Reads values and gathers problems, each with the key that is to blame."""

    def __init__(self, problems: list[tuple[KeyPath, str]]):
        self.problems = problems

    def add(self, key: KeyPath, what: str) -> None:
        """Note a problem."""
        self.problems.append((key, what))

    def add_unknown_keys(self, key: KeyPath, given: Mapping[str, Any], valid: tuple[str, ...]) -> None:
        """Note the keys that are none of the valid ones."""
        for name in given:
            if name not in valid:
                self.add((*key, name), f"unknown key; {nearest(str(name), valid)}")

    def read_quantity(self, key: KeyPath, p: Parameter, value: Any) -> float | None:
        """A value of a parameter in SI, None when it is a problem."""
        try:
            return read_value(p, quantity_text(p, value))
        except (ParameterError, UnitError) as error:
            self.add(key, str(error))
            return None

    def read_integer(self, key: KeyPath, value: Any, low: int, high: int) -> int:
        """A whole number from `low` to `high`, `low` when it is a problem."""
        try:
            number = int(str(value))
        except ValueError:
            number = None
        if number is None or not low <= number <= high:
            got = "it is missing" if value is None else f"got {value}"
            self.add(key, f"a whole number from {low:,} to {high:,} belongs here; {got}")
            return low
        return number
