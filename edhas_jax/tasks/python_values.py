"""Python values where configurations have text: numbers in SI, texts with unit, ranges as tuples, lists of values."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from edhas_jax.design.batch.design_table import resolve_parameter
from edhas_jax.machine.parameters import ParameterError
from edhas_jax.machine.rigs import Rig


def quantity(unit: str, value: Any) -> Any:
    """A value as text with unit: a number is in SI; what is neither number nor text stays as it is."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        return value
    return repr(float(value)) if unit == "-" else f"{float(value)!r} {unit}"


def axis(machine: Rig, name: str, spec: Any) -> Any:
    """The values of a parameter as a configuration has them.

    Args:
        machine: the machine that owns the parameter.
        name: of the parameter.
        spec: a tuple (from, to), (from, to, count), (from, to, "log") or (from, to, count, "log"), a list or array of
            values, or what a configuration has. Numbers are in SI.

    Returns:
        A mapping with `from` and `to` or with `values`, or a single value; what is wrong in it is found by its reader.
    """
    try:
        unit = resolve_parameter(machine, name)[0].unit
    except ParameterError:
        unit = "-"  # the reader names the parameter
    if isinstance(spec, Mapping):
        return {k: v if k in ("count", "spacing") else _converted(unit, v) for k, v in spec.items()}
    if isinstance(spec, tuple) and 2 <= len(spec) <= 4:
        ends = {"from": quantity(unit, spec[0]), "to": quantity(unit, spec[1])}
        rest = ("spacing",) if spec[2:] == ("log",) else ("count", "spacing")
        return ends | dict(zip(rest, map(str, spec[2:]), strict=False))
    values = _converted(unit, spec)
    return {"values": values} if isinstance(values, list) else values


def axes(machine: Rig, specs: Mapping[str, Any] | None) -> dict[str, Any]:
    """`axis` for each parameter."""
    return {name: axis(machine, name, spec) for name, spec in (specs or {}).items()}


def bounds(machine: Rig, limits: Mapping[str, Any] | None) -> dict[str, Any]:
    """Limits of metrics, {"rms_current": {"max": 4.0}}, as a configuration has them."""
    return {
        name: {end: quantity(machine.metrics[name].unit, v) for end, v in ends.items()}
        if isinstance(ends, Mapping) and name in machine.metrics
        else ends
        for name, ends in (limits or {}).items()
    }


def tolerances(machine: Rig, robust: Mapping[str, Any] | None) -> dict[str, Any]:
    """The section `robust` of a sizing, with numbers in SI."""
    rows = (robust or {}).get("tolerances")
    return {**(robust or {})} | ({"tolerances": axes(machine, rows)} if isinstance(rows, Mapping) else {})


def _converted(unit: str, value: Any) -> Any:
    if isinstance(value, list | tuple | range | np.ndarray):
        return [quantity(unit, v) for v in value]
    return quantity(unit, value)
