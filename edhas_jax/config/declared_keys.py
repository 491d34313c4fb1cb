"""Keys of files, declared once: how a value is read, what is allowed, the default, the meaning.

A file is read with its declarations, and its JSON schema and the tables of its documentation are made from them.
"""

import dataclasses
import enum
import math
import numbers
from collections.abc import Iterable, Mapping
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


class Kind:
    """How a value is read. Subclasses say what is allowed."""

    def read(self, entry: Entry) -> Any:
        """The value of an entry; None where it is missing, and after a problem, which is added to the entry."""
        raise NotImplementedError

    def schema(self) -> Schema:
        """Its JSON schema, of draft 2020-12."""
        return {}

    def allowed(self) -> str:
        """What is allowed, for a table."""
        return ""


@dataclasses.dataclass(frozen=True)
class Own(Kind):
    """A value that the reader of the file reads itself, from its entry.

    Attributes:
        form: its JSON schema.
        words: what is allowed, for a table.
    """

    form: Schema = dataclasses.field(default_factory=dict)
    words: str = ""

    def read(self, entry: Entry) -> Entry:
        return entry

    def schema(self) -> Schema:
        return self.form

    def allowed(self) -> str:
        return self.words


@dataclasses.dataclass(frozen=True)
class Text(Kind):
    """A text, such as the name of a file.

    Attributes:
        what: what it is, for messages.
        example: such a text, where one is needed.
        any_scalar: whether a number is taken as text.
    """

    what: str = "a text"
    example: str = ""
    any_scalar: bool = False

    def read(self, entry: Entry) -> str | None:
        if entry.value is None and self.example:
            return entry.add(f"missing; write for example `{entry.key[-1]}: {self.example}`")
        if isinstance(entry.value, str | None):
            return entry.value
        if self.any_scalar and not isinstance(entry.value, Mapping | list | tuple):
            return str(entry.value)
        return entry.add(f"{self.what} belongs here, not {yaml_type(entry.value)}")

    def schema(self) -> Schema:
        return {"type": ["string", "number"] if self.any_scalar else "string"}

    def allowed(self) -> str:
        return self.what


class YesNo(Kind):
    """`yes` or `no`."""

    def read(self, entry: Entry) -> bool | None:
        if isinstance(entry.value, bool):
            return entry.value
        return entry.add(f"yes or no belongs here, not {yaml_type(entry.value)}")

    def schema(self) -> Schema:
        return {"type": "boolean"}

    def allowed(self) -> str:
        return "yes, no"


@dataclasses.dataclass(frozen=True)
class Whole(Kind):
    """A whole number from `low` to `high`."""

    low: int
    high: int

    def read(self, entry: Entry) -> int | None:
        try:
            number = int(str(entry.value))
        except ValueError:
            number = None
        if number is not None and self.low <= number <= self.high:
            return number
        got = "it is missing" if entry.value is None else f"got {entry.value}"
        return entry.add(f"a whole number from {self.low:,} to {self.high:,} belongs here; {got}")

    def schema(self) -> Schema:
        return {"type": ["integer", "string"], "minimum": self.low, "maximum": self.high}

    def allowed(self) -> str:
        return f"{self.low:,} … {self.high:,}"


@dataclasses.dataclass(frozen=True)
class Choice(Kind):
    """One of the names of an enumeration.

    Attributes:
        names: the enumeration.
        what: what its names stand for.
    """

    names: type[enum.Enum]
    what: str = ""

    def read(self, entry: Entry) -> enum.Enum | None:
        valid = [choice.value for choice in self.names]
        if isinstance(entry.value, self.names) or isinstance(entry.value, str) and entry.value in valid:
            return self.names(entry.value)
        names = ", ".join(valid)
        if not self.what:
            return entry.add(f"one of {names} belongs here; got {'nothing' if entry.value is None else entry.value}")
        if isinstance(entry.value, str):
            return entry.add(f"no {self.what} `{entry.value}`; one of {names}")
        problem = "missing" if entry.value is None else f"a text belongs here, not {yaml_type(entry.value)}"
        return entry.add(f"{problem}; one of {names}")

    def schema(self) -> Schema:
        return {"enum": [choice.value for choice in self.names]}

    def allowed(self) -> str:
        return ", ".join(f"`{choice.value}`" for choice in self.names)


