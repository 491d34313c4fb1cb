"""Keys of files, declared once: how a value is read, what is allowed, the default, the meaning.

A file is read by its declarations, and its JSON schema and the tables of its documentation are made from them.
"""

import dataclasses
import enum
import math
import numbers
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from edhas_jax.config.document import Entry
from edhas_jax.config.yaml_with_lines import yaml_type
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.structs import Parameter
from edhas_jax.core.units import UnitError, difference_to_si, format_quantity, to_si
from edhas_jax.machine.parameters import ParameterError

Schema = dict[str, Any]
ROUNDING = 1e-12  # relative, of a limit that is itself a product
QUANTITY: Schema = {"type": ["string", "number"], "description": 'a number with its unit, such as "12 mm"'}


@dataclasses.dataclass(frozen=True)
class Kind:
    """How a value is read, and what is allowed.

    Attributes:
        read: gives the value of an entry; None where it is missing, and after a problem, which is added to the entry.
        schema: JSON schema of draft 2020-12, as plain data.
        allowed: the same in words, for a table.
        keys: the declared keys of the mappings inside; None without any.
        reads_missing: whether a missing value is read as well.
    """

    read: Callable[[Entry], Any]
    schema: Schema
    allowed: str = ""
    keys: "Keys | None" = None
    reads_missing: bool = False


def own_value(schema: Schema, allowed: str = "") -> Kind:
    """A value that the reader of the file reads itself, from its entry."""
    return Kind(lambda entry: entry, schema, allowed, reads_missing=True)


def text_value(what: str = "a text", example: str = "", any_scalar: bool = False) -> Kind:
    """A text, such as the name of a file.

    Args:
        what: what it is, for messages.
        example: such a text, where one is needed.
        any_scalar: whether a number is taken as text.
    """

    def read(entry: Entry) -> str | None:
        if entry.value is None and example:
            return entry.add(f"missing; write for example `{entry.key[-1]}: {example}`")
        if isinstance(entry.value, str | None):
            return entry.value
        if any_scalar and not isinstance(entry.value, Mapping | list | tuple):
            return str(entry.value)
        return entry.add(f"{what} belongs here, not {yaml_type(entry.value)}")

    return Kind(read, {"type": ["string", "number"] if any_scalar else "string"}, what)


def _yes_or_no(entry: Entry) -> bool | None:
    if isinstance(entry.value, bool):
        return entry.value
    return entry.add(f"yes or no belongs here, not {yaml_type(entry.value)}")


YES_NO = Kind(_yes_or_no, {"type": "boolean"}, "yes, no")


def whole_number(low: int, high: int) -> Kind:
    """A whole number from `low` to `high`."""

    def read(entry: Entry) -> int | None:
        try:
            number = int(str(entry.value))
        except ValueError:
            number = None
        if number is not None and low <= number <= high:
            return number
        got = "it is missing" if entry.value is None else f"got {entry.value}"
        return entry.add(f"a whole number from {low:,} to {high:,} belongs here; {got}")

    return Kind(read, {"type": ["integer", "string"], "minimum": low, "maximum": high}, f"{low:,} … {high:,}")


def choice(enumeration: type[enum.Enum], what: str = "") -> Kind:
    """A value of an enumeration; `what` its names stand for."""
    valid = [member.value for member in enumeration]
    names = ", ".join(valid)

    def read(entry: Entry) -> enum.Enum | None:
        value = entry.value
        if isinstance(value, enumeration) or isinstance(value, str) and value in valid:
            return enumeration(value)
        if not what:
            return entry.add(f"one of {names} belongs here; got {'nothing' if value is None else value}")
        if isinstance(value, str):
            return entry.add(f"no {what} `{value}`; one of {names}")
        problem = "missing" if value is None else f"a text belongs here, not {yaml_type(value)}"
        return entry.add(f"{problem}; one of {names}")

    return Kind(read, {"enum": valid}, ", ".join(f"`{name}`" for name in valid))


