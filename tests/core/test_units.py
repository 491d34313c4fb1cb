"""Conversion of quantities between text and SI, and their display."""

import math

import pytest

from edhas_jax.core.units import (
    UnitError,
    display_unit,
    exact_quantity,
    format_quantity,
    format_with_error,
    from_si,
    to_si,
)


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("12 mm", "m", 12e-3),
        ("0.2 MPa", "Pa", 0.2e6),
        ("2 bar", "Pa", 2e5),
        ("15um", "m", 15e-6),
        ("15 µm", "m", 15e-6),
        ("15 μm", "m", 15e-6),
        ("4.2 mm^2", "m^2", 4.2e-6),
        ("4.2 mm²", "m^2", 4.2e-6),
        ("1.1 mH", "H", 1.1e-3),
        ("24.61 N/A", "N/A", 24.61),
        ("20 N·s/m", "N*s/m", 20.0),
        ("20 N*s/m", "N*s/m", 20.0),
        ("5 Hz", "Hz", 5.0),
        ("5 1/s", "Hz", 5.0),
        ("45 deg", "rad", math.pi / 4),
        ("0.5 %", "-", 0.005),
        ("0.65", "-", 0.65),
        ("1e-3", "-", 1e-3),
        ("40 °C", "K", 313.15),
        ("-3 mm", "m", -3e-3),
        ("6 L/(min·MPa)", "m^3/(s*Pa)", 1e-10),
        ("1.41 Ω", "ohm", 1.41),
        ("600 1/min", "rad/s", 20.0 * math.pi),
        ("60 U/min", "rad/s", 2.0 * math.pi),
        ("60 1/min", "Hz", 1.0),
    ],
)
def test_to_si_is_exact(text, unit, value):
    assert to_si(text, unit) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "unit", "message_part"),
    [
        ("12", "m", 'a unit is missing; write for example "12 mm" (any unit of length)'),
        ("4", "rad", "a unit is missing"),
        ("12 N", "m", '"12 N" is a force, not a length'),
        ("45 deg", "-", "is an angle, not a plain number"),
        ("600 rpm", "Hz", "60 rpm is 1 Hz"),
        ("5 MPA", "Pa", 'unknown unit "MPA"'),
        ("3 dB", "-", "does not convert"),
        ("1,5 mm", "m", 'write "1.5 mm"'),
        ("nan m", "m", "not a finite number"),
        (".inf", "-", "not a finite number"),
        ("1e999 m", "m", "not a finite number"),
        ("1e308 km", "m", "not a finite number"),
        ("abc", "m", "not a quantity"),
        ("", "m", "not a quantity"),
        ("5 ?m", "m", 'unknown unit "?m"'),  # a µ that was lost on the way
        ("5 \ufffdm", "m", "unknown unit"),
        ("5 m\0", "m", "unknown unit"),
        ("9" * 5000, "m", '9…" is not a finite number'),
        ("1e-99999999", "m", "a unit is missing"),
        ("0." + "1" * 5000, "m", "a unit is missing"),
        ("5 " + "x" * 5000, "m", "a unit has at most"),
        ("x" * 5000, "m", "not a quantity"),
        ("5 m", "bogus", '"bogus" is not a unit'),
    ],
)
def test_to_si_refuses(text, unit, message_part):
    with pytest.raises(UnitError) as caught:
        to_si(text, unit)
    assert message_part in str(caught.value) and len(str(caught.value)) < 300


def test_a_tiny_exponent_does_not_hang():
    assert to_si("1e-999999999 m", "m") == 0.0


def test_a_number_of_many_digits():
    assert to_si("0." + "1" * 5000 + " mm", "m") == pytest.approx(1e-3 / 9.0, rel=1e-15)


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (12e-3, "m", "12 mm"),
        (0.2e6, "Pa", "0.2 MPa"),
        (20e-6, "m", "20 µm"),
        (0.95 / 6e4, "m^3/s", "0.95 L/min"),
        (4e-3, "kg", "4 g"),
        (4.2e-6, "m^2", "4.2 mm²"),
        (20e-6, "m^3", "20 mL"),
        (math.pi / 4, "rad", "45 deg"),
        (1.23456, "ohm", "1.235 ohm"),
        (0.0, "m", "0 m"),
        (0.65, "-", "0.65"),
        (2e-12, "1/Pa", "2e-12 1/Pa"),
        (-3e-3, "m", "-3 mm"),
    ],
)
def test_format_quantity(value, unit, text):
    assert format_quantity(value, unit) == text


@pytest.mark.parametrize("value", [1 / 3, 20e-6, 1e-13, 101325.0, 12345.678901234567, 0.0, -2.5e-3])
@pytest.mark.parametrize("unit", ["m", "Pa", "m^2", "m^3", "kg", "rad", "m^3/s", "N*s/m", "-", "V/(m*s)", "1/s", "s/m"])
def test_exact_quantity_reads_back(value, unit):
    assert to_si(exact_quantity(value, unit), unit) == pytest.approx(value, rel=1e-15, abs=0.0)


def test_from_si_and_shown_unit():
    assert from_si(0.012, "m", "mm") == pytest.approx(12.0)
    assert from_si(313.15, "K", "°C") == pytest.approx(40.0)
    assert display_unit("m") == "mm"
    assert display_unit("m", 20e-6) == "µm"
    with pytest.raises(UnitError):
        from_si(1.0, "m", "kg")


def test_an_error_is_shown_in_the_unit_of_its_value():
    assert format_with_error(0.8002, 3.8e-4, "V") == "0.80020 ± 0.00038 V"
    assert format_with_error(2.0e-3, 0.0, "s") == "2.0000 ± 0 ms"
    assert format_with_error(4.001e-13, 1.6e-16, "m^3/Pa") == "(4.0010 ± 0.0016)e-13 m³/Pa"
    assert format_with_error(-2.5e7, 3.1e6, "Pa*s/m^3") == "(-2.50 ± 0.31)e7 Pa·s/m³"
    assert format_with_error(0.0, 0.0, "N") == "0.0000 ± 0 N"
