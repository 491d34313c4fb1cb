"""A computation of the host, such as a batch of the loop engine, as a function that JAX transforms.

`jax.vmap` makes one call of the host with all sets of arguments, however it is nested; `jax.jit` puts that call into
the compiled program; `jax.grad`, `jax.jvp`, `jax.jacfwd` and `jax.jacrev` take the derivatives that the host computes.
"""

import functools
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero

from edhas_jax.core.name_suggestion import suggest


class Outcome(NamedTuple):
    """What the host has computed for n sets of arguments.

    Attributes:
        values: by name, (n, *shape of one output).
        slopes: derivatives by name, (n, *shape of one output, parameters asked for); empty if none were asked for.
    """

    values: dict[str, np.ndarray]
    slopes: dict[str, np.ndarray]


# (by parameter a column (n,) in SI, the fixed argument (length,) or None, the parameters to differentiate by)
Compute = Callable[[dict[str, np.ndarray], np.ndarray | None, tuple[str, ...]], Outcome]


class HostFunction:
    """`compute` as a function of JAX that acts element by element on parameters of any common shape.

    Args:
        compute: the computation.
        outputs: the names of its outputs.
    """

    def __init__(self, compute: Compute, outputs: tuple[str, ...]):
        self._compute, self._outputs = compute, outputs
        self._function = jax.custom_jvp(lambda columns, fixed: self._call(columns, fixed, ())[0])
        self._function.defjvp(self._differentiate, symbolic_zeros=True)
        # one object for each set of parameters: JAX compiles anew for another one
        self._callback = functools.cache(lambda active: functools.partial(self._on_host, active))

    def __call__(self, columns: Mapping[str, Any], fixed: Any = None) -> dict[str, jax.Array]:
        """The outputs by name, each of the shape of the parameters followed by the length of `fixed` if there is one.

        Args:
            columns: by parameter a value in SI, all of one shape.
            fixed: an argument (length,) without derivative, or None.
        """
        columns = dict(columns)
        if not any(isinstance(leaf, jax.core.Tracer) for leaf in (*columns.values(), fixed)):
            found = self._callback(())(columns, fixed)  # nothing is transformed: no program of XLA is needed
            return {n: jnp.asarray(v) for n, v in found[0].items()}
        return self._function(columns, fixed)

    def _call(self, columns: dict[str, Any], fixed: Any, active: tuple[str, ...]):
        """Values, and slopes with respect to the `active` parameters, as one call of the host."""
        first = next(iter(columns.values()))
        shape = first.shape if fixed is None else (*first.shape, *fixed.shape)
        values = dict.fromkeys(self._outputs, jax.ShapeDtypeStruct(shape, first.dtype))
        slopes = dict.fromkeys(self._outputs, jax.ShapeDtypeStruct((*shape, len(active)), first.dtype))
        wanted = values, slopes if active else {}
        return jax.pure_callback(self._callback(active), wanted, columns, fixed, vmap_method="broadcast_all")

    def _on_host(self, active: tuple[str, ...], columns, fixed):
        """What JAX calls: arrays of any leading shape become a table, and the results arrays again."""
        arrays = {n: np.asarray(v) for n, v in columns.items()}
        first = next(iter(arrays.values()))
        table = {n: v.ravel().astype(float) for n, v in arrays.items()}
        if fixed is None:
            shape, parts = first.shape, [(slice(None), None)]
        else:
            # under vmap there is a row of the fixed argument for each set; equal ones are computed together
            fixed = np.asarray(fixed, float)
            lead, tail = fixed.shape[:-1], first.shape[fixed.ndim - 1 :]
            rows = np.repeat(fixed.reshape(math.prod(lead), -1), math.prod(tail), axis=0)
            rows = rows if lead else np.broadcast_to(fixed, (first.size, len(fixed)))
            distinct, which = np.unique(rows, axis=0, return_inverse=True)
            shape = (*first.shape, fixed.shape[-1])
            parts = [(np.flatnonzero(which.ravel() == k), row) for k, row in enumerate(distinct)]
        values = {n: np.empty((first.size, *shape[first.ndim :])) for n in self._outputs}
        slopes = {n: np.empty((*v.shape, len(active))) for n, v in values.items()} if active else {}
        for rows, row in parts:
            found = self._compute({n: v[rows] for n, v in table.items()}, row, active)
            for out, part in ((values, found.values), (slopes, found.slopes)):
                for n in out:
                    out[n][rows] = part[n]
        dtype = first.dtype
        return (
            {n: v.reshape(shape).astype(dtype) for n, v in values.items()},
            {n: v.reshape(*shape, len(active)).astype(dtype) for n, v in slopes.items()},
        )

    def _differentiate(self, primals, tangents):
        (columns, fixed), (changes, fixed_change) = primals, tangents
        if fixed is not None and not isinstance(fixed_change, SymbolicZero):
            raise TypeError("the times of a trajectory have no derivative here; differentiate by parameters")
        active = tuple(n for n in columns if not isinstance(changes[n], SymbolicZero))
        values, slopes = _once_differentiable(functools.partial(self._call, active=active))(columns, fixed)
        behind = 0 if fixed is None else fixed.ndim

        def along(change):
            return jnp.reshape(change, change.shape + (1,) * behind)

        # each output on its own, so that one without derivative spoils no other
        by = {
            name: sum((slopes[name][..., k] * along(changes[n]) for k, n in enumerate(active)), jnp.zeros_like(value))
            for name, value in values.items()
        }
        return values, by


def _once_differentiable(function):
    """The function, with a sentence in place of its derivative."""
    once = jax.custom_jvp(function)

    @once.defjvp
    def _(primals, tangents):
        raise TypeError("second derivatives of metrics and trajectories are not there; take differences of gradients")

    return once


def require_outputs(asked, known, what: str) -> tuple[str, ...]:
    """The outputs `asked` for, or all `known` ones if that is None.

    Raises:
        ValueError: a name is unknown or there twice.
    """
    if asked is None:
        return tuple(known)
    asked = (asked,) if isinstance(asked, str) else tuple(asked)
    for k, name in enumerate(asked):
        if name not in known:
            raise ValueError(f"{name}: no {what} of this machine; {suggest(str(name), known)}")
        if name in asked[:k]:
            raise ValueError(f"{name}: asked for twice")
    if not asked:
        raise ValueError(f"at least one {what} is needed")
    return asked
