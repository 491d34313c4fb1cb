"""Tabulated laws as data: files of YAML with numbers and units, read and checked as a whole, and written.

A law may also stand as a mapping in the list `effects` of a configuration, with the same keys.
"""

import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from edhas_jax.config.declared_keys import Key, Keys, list_of, own_value, text_value
from edhas_jax.config.document import Document, Entry
from edhas_jax.config.yaml_with_lines import yaml_type
from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.core.literal_text import one_line, yaml_text
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.source_location import display_path
from edhas_jax.core.units import UnitError, display_unit, from_si, to_si
from edhas_jax.machine.effects import LIBRARY, EffectError
from edhas_jax.machine.effects.tabulated_law import (
    LAW_SIGNALS,
    LIMITS,
    MAX_NODES,
    MIN_NODES,
    LawPlace,
    LawTable,
    law_signals,
    quotient_unit,
    signals_at,
    slots_of,
)
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.interface.slots import SLOTS, Rule
from edhas_jax.machine.rig_base import Rig

LAW_SUFFIXES = (".yaml", ".yml")
DIGITS = 9  # of numbers in a file that is written
LAW_KIND = "tabulated"  # the value of the key `law`
MAX_FACTORS = 3
_NUMBERS = own_value(list_of(own_value({"type": "number"})).schema, f"{MIN_NODES} … {MAX_NODES} numbers")
_UNIT = own_value({"type": "string"}, "a unit, `-` for none")
LAW = Keys({
    "law": Key(own_value({"enum": [LAW_KIND]}, f"`{LAW_KIND}`"), "what the file is", needed=True),
    "name": Key(own_value({"type": "string"}, "letters, digits, underscores"), "its name; otherwise that of its file",
                needed=True),
    "origin": Key(text_value(), "where it comes from", ""),
    "slot": Key(own_value({"enum": list(SLOTS)}, "a slot"), "where it acts", needed=True),
    "variable": Key(own_value({"enum": list(LAW_SIGNALS)}, "a signal"), "over which it is given", needed=True),
    "factors": Key(own_value(list_of(own_value({"enum": list(LAW_SIGNALS)})).schema | {"maxItems": MAX_FACTORS},
                       f"at most {MAX_FACTORS} signals"), "that multiply it"),
    "node_unit": Key(_UNIT, "of the nodes", needed=True),
    "nodes": Key(_NUMBERS, "values of the variable, which increase", needed=True),
    "value_unit": Key(_UNIT, "of the values, over that of the factors"),
    "values": Key(_NUMBERS, "one for each node", needed=True),
    "standard_errors": Key(_NUMBERS, "of the values"),
}, "{law: tabulated, slot: mover_force, …}")  # fmt: skip


class LawError(EffectError):
    """The file of a tabulated law is wrong; the message has a line for each problem."""


def read_law_file(path: Path | str, rig: type[Rig] | None = None) -> LawTable:
    """Read a tabulated law from a YAML file.

    Args:
        path: the file; without the key `name` its name without suffix names the law.
        rig: the rig of one's own on which the law acts; None for the rigs of the package.

    Raises:
        LawError: the file cannot be read or has problems; all are listed, a line each, with file and line.
    """
    path = Path(path)
    document = Document(path, LawError, f"law: {LAW_KIND}", str(display_path(path)))
    table = read_law(document.top, path.stem, rig)
    document.finish()
    return table


def write_law_file(path: Path | str, table: LawTable) -> Path:
    """Write a tabulated law as a YAML file, in units of convenient size, with nine significant digits.

    Args:
        path: the file; one that exists is replaced.
        table: the law.

    Returns:
        The file.

    Raises:
        OSError: it cannot be written.
    """
    place = table.place
    entries = _entries(table, law_units(place, float(np.abs(table.values).max())), lambda v: f"{v:.{DIGITS}g}")
    entries["slot"] += f"  # {place.declaration.doc}"
    lines = [f"{key}: {value}" for key, value in entries.items()]
    if table.origin:
        lines = [f"# {one_line(table.origin)}", *lines[:2], f"origin: {yaml_text(table.origin)}", *lines[2:]]
    path = Path(path)
    with atomic_write(path) as temporary:
        temporary.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