def quantity(p: Parameter, in_percent: bool = False, reason: str = "") -> Kind:
    """A value of a parameter or setting within its span; read in SI.

    Args:
        p: the declaration.
        in_percent: whether it is a share that is written in per cent.
        reason: a clause on a value above the span.
    """

    def shown(value: float) -> str:
        return f"{100.0 * value:.4g} %" if in_percent else format_quantity(value, p.unit)

    low, high = p.span
    allowed = f"{shown(low)} … {shown(high)}"

    def read(entry: Entry) -> float | None:
        value = _in_si(entry, p.unit, shown(p.default), shown(p.default))
        if value is None or low <= value <= high * (1.0 + ROUNDING):
            return value
        return entry.add(f"must lie in {allowed} ({p.doc}); got {shown(value)}{reason if value > high else ''}")

    if p.unit != "-":
        return Kind(read, {"type": "string"}, allowed)
    return Kind(read, {"type": ["string", "number"], "minimum": low, "maximum": high}, allowed)


def size_in(
    unit: str, example: str = "", least: float = -math.inf, above: bool = False, most: float = math.inf, what: str = "",
    is_difference: bool = False,
) -> Kind:  # fmt: skip
    """A number with its unit that no parameter declares; read in SI.

    Args:
        unit: SI unit.
        example: what may be written; empty for one in the unit of the value.
        least: smallest value.
        above: whether the value must be above `least`.
        most: largest value.
        what: what it is, for messages.
        is_difference: whether "2 °C" is 2 K.
    """
    usual = example or format_quantity(1.0, unit)

    def read(entry: Entry) -> float | None:
        value = _in_si(entry, unit, usual, example, what or "a quantity", is_difference)
        if value is None or (value > least or value == least and not above) and value <= most:
            return value
        limit = f"above {least:g}" if above else f"{least:g} or above"
        if value > most:
            limit = f"at most {100.0 * most:g} %" if example.endswith("%") else f"at most {most:g}"
        subject = f"{what} is" if what else "must be"
        return entry.add(f"{subject} {limit}, for example {usual}; got {entry.value}")

    return Kind(read, {"type": ["string", "number"]}, f"such as `{usual}`")


def _in_si(
    entry: Entry, unit: str, usual: str, example: str, what: str = "a quantity", is_difference: bool = False
) -> float | None:
    """A number with its unit in SI; None after a problem, which names `usual` or `example`."""
    given = entry.value
    if isinstance(given, numbers.Real) and not isinstance(given, bool):
        given = repr(float(given))
    if given is None:
        return entry.add(f"a value is missing; write for example {usual}")
    if not isinstance(given, str):
        return entry.add(f"{what} such as {usual} belongs here, not {yaml_type(given)}")
    try:
        return (difference_to_si if is_difference else to_si)(given, unit, example)
    except UnitError as error:
        return entry.add(str(error))


def list_of(kind: Kind, example: str = "") -> Kind:
    """A list, each of whose entries is of one kind."""

    def read(entry: Entry) -> list[Any] | None:
        return None if entry.value is None else [kind.read(inside) for inside in entry.list(example)]

    schema = {"type": ["array", "null"], "items": kind.schema}
    return Kind(read, schema, f"a list, `{example}`" if example else "a list", kind.keys)


def by_name(kind: Kind, example: str, what: str) -> Kind:
    """A mapping from names of `what`, which only the machine or the campaign knows, to values of one kind."""

    def read(entry: Entry) -> dict[str, Any]:
        return {name: kind.read(inside) for name, inside in entry.mapping(example).items()}

    schema = {"type": ["object", "null"], "additionalProperties": kind.schema}
    return Kind(read, schema, f"by {what}, such as `{example}`", kind.keys, reads_missing=True)


def by_parameter(
    entries: Iterable[Entry], find: Callable[[str], tuple[Parameter, str]]
) -> Iterator[tuple[Entry, Parameter, str]]:
    """Pass over entries whose keys are names of parameters.

    Args:
        entries: the entries.
        find: gives declaration and place of the parameter of a name; raises a ParameterError.

    Yields:
        Entry, declaration and place; a name that is unknown, or the second of one parameter, is a problem instead.
    """
    given: dict[tuple[str, str], str] = {}
    for entry in entries:
        name = str(entry.key[-1])
        try:
            p, place = find(name)
        except ParameterError as error:
            entry.add(str(error))
            continue
        if (place, p.name) in given:
            entry.add(f"given twice, also as {given[place, p.name]}")
            continue
        given[place, p.name] = name
        yield entry, p, place


