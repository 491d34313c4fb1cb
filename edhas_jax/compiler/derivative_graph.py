"""Exact linearisation of a scalar function as a sparse graph of local partial derivatives.

`jax.jacfwd` propagates one dense tangent per input through the function. Here each elementary operation is recorded as
a vertex of the linearised computational graph, with the partial derivatives by its own operands only.
`edhas_jax.compiler.sparse_elimination` then applies the chain rule and solves the linear system of an implicit step in
one sparse elimination. All partial derivatives are ordinary JAX scalars: they can be batched and differentiated again.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.extend import core

from edhas_jax.compiler.one_sided_minmax import one_sided_max, one_sided_min
from edhas_jax.compiler.partial_derivatives import Mask, Row, add

_CALL_PRIMITIVES = ("jit", "pjit", "closed_call", "core_call", "remat", "checkpoint")
_deferred_p = core.Primitive("defer_partials")
_deferred_p.def_abstract_eval(lambda value, *operands, name: value)


def defer_partials(name: str, value, *operands):
    """Mark `value` as a function of `operands` whose partial derivatives are set later by `Graph.set_partials`.

    Only for use inside a function that is being linearised by `linearize`.

    Args:
        name: the name under which `Graph.set_partials` finds the value.
        value: a scalar; how it was computed is ignored by the linearisation.
        *operands: the scalars by which the partial derivatives will be given.

    Returns:
        `value`, unchanged.
    """
    return _deferred_p.bind(value, *operands, name=name)


class Graph(NamedTuple):
    """The linearised computational graph of a function.

    Attributes:
        values: the outputs by name.
        rows: {vertex: {predecessor: partial derivative}}. An input is the vertex of its name, output `n` is the vertex
            `("d", n)`, intermediate vertices are numbered. A partial derivative is a JAX scalar, a Python float, or a
            `Mask`.
        deferred: {name: (vertex, vertices of the operands)} of each value marked by `defer_partials`.
    """

    values: dict[str, Any]
    rows: dict[Any, Row]
    deferred: dict[str, tuple[Any, list]] = {}

    def set_partials(self, name: str, *partials) -> None:
        """Set the partial derivatives of the value that `defer_partials` marked as `name`, one for each operand."""
        vertex, operands = self.deferred[name]
        self.rows[vertex] = _row(operands, partials)


def linearize(f: Callable[[dict], dict], y: dict[str, Any]) -> Graph:
    """Evaluate `f` at `y` and record the graph of its local partial derivatives.

    Args:
        f: maps a dict of scalars to a dict of scalars. It may close over traced values, which count as constants, and
            may use any JAX operation, arrays and control flow included.
        y: the inputs by name.

    Returns:
        The values of the outputs and the linearised computational graph.
    """
    names = sorted(y)
    leaves = [jnp.asarray(y[n]) for n in names]
    outputs: list[str] = []

    def flat_function(*scalars):
        out = f(dict(zip(names, scalars, strict=True)))
        outputs[:] = sorted(out)
        return [jnp.asarray(out[n]) for n in outputs]

    closed = jax.make_jaxpr(flat_function)(*leaves)
    tape = _Tape()
    values, vertices = tape.run(closed.jaxpr, closed.consts, leaves, names)
    for n, vertex in zip(outputs, vertices, strict=True):
        tape.rows["d", n] = {} if vertex is None else {vertex: 1.0}
    return Graph(dict(zip(outputs, values, strict=True)), tape.rows, tape.deferred)


class _Tape:
    """Evaluates a jaxpr and records the partial derivatives of each operation; the vertex of a constant is None."""

    def __init__(self):
        self.rows: dict[Any, Row] = {}
        self.deferred: dict[str, tuple[Any, list]] = {}
        self._count = 0

    def run(self, jaxpr, consts, arguments, vertices):
        value: dict[Any, Any] = dict(zip(jaxpr.constvars, consts, strict=True))
        value |= zip(jaxpr.invars, arguments, strict=True)
        vertex: dict[Any, Any] = dict(zip(jaxpr.invars, vertices, strict=True))

        def read(atom):
            return atom.val if isinstance(atom, core.Literal) else value[atom]

        def vertex_of(atom):
            return None if isinstance(atom, core.Literal) else vertex.get(atom)

        for eqn in _live_equations(jaxpr):
            outs, out_vertices = self._equation(eqn, list(map(read, eqn.invars)), list(map(vertex_of, eqn.invars)))
            value |= zip(eqn.outvars, outs, strict=True)
            vertex |= zip(eqn.outvars, out_vertices, strict=True)
        return list(map(read, jaxpr.outvars)), list(map(vertex_of, jaxpr.outvars))

    def _equation(self, eqn, args, operands):
        """The results of one equation and their vertices; `operands` are the vertices of `args`."""
        name = eqn.primitive.name
        if eqn.primitive is _deferred_p:
            vertex = self._vertex((), ())
            self.deferred[eqn.params["name"]] = vertex, operands[1:]
            return args[:1], [vertex]
        if name in _CALL_PRIMITIVES:
            inner = eqn.params.get("jaxpr") or eqn.params["call_jaxpr"]
            return self.run(getattr(inner, "jaxpr", inner), getattr(inner, "consts", ()), args, operands)
        constant = all(vertex is None for vertex in operands) or not any(map(_is_real, eqn.outvars))
        if constant or name == "stop_gradient":
            return _evaluate(eqn, args), [None] * len(eqn.outvars)
        if any(jnp.shape(a) for a in args) or any(v.aval.shape for v in eqn.outvars):
            return self._array_operation(eqn, args, operands)
        if name in _SCALAR_RULES:
            out, partials = _SCALAR_RULES[name](*args)
            return [out], [self._vertex(operands, partials)]
        if name == "select_n" and len(args) == 3:
            condition, if_false, if_true = args
            out = jax.lax.select(condition, if_true, if_false)
            return [out], [self._vertex(operands[1:], (Mask(~condition), Mask(condition)))]
        return self._scalar_operation(eqn, args, operands)

    def _vertex(self, operands, partials):
        """Add a numbered vertex with the partial derivatives by `operands`."""
        self._count += 1
        self.rows[self._count] = _row(operands, partials)
        return self._count

    def _scalar_operation(self, eqn, args, operands):
        """A scalar operation without a rule in `_SCALAR_RULES`: one `jax.jvp` for each non-constant operand."""
        active = [i for i, vertex in enumerate(operands) if vertex is not None]
        outs, partials = None, []
        for i in active:
            outs, tangents = jax.jvp(_as_function_of(eqn, args, [i]), [jnp.asarray(args[i])], [jnp.ones_like(args[i])])
            partials.append(tangents)
        predecessors = [operands[i] for i in active]
        return outs, [
            self._vertex(predecessors, [p[o] for p in partials]) if _is_real(v) else None
            for o, v in enumerate(eqn.outvars)
        ]

    def _array_operation(self, eqn, args, operands):
        """An operation on arrays, by one `jax.jvp` for each scalar vertex that its operands depend on.

        The vertex of an array is a dict {scalar vertex: derivative of the array by it}.
        """
        tangents_by_vertex: dict[Any, dict[int, Any]] = {}
        for i, vertex in enumerate(operands):
            if vertex is not None:
                tangents = vertex if isinstance(vertex, dict) else {vertex: jnp.ones_like(args[i])}
                for source, tangent in tangents.items():
                    tangents_by_vertex.setdefault(source, {})[i] = tangent
        active = [i for i, vertex in enumerate(operands) if vertex is not None]
        primals = [jnp.asarray(args[i]) for i in active]
        outs, derivatives = None, [{} for _ in eqn.outvars]
        for source, tangents in tangents_by_vertex.items():
            filled = [tangents.get(i, jnp.zeros_like(p)) for i, p in zip(active, primals, strict=True)]
            outs, out_tangents = jax.jvp(_as_function_of(eqn, args, active), primals, filled)
            for o, tangent in enumerate(out_tangents):
                derivatives[o][source] = tangent
        return outs, [
            None if not _is_real(v) else self._vertex(list(d), list(d.values())) if v.aval.shape == () else d
            for v, d in zip(eqn.outvars, derivatives, strict=True)
        ]


def _row(operands, partials) -> Row:
    """The partial derivatives by vertex; those by one vertex are added, those by constants dropped."""
    row: Row = {}
    for vertex, partial in zip(operands, partials, strict=True):
        if vertex is not None:
            row[vertex] = add(row[vertex], partial) if vertex in row else partial
    return row


def _is_real(var) -> bool:
    """Whether a variable is of a floating-point type, and so may have a derivative."""
    return jnp.issubdtype(var.aval.dtype, jnp.inexact)


def _live_equations(jaxpr) -> list:
    """The equations that the outputs depend on (dead-code elimination)."""
    live = {id(a) for a in jaxpr.outvars}
    equations = []
    for eqn in reversed(jaxpr.eqns):
        if any(id(v) in live for v in eqn.outvars):
            equations.append(eqn)
            live |= {id(a) for a in eqn.invars}
    return equations[::-1]


def _evaluate(eqn, args):
    """The results of an equation, with one-sided extremes in place of JAX's."""
    if eqn.primitive.name in _ONE_SIDED and _is_real(eqn.outvars[0]):
        return [_ONE_SIDED[eqn.primitive.name](*args)]
    bound = eqn.primitive.get_bind_params(eqn.params)
    # older releases of JAX return the functions of a custom rule separately from its parameters
    functions, parameters = bound if isinstance(bound, tuple) else ((), bound)
    out = eqn.primitive.bind(*functions, *args, **parameters)
    return out if eqn.primitive.multiple_results else [out]