def law_units(place: LawPlace, largest: float) -> tuple[str, str]:
    """Units of convenient size for the nodes and the values of a law, "" for a plain number.

    Args:
        place: where the law acts.
        largest: magnitude of its values, SI.
    """
    shown = SIGNALS if place.rig is None else place.rig.signals
    node_unit, *divisors = (
        shown[name].display_unit if name in shown else display_unit(law_signals(place.rig)[name])
        for name in (place.variable, *place.factors)
    )
    slot_unit = place.declaration.unit
    if divisors:
        return node_unit, quotient_unit(slot_unit, divisors)
    return node_unit, display_unit(slot_unit, largest or None)


def law_text(table: LawTable) -> str:
    """A tabulated law as one line of YAML, for the list `effects`; it is read back with exactly the same numbers."""
    entries = _entries(table, (table.place.variable_unit, table.place.value_unit), repr)
    return "{" + ", ".join(f"{key}: {value}" for key, value in entries.items() if key != "standard_errors") + "}"


def _entries(table: LawTable, units: tuple[str, str], text: Callable[[float], str]) -> dict[str, str]:
    """What a law has under each key, with nodes and values in these units and numbers as `text` writes them."""
    place, (node_unit, value_unit) = table.place, units

    def numbers(values: np.ndarray, si: str, shown: str) -> str:
        return "[" + ", ".join(text(float(v)) for v in from_si(np.asarray(values), si, shown)) + "]"

    found = {"law": LAW_KIND, "name": yaml_text(table.name), "slot": place.slot, "variable": place.variable}
    found |= {"factors": f"[{', '.join(place.factors)}]"} if place.factors else {}
    found |= {"node_unit": yaml_text(node_unit or "-"), "nodes": numbers(table.nodes, place.variable_unit, node_unit)}
    for key, values in (("values", table.values), ("standard_errors", table.std)):
        if values is not None:
            found |= {"value_unit": yaml_text(value_unit or "-"), key: numbers(values, place.value_unit, value_unit)}
    return found


def read_law(entry: Entry, default_name: str | None, rig: type[Rig] | None = None) -> LawTable | None:
    """Read a tabulated law.

    Args:
        entry: its mapping.
        default_name: name of a law that has none of its own; None if it must have one.
        rig: the rig of one's own on which it acts; None for the rigs of the package.

    Returns:
        The law; None after a problem.
    """
    before, slots = len(entry.problems), slots_of(rig)
    if entry["law"].value != LAW_KIND:
        return entry["law"].add(f"a tabulated law belongs here, with `law: {LAW_KIND}`")
    origin = LAW.read(entry)["origin"]
    name = _read_name(entry["name"], default_name)
    slot = _read_choice(entry["slot"], "slot", slots, next(iter(slots), ""))
    known = None if slot is None else signals_at(slots[slot], rig)
    variable = _read_signal(entry["variable"], known, slot, rig)
    factors = _read_factors(entry["factors"], known, slot, rig)
    node_si = None if variable is None else law_signals(rig)[variable]
    value_si = None
    if slot is not None and None not in factors:
        value_si = LawPlace(slot, variable or "time", factors, rig).value_unit
    nodes = _read_numbers(entry["nodes"], entry["node_unit"], node_si)
    unit = entry["value_unit"]
    values = _read_numbers(entry["values"], unit, value_si)
    std = _read_numbers(entry["standard_errors"], unit, value_si) if "standard_errors" in entry else None
    _check_lengths(entry)
    if nodes is not None:
        given = entry["nodes"].value
        for k in np.flatnonzero(~(np.diff(nodes) > 0.0)) + 1:
            what = f"{given[k]} does not exceed the node before, {given[k - 1]}; nodes must increase"
            entry["nodes"][int(k)].add(what)
    if std is not None and (std < 0.0).any():
        entry["standard_errors"][int(np.argmax(std < 0.0))].add("must not be negative")
    if len(entry.problems) > before:
        return None
    return LawTable(name, LawPlace(slot, variable, factors, rig), nodes, values, std, origin)


def _read_name(entry: Entry, default: str | None) -> str | None:
    given = entry.value
    if given is None and default is not None:
        given = "".join(c if c.isalnum() else "_" for c in default)
    if not isinstance(given, str) or not given.isidentifier():
        return entry.add("a name of letters, digits and underscores belongs here, such as cogging_curve")
    if given in {effect.id for effect in LIBRARY}:
        entry.add(f"`{given}` is an effect of the library; name the law differently, such as {given}_curve")
    return given