@dataclasses.dataclass(frozen=True)
class Key:
    """A key of a mapping.

    Attributes:
        kind: how its value is read.
        doc: what it means.
        default: the value where the key is missing or its value wrong.
        needed: whether it may not be missing; its kind then says so.
        shown: the default as text, where it is not simply the value.
    """

    kind: Kind
    doc: str
    default: Any = None
    needed: bool = False
    shown: str = ""

    def default_text(self) -> str:
        """The default, for a table and a schema."""
        default = self.default.value if isinstance(self.default, enum.Enum) else self.default
        text = f"{default:,}" if isinstance(default, int) else default if isinstance(default, str) else ""
        return self.shown or text


@dataclasses.dataclass(frozen=True)
class Keys:
    """A mapping with declared keys.

    Attributes:
        keys: the keys by name.
        example: such a mapping, for messages.
        short: the key that a text alone stands for; empty where a mapping is needed.
        is_open: whether the mapping may have other keys, which its reader checks.
        of_kind: the keys that belong to each value of the key `kind`; empty where there are no kinds.
    """

    keys: Mapping[str, Key]
    example: str = ""
    short: str = ""
    is_open: bool = False
    of_kind: Mapping[enum.Enum, tuple[str, ...]] = dataclasses.field(default_factory=dict)

    @property
    def kind(self) -> Kind:
        """The mapping as the kind of a value."""
        return Kind(self.read, self.schema(), self.example and f"`{self.example}`", self, reads_missing=True)

    @classmethod
    def named(cls, *names: str) -> "Keys":
        """Keys whose values their reader reads itself, as entries."""
        return cls({name: Key(own_value({}), "") for name in names})

    def read(self, entry: Entry) -> dict[str, Any]:
        """The value of each key, or its default; unknown and missing keys are problems."""
        if self.short and isinstance(entry.value, str):
            entry = Entry({self.short: entry.value}, entry.key, entry.problems)
        given, names, is_mapping = entry.mapping(self.example), tuple(self.keys), isinstance(entry.value, Mapping)
        if self.of_kind and is_mapping:
            names = self.of_kind.get(self.keys["kind"].kind.read(entry["kind"]), ())
        if names and not self.is_open:
            self.refuse_others(given, names)
        found = {name: key.default for name, key in self.keys.items()}
        for name in names:
            key = self.keys[name]
            if name in given or key.needed and is_mapping or key.kind.reads_missing:
                value = key.kind.read(entry[name])
                found[name] = key.default if value is None else value
        return found

    def refuse_others(self, given: Mapping[str, Entry], names: Iterable[str] = ()) -> None:
        """Add a problem for each entry whose key is not declared, or not among `names`."""
        valid = tuple(names) or tuple(self.keys)
        for name, inside in given.items():
            if name not in valid:
                inside.add(f"unknown key; {suggest(str(name), valid)}")

    def schema(self, title: str = "") -> Schema:
        """The JSON schema, with a title that of a file."""
        head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": title} if title else {}
        if self.of_kind:
            return head | {"oneOf": [self._schema(names, {"const": k.value}) for k, names in self.of_kind.items()]}
        mapping = self._schema(tuple(self.keys), {})
        return head | ({"anyOf": [{"type": "string"}, mapping]} if self.short else mapping)

    def _schema(self, names: Iterable[str], kind: Schema) -> Schema:
        """The schema of the mapping with some of the keys, one of which is its `kind`."""
        properties, needed = {}, [name for name in names if self.keys[name].needed]
        for name in names:
            key = self.keys[name]
            default = key.default_text()
            about = "; ".join(filter(None, [key.doc, default and f"default: {default}"]))
            form = kind if kind and name == "kind" else key.kind.schema
            properties[name] = form | ({"description": about} if about else {})
        found = {"type": "object", "required": needed} if needed else {"type": ["object", "null"]}
        return found | {"properties": properties} | ({} if self.is_open else {"additionalProperties": False})

    def table(self) -> str:
        """The keys as a table in Markdown; those of an inner mapping stand once, as `outer.inner`."""
        head = ["| key | value | default | meaning |", "| --- | --- | --- | --- |"]
        return "\n".join([*head, *self._rows("", [])])

    def _rows(self, outer: str, shown: "list[Keys]") -> Iterable[str]:
        for name, key in self.keys.items():
            yield f"| `{outer}{name}` | {key.kind.allowed} | {key.default_text()} | {key.doc} |"
            inner = key.kind.keys
            if inner is not None and inner not in shown:
                shown.append(inner)
                yield from inner._rows(f"{outer}{name}.", shown)