def _as_function_of(eqn, args, active):
    """The equation as a function of the operands with the indices `active`; the others are fixed at `args`."""

    def call(*operands):
        full = list(args)
        for i, operand in zip(active, operands, strict=True):
            full[i] = operand
        return _evaluate(eqn, full)

    return call


def _mul(a, b):
    return a * b, (b, a)


def _div(a, b):
    inverse = 1.0 / b
    out = a * inverse
    return out, (inverse, -out * inverse)


def _sqrt(a):
    out = jnp.sqrt(a)
    return out, (0.5 / out,)


def _abs(a):
    return jnp.abs(a), (jnp.where(a < 0, -jnp.ones_like(a), jnp.ones_like(a)),)


def _max(a, b):
    return one_sided_max(a, b), (Mask(a > b), Mask(~(a > b)))


def _min(a, b):
    return one_sided_min(a, b), (Mask(a < b), Mask(~(a < b)))


_ONE_SIDED = {"max": one_sided_max, "min": one_sided_min}
# {primitive: operands -> (value, partial derivatives by each operand)}
_SCALAR_RULES = {
    "add": lambda a, b: (a + b, (1.0, 1.0)),
    "add_any": lambda a, b: (a + b, (1.0, 1.0)),
    "sub": lambda a, b: (a - b, (1.0, -1.0)),
    "neg": lambda a: (-a, (-1.0,)),
    "mul": _mul,
    "div": _div,
    "square": lambda a: (jnp.square(a), (2.0 * a,)),
    "sqrt": _sqrt,
    "abs": _abs,
    "max": _max,
    "min": _min,
}
