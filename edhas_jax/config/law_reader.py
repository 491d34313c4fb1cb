"""Reads the mapping of a tabulated law in one pass, and collects what is wrong with it."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from edhas_jax.config.problem_list import ProblemList
from edhas_jax.config.yaml_with_lines import KeyPath, yaml_type
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.units import UnitError, display_unit, to_si
from edhas_jax.machine.effects import LIBRARY, EffectError
from edhas_jax.machine.effects.tabulated_law import (
    LIMITS,
    MAX_NODES,
    MIN_NODES,
    LawPlace,
    LawTable,
    law_signals,
    signals_at,
    slots_of,
)
from edhas_jax.machine.interface.slots import SLOTS, Rule
from edhas_jax.machine.rig_base import Rig

LAW_KEYS = (
    "law", "name", "origin", "slot", "variable", "factors", "node_unit", "nodes", "value_unit", "values",
    "standard_errors",
)  # fmt: skip
LAW_KIND = "tabulated"  # the value of the key `law`
MAX_FACTORS = 3


class LawError(EffectError):
    """A tabulated law is wrong; `problems` holds key and message of every problem."""

    def __init__(self, problems: list[tuple[KeyPath, str]], message: str):
        super().__init__(message)
        self.problems = problems


class LawReader(ProblemList):
    """Reads the mapping of a tabulated law in one pass.

    Args:
        data: the mapping.
        default_name: name of a law that has none of its own; None if it must have one.
        rig: the rig of one's own on which it acts; None for the rigs of the package.
    """

    def __init__(self, data: Mapping[str, Any], default_name: str | None, rig: type[Rig] | None = None):
        super().__init__([])
        self._data, self._rig, slots = data, rig, slots_of(rig)
        if data.get("law") != LAW_KIND:
            self.add(("law",), f"a tabulated law belongs here, with `law: {LAW_KIND}`")
            return
        self.add_unknown_keys((), data, LAW_KEYS)
        self._name = self._read_name(default_name)
        self._slot = self._read_choice(("slot",), "slot", data.get("slot"), slots, next(iter(slots), ""))
        known = None if self._slot is None else signals_at(slots[self._slot], rig)
        self._variable = self._read_signal(("variable",), data.get("variable"), known)
        self._factors = self._read_factors(data.get("factors"), known)
        node_si = value_si = None
        if self._variable is not None:
            node_si = law_signals(rig)[self._variable]
        if self._slot is not None and None not in self._factors:
            value_si = LawPlace(self._slot, self._variable or "time", self._factors, rig).value_unit
        self._nodes = self._read_numbers("nodes", "node_unit", node_si)
        self._values = self._read_numbers("values", "value_unit", value_si)
        self._std = self._read_numbers("standard_errors", "value_unit", value_si) if "standard_errors" in data else None
        self._check_lengths()
        self._check_order()
        self._origin = data.get("origin") or ""
        if not isinstance(self._origin, str):
            self.add(("origin",), f"a text belongs here, not {yaml_type(self._origin)}")

    def table(self) -> LawTable:
        """The law; only if there are no problems."""
        place = LawPlace(self._slot, self._variable, self._factors, self._rig)
        return LawTable(self._name, place, self._nodes, self._values, self._std, self._origin)

    def _read_name(self, default: str | None) -> str:
        given = self._data.get("name")
        if given is None and default is not None:
            given = "".join(c if c.isalnum() else "_" for c in default)
        if not isinstance(given, str) or not given.isidentifier():
            self.add(("name",), "a name of letters, digits and underscores belongs here, such as cogging_curve")
            return ""
        if given in {effect.id for effect in LIBRARY}:
            self.add(
                ("name",), f"`{given}` is an effect of the library; name the law differently, such as {given}_curve"
            )
        return given

    def _read_choice(self, key: KeyPath, what: str, given: Any, valid: Iterable[str], example: str) -> str | None:
        """One of the names `valid`; None after a problem."""
        names = dict.fromkeys(valid)
        if isinstance(given, str):
            if given in names:
                return given
            self.add(key, f"no {what} `{given}`; {suggest(given, names)}")
        else:
            problem = "missing" if given is None else f"not {yaml_type(given)}"
            self.add(key, f"the name of a {what} belongs here, such as {example}; {problem}")
        return None

    def _read_signal(self, key: KeyPath, given: Any, known: tuple[str, ...] | None) -> str | None:
        """The name of a signal; `known` are those that the slot may know, None where the slot is not known."""
        name = self._read_choice(key, "signal", given, (*(known or ()), *law_signals(self._rig)), "piston_position")
        if name is None or known is None or name in known:
            return name
        slots = ", ".join(slot.name for slot in SLOTS.values() if name in slot.local_signals)
        self.add(key, f"`{name}` is not known at the slot {self._slot}, but at {slots}")
        return None

    def _read_factors(self, given: Any, known: tuple[str, ...] | None) -> tuple[str | None, ...]:
        if given is None:
            return ()
        if not isinstance(given, list | tuple) or len(given) > MAX_FACTORS:
            self.add(("factors",), f"a list of at most {MAX_FACTORS} signals belongs here, such as [pressure_drop]")
            return (None,)
        if given and self._slot is not None and slots_of(self._rig)[self._slot].rule is Rule.SCALE:
            self.add(("factors",), f"the slot {self._slot} takes a factor itself; leave `factors` out")
            return (None,)
        return tuple(self._read_signal(("factors", k), name, known) for k, name in enumerate(given))

    def _read_numbers(self, name: str, unit_key: str, si: str | None) -> np.ndarray | None:
        """A list of numbers in the unit of the key `unit_key`, as an array in SI; None after a problem."""
        given = self._data.get(name)
        if not isinstance(given, list | tuple):
            self.add((name,), f"a list of numbers belongs here, not {yaml_type(given)}")
            return None
        unit = self._read_unit(unit_key, si)
        values, before = [], len(self.problems)
        for k, item in enumerate(given):
            number = None if isinstance(item, bool) else _number(item)
            if number is None or not math.isfinite(number):
                text = f'"{item}"' if isinstance(item, str | int | float) else yaml_type(item)
                self.add((name, k), f"{text} is not a finite number; units belong to `{unit_key}`")
                continue
            values.append(0.0 if unit is None else to_si(f"{number!r} {unit}".replace(" -", ""), si))
            if not LIMITS[0] < values[-1] < LIMITS[1]:
                self.add((name, k), f"{item} is too large")
        return np.array(values, float) if unit is not None and len(self.problems) == before else None

    def _read_unit(self, key: str, si: str | None) -> str | None:
        """The unit that a key names; None after a problem, which is listed once."""
        if si is None:
            return None
        given = self._data.get(key, "-" if si == "-" else None)
        example = display_unit(si) or "-"
        if not isinstance(given, str):
            message = (
                f"missing; a unit such as {example}" if given is None else f"a unit such as {example} belongs here"
            )
        else:
            try:
                if to_si(f"0 {given}".replace(" -", ""), si, f"0 {example}") == 0.0:
                    return given
                message = f"{given} does not count from zero; write for example {example}"
            except UnitError:
                message = f"`{given}` is not a unit such as {example}"
        if (key,) not in {known for known, _ in self.problems}:
            self.add((key,), message)
        return None

    def _check_lengths(self) -> None:
        lists = {n: self._data[n] for n in ("nodes", "values", "standard_errors") if n in self._data}
        counts = {n: len(given) for n, given in lists.items() if isinstance(given, list | tuple)}
        nodes = counts.get("nodes")
        if nodes is None:
            return
        if not MIN_NODES <= nodes <= MAX_NODES:
            self.add(("nodes",), f"{MIN_NODES} to {MAX_NODES} nodes belong here, not {nodes}")
        for name, count in counts.items():
            if count != nodes:
                self.add((name,), f"{count} numbers for {nodes} nodes; one for each node belongs here")

    def _check_order(self) -> None:
        if self._nodes is not None:
            for k in np.flatnonzero(~(np.diff(self._nodes) > 0.0)) + 1:
                given = self._data["nodes"]
                self.add(
                    ("nodes", int(k)),
                    f"{given[k]} does not exceed the node before, {given[k - 1]}; nodes must increase",
                )
        if self._std is not None and (self._std < 0.0).any():
            self.add(("standard_errors", int(np.argmax(self._std < 0.0))), "must not be negative")


def _number(item: Any) -> float | None:
    try:
        return float(item) if isinstance(item, str | int | float) else None
    except ValueError:
        return None
