"""Parameters given by name, singly or nested, numbers or text with unit: checked, and of one common shape."""

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.core.structs import Parameter
from edhas_jax.core.units import UnitError, format_quantity
from edhas_jax.machine.parameters import ParameterError, format_span, parse_value
from edhas_jax.machine.rigs import Rig

Resolve = Callable[[Rig, str], tuple[Parameter, str]]  # (machine, name) → declaration and own name


def named_columns(machine: Rig, parameters: Mapping[str, Any], resolve: Resolve) -> dict[str, jax.Array]:
    """The parameters by their own names, in the order of these, broadcast to one shape.

    Args:
        machine: the machine that owns them.
        parameters: by flat name or `owner.name`, or nested by owner, a number or array in SI, or a text with unit.
            Values that JAX traces are not checked.
        resolve: finds a parameter by its name.

    Raises:
        ParameterError: an unknown, ambiguous or repeated name, a value that is no number or outside its span, or shapes
            that do not go together.
    """
    if not isinstance(parameters, Mapping):
        raise ParameterError(f"parameters by name belong here, such as {{'piston_clearance': 15e-6}}, not "
                             f"{type(parameters).__name__}")  # fmt: skip
    found: dict[str, jax.Array] = {}
    for name, value in _flat("", parameters):
        try:
            p, own = resolve(machine, name)
            if own in found:
                raise ParameterError("given twice")
            found[own] = _checked(p, value)
        except (ParameterError, UnitError) as error:
            raise ParameterError(f"{name}: {error}") from None
    try:
        shape = np.broadcast_shapes(*(v.shape for v in found.values()))
    except ValueError:
        shapes = ", ".join(f"{n} {v.shape}" for n, v in found.items())
        raise ParameterError(f"the shapes of the parameters do not go together: {shapes}") from None
    return {n: jnp.broadcast_to(found[n], shape) for n in sorted(found)}


def _flat(owner: str, parameters: Mapping[str, Any]):
    for name, value in parameters.items():
        if isinstance(value, Mapping):
            yield from _flat(f"{owner}{name}.", value)
        else:
            yield f"{owner}{name}", value


def _checked(p: Parameter, value: Any) -> jax.Array:
    if isinstance(value, str):
        value = parse_value(p, value)
    try:
        array = jnp.asarray(value)
    except (TypeError, ValueError):
        array = None
    if array is None or not (jnp.issubdtype(array.dtype, jnp.floating) or jnp.issubdtype(array.dtype, jnp.integer)):
        example = format_quantity(p.default, p.unit)
        raise ParameterError(f'a number, an array or a text such as "{example}" belongs here')
    array = array.astype(jnp.result_type(float))
    if not isinstance(array, jax.core.Tracer):
        numbers, (low, high) = np.asarray(array, float), p.span
        # single precision moves a value on its bound by half a unit
        margin = 0.0 if array.dtype == np.float64 else 1e-6 * max(abs(low), abs(high))
        outside = ~((numbers >= low - margin) & (numbers <= high + margin))
        if outside.any():
            got = format_quantity(float(numbers[outside].ravel()[0]), p.unit)
            raise ParameterError(f"must lie in {format_span(p)} ({p.doc}); got {got}")
    return array
