"""Tabulated laws as data: files of YAML with numbers and units, read and checked as a whole, and written.

A law may also stand as a mapping in the list `effects` of a configuration, with the same keys.
"""

from pathlib import Path

import numpy as np

from edhas_jax.config.document import Document
from edhas_jax.config.law_reader import LAW_KIND, read_law
from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.core.literal_text import one_line, yaml_text
from edhas_jax.core.source_location import display_path
from edhas_jax.core.units import display_unit, from_si
from edhas_jax.machine.effects import EffectError
from edhas_jax.machine.effects.tabulated_law import LawPlace, LawTable, law_signals, quotient_unit
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.rig_base import Rig

LAW_SUFFIXES = (".yaml", ".yml")
DIGITS = 9  # of numbers in a file that is written


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
    variable_si, value_si = place.variable_unit, place.value_unit
    node_unit, value_unit = law_units(place, float(np.abs(table.values).max()))

    def numbers(values: np.ndarray, si: str, shown: str) -> str:
        return "[" + ", ".join(f"{float(v):.{DIGITS}g}" for v in from_si(np.asarray(values), si, shown)) + "]"

    lines = [f"# {one_line(table.origin)}"] if table.origin else []
    lines += [f"law: {LAW_KIND}", f"name: {yaml_text(table.name)}"]
    lines += [f"origin: {yaml_text(table.origin)}"] if table.origin else []
    lines += [f"slot: {place.slot}  # {place.declaration.doc}", f"variable: {place.variable}"]
    lines += [f"factors: [{', '.join(place.factors)}]"] if place.factors else []
    lines += [f"node_unit: {yaml_text(node_unit or '-')}", f"nodes: {numbers(table.nodes, variable_si, node_unit)}"]
    lines += [f"value_unit: {yaml_text(value_unit or '-')}", f"values: {numbers(table.values, value_si, value_unit)}"]
    if table.std is not None:
        lines.append(f"standard_errors: {numbers(table.std, value_si, value_unit)}")
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
    place = table.place

    def numbers(values: np.ndarray) -> str:
        return "[" + ", ".join(repr(float(v)) for v in values) + "]"

    entries = {"law": LAW_KIND, "name": yaml_text(table.name), "slot": place.slot, "variable": place.variable}
    entries |= {"factors": f"[{', '.join(place.factors)}]"} if place.factors else {}
    entries |= {"node_unit": yaml_text(place.variable_unit), "nodes": numbers(table.nodes)}
    entries |= {"value_unit": yaml_text(place.value_unit), "values": numbers(table.values)}
    return "{" + ", ".join(f"{key}: {value}" for key, value in entries.items()) + "}"
