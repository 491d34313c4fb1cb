"""Physical quantities as text: conversion to SI on input, and to units of convenient size on output."""

import functools
import math
import re
from fractions import Fraction


class UnitError(ValueError):
    """A text is not a quantity of the required dimension."""


_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(.*)", re.DOTALL)
_INFINITE = re.compile(r"[+-]?\.?(nan|inf|infinity)\b", re.IGNORECASE)
MAX_UNIT_LENGTH = 80  # characters
_SUPERSCRIPTS = re.compile("[⁺⁻]?[⁰¹²³⁴⁵⁶⁷⁸⁹]+")
_PLAIN_DIGITS = str.maketrans("⁺⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "+-0123456789")
# a name, or the end of a group, with a power of at most two digits; the group has none of its own that is large
_POWER = re.compile(r"([^\W\d]|\))\^(?:[+-]?\d{1,2}(?:\.\d{1,2})?|\([+-]?\d{1,2}(?:[./]\d{1,2})?\))(?![\d.^])")
MAX_QUOTED = 60  # characters of a user's text in a message
MAX_EXACT_DIGITS = 400
_FOREIGN_CHARACTER = re.compile(r"[^\w\s*/^()\[\]·°%.'⁺⁻+-]")  # in no unit
_CHARACTER_VARIANTS = str.maketrans({"·": "*", "⋅": "*", "−": "-", "\u00a0": " ", "\u202f": " "})

_DIMENSION_NAMES = {
    "m": "length", "m^2": "area", "m^3": "volume", "kg": "mass", "s": "time", "Hz": "frequency", "N": "force",
    "Pa": "pressure", "V": "voltage", "A": "current", "ohm": "resistance", "H": "inductance", "rad": "angle",
    "m/s": "speed", "m^3/s": "flow", "kg/m^3": "density", "Pa*s": "dynamic viscosity", "N/m": "stiffness",
    "N*s/m": "damping", "K": "temperature", "J": "energy", "W": "power", "m/s^2": "acceleration", "-": "plain number",
}  # fmt: skip


def _prefixed(unit: str, *prefixes: str) -> tuple[tuple[str, float, float], ...]:
    """Rows of `_DISPLAY_UNITS` for a unit with SI prefixes."""
    size = {"G": 1e9, "M": 1e6, "k": 1e3, "": 1.0, "m": 1e-3, "µ": 1e-6, "n": 1e-9}
    return tuple((p + unit, size[p], size[p]) for p in prefixes)


# SI unit → (unit for display, its size in SI, smallest SI magnitude for which it is chosen), the largest first
_DISPLAY_UNITS: dict[str, tuple[tuple[str, float, float], ...]] = {
    "-": (("", 1.0, 0.0),),
    "m": _prefixed("m", "", "m", "µ", "n"),
    "m^2": (("m²", 1.0, 1e-3), ("mm²", 1e-6, 1e-9), ("µm²", 1e-12, 0.0)),
    "m^3": (("m³", 1.0, 0.1), ("L", 1e-3, 1e-3), ("mL", 1e-6, 1e-7), ("mm³", 1e-9, 0.0)),
    "m^3/s": (("L/min", 1.0 / 6e4, 0.0),),
    "m^3/(s*Pa)": (("L/(min·MPa)", 1.0 / 6e10, 0.0),),
    "m/s": (("m/s", 1.0, 0.1), ("mm/s", 1e-3, 0.0)),
    "kg": (("kg", 1.0, 1.0), ("g", 1e-3, 1e-3), ("mg", 1e-6, 0.0)),
    "s": (("s", 1.0, 0.1), ("ms", 1e-3, 1e-3), ("µs", 1e-6, 1e-7), ("ns", 1e-9, 0.0)),
    "Hz": _prefixed("Hz", "M", "k", ""),
    "N": (("MN", 1e6, 1e6), ("kN", 1e3, 1e3), ("N", 1.0, 0.1), ("mN", 1e-3, 1e-3), ("µN", 1e-6, 0.0)),
    "Pa": (("GPa", 1e9, 1e9), ("MPa", 1e6, 1e5), ("kPa", 1e3, 1e2), ("Pa", 1.0, 0.0)),
    "Pa*s": _prefixed("Pa·s", "", "m", "µ"),
    "V": (("kV", 1e3, 1e3), ("V", 1.0, 0.01), ("mV", 1e-3, 0.0)),
    "A": (("kA", 1e3, 1e3), ("A", 1.0, 0.01), ("mA", 1e-3, 0.0)),
    "ohm": _prefixed("ohm", "M", "k", "", "m"),
    "H": _prefixed("H", "", "m", "µ", "n"),
    "W": _prefixed("W", "M", "k", "", "m", "µ"),
    "J": _prefixed("J", "M", "k", "", "m", "µ"),
    "N/m": _prefixed("N/m", "G", "M", "k", ""),
    "V/m": _prefixed("V/m", "M", "k", ""),
    "rad": (("deg", math.pi / 180.0, 0.0),),
}
# rpm as others write it; the registry takes these for frequencies, or does not know them
_PER_MINUTE = ("1/min", "min^-1", "min⁻¹", "U/min", "rev/min")
_USUAL_UNITS = {"m": "mm", "m^2": "mm²", "m^3": "mL", "Pa": "MPa", "rad": "deg"}
_POWERS = str.maketrans("234", "²³⁴")


@functools.lru_cache(maxsize=1)
def _registry():
    """The unit registry."""
    import pint  # takes half a second to import

    return pint.UnitRegistry()


def _is_modest(unit: str) -> bool:
    """Whether a unit text is short and raises nothing but names and groups of names, once, to a small power.

    The registry computes what is written, and "9**9**9" would take for ever.
    """
    text = _SUPERSCRIPTS.sub(lambda m: "^" + m[0].translate(_PLAIN_DIGITS), unit).replace("**", "^")
    text = "".join(text.split())
    if len(text) > MAX_UNIT_LENGTH:
        return False
    without_powers = _POWER.sub(r"\1", text)
    return "^" not in without_powers and not re.search(r"\d{4}", without_powers)


@functools.lru_cache(maxsize=1024)
def _base(unit: str) -> str | None:
    """The base units of a unit text (radian counts as dimensionless), None if it is not a unit."""
    text = "" if unit == "-" else unit.translate(_CHARACTER_VARIANTS)
    # the registry ignores unknown characters: "?m", a "µm" whose first character was lost, would be metres
    if _FOREIGN_CHARACTER.search(text) or not _is_modest(text):
        return None
    try:
        return str(_registry().get_base_units(_registry().parse_units(text))[1])
    except Exception:  # pint parses with Python's tokenizer, which may raise anything
        return None


@functools.lru_cache(maxsize=1024)
def _conversion(given: str, unit: str) -> tuple[Fraction, float] | None:
    """(size, offset) with SI = size × number + offset, None if the dimension of `given` is not that of `unit`."""
    if "".join(given.split()) in _PER_MINUTE and _base(unit) == _base("rad/s"):
        given = "rpm"
    if _base(given) is None or _base(given) != _base(unit):
        return None
    ureg = _registry()
    source, target = (ureg.parse_units("" if u == "-" else u.translate(_CHARACTER_VARIANTS)) for u in (given, unit))
    try:
        converted = [float(ureg.Quantity(x, source).to(target).magnitude) for x in (0.0, 1.0, 2.0)]
    except Exception:
        return None
    size, offset = converted[1] - converted[0], converted[0]
    if not size > 0.0 or not math.isclose(converted[2] - converted[1], size, rel_tol=1e-9):
        return None
    inverse = 1.0 / size
    # an exact fraction, so that "20 µm" gives exactly the float 20e-6
    if offset == 0.0 and inverse > 1.5 and math.isclose(inverse, round(inverse), rel_tol=1e-12):
        return Fraction(1, round(inverse)), 0.0
    return Fraction(size), offset


def to_si(text: str, unit: str, example: str = "") -> float:
    """The SI value of a quantity such as "12 mm".

    Args:
        text: number and unit; a number alone is accepted only if `unit` is "-".
        unit: SI unit of the required dimension.
        example: a quantity of this dimension for messages.

    Raises:
        UnitError: no number, not finite, no unit, an unknown unit, a unit of another dimension.
    """
    if _base(unit) is None:
        raise UnitError(f'"{unit}" is not a unit')
    given = str(text).translate(_CHARACTER_VARIANTS).strip()
    text = _shortened(str(text))
    match = _NUMBER.fullmatch(given)
    if _INFINITE.match(given):
        raise UnitError(f'"{text}" is not a finite number; {_hint(unit, example)}')
    if match is None:
        raise UnitError(f'"{text}" is not a quantity; {_hint(unit, example)}')
    number, given_unit = match[1], match[2].strip()
    if given_unit.startswith(","):
        raise UnitError(f'"{text}" has a decimal comma; write "{text.replace(",", ".", 1)}"')
    if not math.isfinite(float(number)):
        raise UnitError(f'"{text}" is not a finite number; {_hint(unit, example)}')
    if not given_unit and unit != "-":
        raise UnitError(f"a unit is missing; {_hint(unit, example or format_quantity(_usual(number, unit), unit))}")
    conversion = _conversion(given_unit or "-", unit)
    if conversion is None:
        raise UnitError(_mismatch(text, given_unit, unit, example))
    size, offset = conversion
    try:
        value = float(_exact(number) * size) + offset
    except OverflowError:
        raise UnitError(f'"{text}" is not a finite number; {_hint(unit, example)}') from None
    return value


def difference_to_si(text: str, unit: str, example: str = "") -> float:
    """The SI value of a difference or standard deviation, such as "2 °C", which is 2 K; arguments as of `to_si`."""
    value = to_si(text, unit, example)
    given = _NUMBER.fullmatch(str(text).translate(_CHARACTER_VARIANTS).strip())[2].strip()
    return value - _conversion(given or "-", unit)[1]


def from_si(value, unit: str, shown: str):
    """Convert a value (or array) in the SI unit `unit` to the unit `shown`.

    Raises:
        UnitError: `shown` is not a unit of this dimension.
    """
    conversion = _conversion(shown or "-", unit)
    if conversion is None:
        raise UnitError(_mismatch(shown, shown, unit, ""))
    size, offset = conversion
    if offset == 0.0 and size.numerator == 1:
        return value * size.denominator
    return (value - offset) / float(size)


def values_to_si(values, unit: str, si: str, example: str = ""):
    """Convert a value (or array) in a unit to the SI unit `si`; errors and example as of `to_si`."""
    zero = to_si(f"0 {unit}", si, example)
    return zero + (to_si(f"1 {unit}", si) - zero) * values


def is_unit_of(unit: str, si: str) -> bool:
    """Whether a text is a unit of the dimension of an SI unit."""
    return _conversion(unit or "-", si) is not None


def display_unit(unit: str, value: float | None = None) -> str:
    """The unit for display of a quantity in the SI unit `unit` of this magnitude; without a value, the usual one."""
    return _USUAL_UNITS.get(unit, _display_row(unit, 1.0)[0]) if value is None else _display_row(unit, value)[0]


def unit_text(unit: str) -> str:
    """A unit as it stands behind numbers and in titles: nothing for a number without one ("-")."""
    return "" if unit == "-" else unit


def format_quantity(value: float, unit: str) -> str:
    """A value in SI as text with four significant digits and a suitable prefix: "12 mm", "0.2 MPa", "20 µm"."""
    shown, size, _ = _display_row(unit, float(value))
    return f"{format_number(float(value) / size)} {shown}".rstrip()


def format_result(value: float, unit: str, shown: str) -> str:
    """A result in SI as text: in per cent where that is what it is `shown` in, else as of `format_quantity`."""
    return f"{format_number(from_si(value, unit, shown))} %" if shown == "%" else format_quantity(value, unit)


def format_number(value: float, digits: int = 4) -> str:
    """A number with at most `digits` significant digits, without exponent where that is short."""
    if not math.isfinite(value):
        return str(value)
    rounded = float(f"{value:.{digits}g}")
    if rounded == 0.0:
        return "0"
    if 1e-4 <= abs(rounded) < 1e6:
        places = max(0, digits - 1 - math.floor(math.log10(abs(rounded))))
        text = f"{rounded:.{places}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    mantissa, exponent = f"{rounded:.{digits - 1}e}".split("e")
    return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"


def exact_quantity(value: float, unit: str) -> str:
    """A value in SI as the shortest text that `to_si` converts back exactly; in the SI unit if no other does."""
    value = float(value)
    shown, _, _ = _display_row(unit, value)
    for digits in (4, 6, 9, 12, 15, 17):
        text = f"{format_number(from_si(value, unit, shown), digits)} {shown}".rstrip()
        if to_si(text, unit) == value:
            return text
    return repr(value) if unit == "-" else f"{value!r} {_plain(unit)}"


def with_article(word: str) -> str:
    """The word with its indefinite article: "an angle", "a length"."""
    return f"an {word}" if word[0].lower() in "aeiou" else f"a {word}"


def _usual(number: str, unit: str) -> float:
    """A number without unit as an example for a message, in the unit in which it was most likely meant."""
    return float(exact * _conversion(display_unit(unit), unit)[0]) if (exact := _exact(number)) else 1.0


def _exact(number: str) -> Fraction:
    """The number in a text as a fraction; a float where it has far more digits, or is 1e-99999999."""
    rounded = float(number)
    return Fraction(number) if rounded and len(number) <= MAX_EXACT_DIGITS else Fraction(rounded)


def _shortened(text: str) -> str:
    """A text for a message, cut if it is long."""
    return text if len(text) <= MAX_QUOTED else f"{text[:MAX_QUOTED]}…"


def _plain(unit: str) -> str:
    """A unit text with raised powers and multiplication dots: "m^3/(s*Pa)" as "m³/(s·Pa)"."""
    return re.sub(r"\^([234])", lambda m: m[1].translate(_POWERS), unit).replace("*", "·")


def _display_row(unit: str, value: float) -> tuple[str, float, float]:
    """The row of `_DISPLAY_UNITS` for a value in SI."""
    rows = _DISPLAY_UNITS.get(unit, ((_plain(unit), 1.0, 0.0),))
    if value == 0.0:
        return next((r for r in rows if r[1] == 1.0), rows[0])
    # with a tolerance: 1e-3 m is 1 mm even if rounding made it 0.0009999999999999998
    return next((r for r in rows if abs(value) >= r[2] * (1.0 - 1e-9)), rows[-1])


def _hint(unit: str, example: str) -> str:
    """What to write, for an error message."""
    if unit == "-":
        return f'write a plain number, for example "{example or "0.65"}"'
    word = _DIMENSION_NAMES.get(unit)
    kind = f"any unit of {word}" if word else f"any unit that converts to {_plain(unit)}"
    return f'write for example "{example or format_quantity(1.0, unit)}" ({kind})'


def _mismatch(text: str, given: str, unit: str, example: str) -> str:
    """The message for a unit of another dimension, or an unknown one."""
    base = _base(given)
    if base is None and not _is_modest(given):
        shown = given if len(given) <= MAX_UNIT_LENGTH else given[:MAX_UNIT_LENGTH] + "…"
        what = f"a unit has at most {MAX_UNIT_LENGTH} characters, powers of names up to 99, and no powers of numbers"
        return f'"{shown}" is not computed: {what}; {_hint(unit, example)}'
    if base is None:
        return f'unknown unit "{given}" in "{text}"; {_hint(unit, example)}'
    given_name = next((w for u, w in _DIMENSION_NAMES.items() if _base(u) == base), None)
    needed = _DIMENSION_NAMES.get(unit)
    if unit in ("Hz", "1/s") and base == _base("rad/s"):
        return f'"{text}" counts angle, not cycles (60 rpm is 1 Hz); {_hint(unit, example)}'
    if given_name and needed and given_name != needed:
        return f'"{text}" is {with_article(given_name)}, not {with_article(needed)}; {_hint(unit, example)}'
    return f'"{text}" does not convert to {needed and with_article(needed) or _plain(unit)}; {_hint(unit, example)}'


def format_with_error(value: float, error: float, unit: str) -> str:
    """A value in SI with two digits of its standard error, in the unit that suits the value: "0.80020 ± 0.00038 V".

    A power of ten is common to both: "(4.0010 ± 0.0016)e-13 m³/Pa".
    """
    shown = display_unit(unit, value)
    number, spread = from_si(value, unit, shown), from_si(error, unit, shown) - from_si(0.0, unit, shown)
    size = max(abs(number), spread)
    if size > 0.0 and not 1e-4 <= size < 1e6:
        exponent = math.floor(math.log10(size))
        scale = 10.0**exponent
        return f"({format_with_error(number / scale, spread / scale, '-')})e{exponent} {shown}".rstrip()
    if not spread > 0.0:
        return f"{number:.4f} ± {spread:.2g} {shown}".rstrip()
    digits = min(7, 1 - math.floor(math.log10(spread)))  # two of the error; both end at the same place
    texts = (f"{round(x, digits):.{max(digits, 0)}f}" for x in (number, spread))
    return f"{' ± '.join(texts)} {shown}".rstrip()


def estimate_text(value: float, error: float | None, unit: str, limit: str | None = None) -> str:
    """An estimate (SI) with its standard error, or with the limit at which it lies: "0 V, its lower limit"."""
    if limit:
        return f"{format_quantity(value, unit)}, its {limit} limit"
    return format_quantity(value, unit) if error is None else format_with_error(value, error, unit)