def _read_choice(entry: Entry, what: str, valid: Iterable[str], example: str) -> str | None:
    """One of the names `valid`; None after a problem."""
    given, names = entry.value, dict.fromkeys(valid)
    if isinstance(given, str):
        return given if given in names else entry.add(f"no {what} `{given}`; {suggest(given, names)}")
    problem = "missing" if given is None else f"not {yaml_type(given)}"
    return entry.add(f"the name of a {what} belongs here, such as {example}; {problem}")


def _read_signal(entry: Entry, known: tuple[str, ...] | None, slot: str | None, rig: type[Rig] | None) -> str | None:
    """The name of a signal; `known` are those that the slot may know, None where the slot is not known."""
    name = _read_choice(entry, "signal", (*(known or ()), *law_signals(rig)), "piston_position")
    if name is None or known is None or name in known:
        return name
    slots = ", ".join(other.name for other in SLOTS.values() if name in other.local_signals)
    return entry.add(f"`{name}` is not known at the slot {slot}, but at {slots}")


def _read_factors(
    entry: Entry, known: tuple[str, ...] | None, slot: str | None, rig: type[Rig] | None
) -> tuple[str | None, ...]:
    given = entry.value
    if given is None:
        return ()
    if not isinstance(given, list | tuple) or len(given) > MAX_FACTORS:
        return (entry.add(f"a list of at most {MAX_FACTORS} signals belongs here, such as [pressure_drop]"),)
    if given and slot is not None and slots_of(rig)[slot].rule is Rule.SCALE:
        return (entry.add(f"the slot {slot} takes a factor itself; leave `factors` out"),)
    return tuple(_read_signal(inside, known, slot, rig) for inside in entry.list())


def _read_numbers(entry: Entry, unit_entry: Entry, si: str | None) -> np.ndarray | None:
    """A list of numbers in the unit of another key, as an array in SI; None after a problem."""
    if not isinstance(entry.value, list | tuple):
        return entry.add(f"a list of numbers belongs here, not {yaml_type(entry.value)}")
    unit = _read_unit(unit_entry, si)
    values, before = [], len(entry.problems)
    for inside in entry.list():
        item = inside.value
        number = _number(item)
        if number is None or not math.isfinite(number):
            text = f'"{item}"' if isinstance(item, str | int | float) else yaml_type(item)
            inside.add(f"{text} is not a finite number; units belong to `{unit_entry.key[-1]}`")
            continue
        values.append(0.0 if unit is None else to_si(f"{number!r} {unit}".replace(" -", ""), si))
        if not LIMITS[0] < values[-1] < LIMITS[1]:
            inside.add(f"{item} is too large")
    return np.array(values, float) if unit is not None and len(entry.problems) == before else None


def _read_unit(entry: Entry, si: str | None) -> str | None:
    """The unit that a key names; None after a problem, which is listed once."""
    if si is None:
        return None
    given = "-" if entry.value is None and si == "-" else entry.value
    example = display_unit(si) or "-"
    if not isinstance(given, str):
        problem = f"missing; a unit such as {example}" if given is None else f"a unit such as {example} belongs here"
    else:
        try:
            if to_si(f"0 {given}".replace(" -", ""), si, f"0 {example}") == 0.0:
                return given
            problem = f"{given} does not count from zero; write for example {example}"
        except UnitError:
            problem = f"`{given}` is not a unit such as {example}"
    if entry.key not in {key for key, _ in entry.problems}:
        entry.add(problem)
    return None


def _check_lengths(entry: Entry) -> None:
    lists = {n: entry[n].value for n in ("nodes", "values", "standard_errors")}
    counts = {n: len(given) for n, given in lists.items() if isinstance(given, list | tuple)}
    if (nodes := counts.get("nodes")) is None:
        return
    if not MIN_NODES <= nodes <= MAX_NODES:
        entry["nodes"].add(f"{MIN_NODES} to {MAX_NODES} nodes belong here, not {nodes}")
    for name, count in counts.items():
        if count != nodes:
            entry[name].add(f"{count} numbers for {nodes} nodes; one for each node belongs here")


def _number(item: Any) -> float | None:
    try:
        return float(item) if isinstance(item, str | int | float) and not isinstance(item, bool) else None
    except ValueError:
        return None