@dataclasses.dataclass(frozen=True)
class Quantity(Kind):
    """A value of a parameter or setting within its span; read in SI.

    Attributes:
        p: the declaration.
        shown: "%" for a share that is written in per cent.
        reason: a sentence on a value above the span.
    """

    p: Parameter
    shown: str = ""
    reason: str = ""

    def read(self, entry: Entry) -> float | None:
        try:
            value = to_si(self.given(entry.value), self.p.unit, self.text(self.p.default))
        except (ParameterError, UnitError) as error:
            return entry.add(str(error))
        low, high = self.p.span
        if low <= value <= high * (1.0 + ROUNDING):
            return value
        reason = self.reason if value > high else ""
        return entry.add(f"must lie in {self.allowed()} ({self.p.doc}); got {self.text(value)}{reason}")

    def given(self, value: Any) -> str:
        """A value from a file as text.

        Raises:
            ParameterError: it is missing, or neither a text nor a number.
        """
        if isinstance(value, numbers.Real) and not isinstance(value, bool):
            return repr(float(value))
        if isinstance(value, str):
            return value
        example = self.text(self.p.default)
        if value is None:
            raise ParameterError(f"a value is missing; write for example {example}")
        raise ParameterError(f"a quantity such as {example} belongs here, not {yaml_type(value)}")

    def text(self, value: float) -> str:
        """A value (SI) with its unit."""
        return f"{100.0 * value:.4g} %" if self.shown == "%" else format_quantity(value, self.p.unit)

    def schema(self) -> Schema:
        low, high = self.p.span
        dimensionless = self.p.unit == "-"
        return {"type": ["string", "number"], "minimum": low, "maximum": high} if dimensionless else {"type": "string"}

    def allowed(self) -> str:
        return f"{self.text(self.p.span[0])} … {self.text(self.p.span[1])}"


@dataclasses.dataclass(frozen=True)
class Size(Kind):
    """A number with its unit that no parameter declares; read in SI.

    Attributes:
        unit: SI unit.
        example: what may be written; empty for one in the unit of the value.
        least: smallest value; None for any.
        above: whether the value must be above `least`.
        most: largest value.
        what: what it is, for messages.
        is_difference: whether "2 °C" is 2 K.
    """

    unit: str
    example: str = ""
    least: float | None = None
    above: bool = False
    most: float = math.inf
    what: str = ""
    is_difference: bool = False

    def read(self, entry: Entry) -> float | None:
        if isinstance(entry.value, bool | Mapping | list | tuple | None):
            if entry.value is None:
                return entry.add(f"a value is missing; write for example {self._shown()}")
            what = f"{self.what or 'a quantity'} such as {self._shown()}"
            return entry.add(f"{what} belongs here, not {yaml_type(entry.value)}")
        try:
            convert = difference_to_si if self.is_difference else to_si
            value = convert(str(entry.value), self.unit, self.example)
        except UnitError as error:
            return entry.add(str(error))
        too_low = self.least is not None and (value < self.least or self.above and value == self.least)
        if not too_low and value <= self.most:
            return value
        limit = f"{self._least()}" if too_low else f"at most {format_quantity(self.most, self.unit)}"
        subject = f"{self.what} is" if self.what else "must be"
        return entry.add(f"{subject} {limit}, for example {self._shown()}; got {entry.value}")

    def _shown(self) -> str:
        return self.example or format_quantity(1.0, self.unit)

    def _least(self) -> str:
        least = format_quantity(self.least, "-")
        return f"above {least}" if self.above else f"{least} or above"

    def schema(self) -> Schema:
        return {"type": ["string", "number"]}

    def allowed(self) -> str:
        return f"such as `{self._shown()}`"


@dataclasses.dataclass(frozen=True)
class ListOf(Kind):
    """A list, each of whose entries is of one kind."""

    kind: Kind
    example: str = ""

    def read(self, entry: Entry) -> list[Any] | None:
        if entry.value is None:
            return None
        return [self.kind.read(inside) for inside in entry.list(self.example)]

    def schema(self) -> Schema:
        return {"type": ["array", "null"], "items": self.kind.schema()}

    def allowed(self) -> str:
        return f"a list{f', `{self.example}`' if self.example else ''}"


@dataclasses.dataclass(frozen=True)
class ByName(Kind):
    """A mapping from names, which only the machine or the campaign knows, to values of one kind."""

    kind: Kind
    example: str
    what: str = "name"

    def read(self, entry: Entry) -> dict[str, Any]:
        return {name: self.kind.read(inside) for name, inside in entry.mapping(self.example).items()}

    def schema(self) -> Schema:
        return {"type": ["object", "null"], "additionalProperties": self.kind.schema()}

    def allowed(self) -> str:
        return f"by {self.what}, such as `{self.example}`"


@dataclasses.dataclass(frozen=True)
class Key:
    """A key of a mapping.

    Attributes:
        kind: how its value is read.
        doc: what it means.
        default: the value where the key is missing or its value wrong.
        needed: whether it may not be missing; its kind then says so.
        default_text: the default, for a table; None: as the value is written.
    """

    kind: Kind
    doc: str
    default: Any = None
    needed: bool = False
    default_text: str | None = None

    def shown_default(self) -> str:
        """The default, for a table and a schema."""
        if self.default_text is not None or self.default in (None, "", (), False):
            return self.default_text or ("no" if self.default is False else "")
        if isinstance(self.default, enum.Enum):
            return str(self.default.value)
        if isinstance(self.kind, Quantity):
            return self.kind.text(self.default)
        return "yes" if self.default is True else f"{self.default:,}" if isinstance(self.default, int) else ""


@dataclasses.dataclass(frozen=True)
class Keys(Kind):
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
    of_kind: Mapping[Any, tuple[str, ...]] = dataclasses.field(default_factory=dict)

    def read(self, entry: Entry) -> dict[str, Any]:
        """The value of each key, or its default; unknown and missing keys are problems."""
        if self.short and isinstance(entry.value, str):
            entry = Entry({self.short: entry.value}, entry.key, entry.problems)
        given = entry.mapping(self.example)
        found = {name: key.default for name, key in self.keys.items()}
        names = tuple(self.keys)
        if self.of_kind and given:
            names = self.of_kind.get(self.keys["kind"].kind.read(entry["kind"]), ())
        if names and not self.is_open:
            self.refuse_others(given, names)
        for name in names:
            key = self.keys[name]
            is_read = name in given or key.needed and given or isinstance(key.kind, Own | Keys | ByName)
            value = key.kind.read(entry[name]) if is_read else None
            found[name] = key.default if value is None else value
        return found

    def refuse_others(self, given: Mapping[str, Entry], names: Iterable[str] = ()) -> None:
        """Add a problem for each entry whose key is not declared, or not among `names`."""
        valid = tuple(names) or tuple(self.keys)
        for name, inside in given.items():
            if name not in valid:
                inside.add(f"unknown key; {suggest(str(name), valid)}")

    def schema(self) -> Schema:
        if self.of_kind:
            return {"oneOf": [self._schema(names, {"const": kind.value}) for kind, names in self.of_kind.items()]}
        mapping = self._schema(tuple(self.keys), {})
        return {"anyOf": [{"type": "string"}, mapping]} if self.short else mapping

    def _schema(self, names: Iterable[str], kind: Schema) -> Schema:
        """The schema of the mapping with some of the keys, one of which is its `kind`."""
        properties, needed = {}, [name for name in names if self.keys[name].needed]
        for name in names:
            key = self.keys[name]
            default = key.shown_default()
            about = "; ".join(filter(None, [key.doc, default and f"default: {default}"]))
            form = kind if kind and name == "kind" else key.kind.schema()
            properties[name] = form | ({"description": about} if about else {})
        found = {"type": "object", "required": needed} if needed else {"type": ["object", "null"]}
        return found | {"properties": properties} | ({} if self.is_open else {"additionalProperties": False})

    def allowed(self) -> str:
        return f"`{self.example}`" if self.example else ""

    def table(self) -> str:
        """The keys as a table in Markdown, those of inner mappings as `outer.inner`."""
        rows = ["| key | value | default | |", "| --- | --- | --- | --- |"]
        return "\n".join([*rows, *self._rows("")])

    def _rows(self, outer: str) -> Iterable[str]:
        for name, key in self.keys.items():
            yield f"| `{outer}{name}` | {key.kind.allowed()} | {key.shown_default()} | {key.doc} |"
            inner = key.kind.kind if isinstance(key.kind, ListOf | ByName) else key.kind
            if isinstance(inner, Keys):
                yield from inner._rows(f"{outer}{name}.")


def json_schema(title: str, keys: Keys) -> Schema:
    """The JSON schema of a file with these keys, of draft 2020-12, as plain data."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": title} | keys.schema()
