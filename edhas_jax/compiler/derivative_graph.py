"""The exact linearisation of a program of scalars, as a sparse graph that is written out while the program is traced.

`jax.jacfwd` pushes one dense direction per state through the program. Here every elementary operation leaves only its
own partial derivatives; `edhas_jax.compiler.sparse_elimination` then joins the chain rule and the linear system of a
step in one sparse elimination. What comes out are ordinary JAX scalars, which can be batched and differentiated again.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.extend import core

from edhas_jax.compiler.one_sided_minmax import one_sided_max, one_sided_min

Row = dict[Any, Any]
_INLINE = ("jit", "pjit", "closed_call", "core_call", "remat", "checkpoint")


class Mask(NamedTuple):
    """A partial derivative that is 1 where `where` holds and 0 elsewhere.

    Its product with a number selects: what the program did not choose never enters, not even as 0 · ∞.
    """

    where: Any


_deferred_p = core.Primitive("defer_partials")
_deferred_p.def_abstract_eval(lambda value, *operands, name: value)


def defer_partials(name: str, value, *operands):
    """`value`, whose partial derivatives by `operands` the caller of `linearize` will give: see `Graph.set_partials`.

    For use inside a program that is being linearised, and nowhere else.
    """
    return _deferred_p.bind(value, *operands, name=name)


class Graph(NamedTuple):
    """A linearised program.

    `values` are the outputs by name; `rows` maps each vertex to {predecessor: partial derivative}. The inputs are
    vertices by name, the output `n` is the vertex `("d", n)`, everything between is numbered. A partial derivative is
    a scalar, a plain number, or a `Mask`. `promises` has the vertex of each promised value and of its operands.
    """

    values: dict[str, Any]
    rows: dict[Any, Row]
    promises: dict[str, tuple[Any, list]] = {}

    def set_partials(self, name: str, *partials) -> None:
        """Give the partial derivatives of the value that was promised under `name`."""
        vertex, ends = self.promises[name]
        self.rows[vertex] = _row(ends, partials)


def linearize(f: Callable[[dict], dict], y: dict[str, Any]) -> Graph:
    """The values of `f` at `y` and the graph of its partial derivatives.

    `f` maps a dict of scalars to a dict of scalars; it may close over traced values, which count as constants, and may
    use any JAX operation, vectors and control flow included.
    """
    names = sorted(y)
    leaves = [jnp.asarray(y[n]) for n in names]
    outputs: list[str] = []

    def program(*scalars):
        out = f(dict(zip(names, scalars, strict=True)))
        outputs[:] = sorted(out)
        return [jnp.asarray(out[n]) for n in outputs]

    closed = jax.make_jaxpr(program)(*leaves)
    tape = _Tape()
    values, vertices = tape.run(closed.jaxpr, closed.consts, leaves, names)
    for n, vertex in zip(outputs, vertices, strict=True):
        tape.rows["d", n] = {} if vertex is None else {vertex: 1.0}
    return Graph(dict(zip(outputs, values, strict=True)), tape.rows, tape.promises)


class _Tape:
    """Evaluates a jaxpr and notes the partial derivatives of each operation; a vertex None is a constant."""

    def __init__(self):
        self.rows: dict[Any, Row] = {}
        self.promises: dict[str, tuple[Any, list]] = {}
        self._count = 0

    def run(self, jaxpr, consts, arguments, vertices):
        value: dict[Any, Any] = dict(zip(jaxpr.constvars, consts, strict=True))
        value |= zip(jaxpr.invars, arguments, strict=True)
        vertex: dict[Any, Any] = dict(zip(jaxpr.invars, vertices, strict=True))

        def read(atom):
            return atom.val if isinstance(atom, core.Literal) else value[atom]

        def found(atom):
            return None if isinstance(atom, core.Literal) else vertex.get(atom)

        for eqn in _needed(jaxpr):
            args, ends = [read(a) for a in eqn.invars], [found(a) for a in eqn.invars]
            outs, nodes = self._equation(eqn, args, ends)
            value |= zip(eqn.outvars, outs, strict=True)
            vertex |= zip(eqn.outvars, nodes, strict=True)
        return [read(a) for a in jaxpr.outvars], [found(a) for a in jaxpr.outvars]

    def _equation(self, eqn, args, ends):
        name = eqn.primitive.name
        if eqn.primitive is _deferred_p:
            vertex = self._vertex((), ())
            self.promises[eqn.params["name"]] = vertex, ends[1:]
            return args[:1], [vertex]
        if name in _INLINE:
            inner = eqn.params.get("jaxpr") or eqn.params["call_jaxpr"]
            return self.run(getattr(inner, "jaxpr", inner), getattr(inner, "consts", ()), args, ends)
        if all(end is None for end in ends) or not any(map(_smooth, eqn.outvars)) or name == "stop_gradient":
            return _bind(eqn, args), [None] * len(eqn.outvars)
        if any(jnp.shape(a) for a in args) or any(v.aval.shape for v in eqn.outvars):
            return self._vector(eqn, args, ends)
        if name in _RULES:
            out, partials = _RULES[name](*args)
            return [out], [self._vertex(ends, partials)]
        if name == "select_n" and len(args) == 3:
            which, if_false, if_true = args
            out = jax.lax.select(which, if_true, if_false)
            return [out], [self._vertex(ends[1:], (Mask(~which), Mask(which)))]
        return self._scalar(eqn, args, ends)

    def _vertex(self, ends, partials):
        self._count += 1
        self.rows[self._count] = _row(ends, partials)
        return self._count

    def _scalar(self, eqn, args, ends):
        """Any other operation on scalars, by its own forward rule, once per operand."""
        active = [i for i, end in enumerate(ends) if end is not None]
        outs, partials = None, []
        for i in active:
            outs, slopes = jax.jvp(_of(eqn, args, [i]), [jnp.asarray(args[i])], [jnp.ones_like(args[i])])
            partials.append(slopes)
        live = [ends[i] for i in active]
        return outs, [
            self._vertex(live, [p[o] for p in partials]) if _smooth(v) else None for o, v in enumerate(eqn.outvars)
        ]

    def _vector(self, eqn, args, ends):
        """An operation on arrays: `ends` are then dicts {vertex: derivative array}, pushed one by one."""
        pushes: dict[Any, dict[int, Any]] = {}
        for i, end in enumerate(ends):
            if end is not None:
                spread = end if isinstance(end, dict) else {end: jnp.ones_like(args[i])}
                for source, slope in spread.items():
                    pushes.setdefault(source, {})[i] = slope
        active = [i for i, end in enumerate(ends) if end is not None]
        primals = [jnp.asarray(args[i]) for i in active]
        outs, result = None, [{} for _ in eqn.outvars]
        for source, slopes in pushes.items():
            tangents = [slopes.get(i, jnp.zeros_like(p)) for i, p in zip(active, primals, strict=True)]
            outs, moved = jax.jvp(_of(eqn, args, active), primals, tangents)
            for o, slope in enumerate(moved):
                result[o][source] = slope
        return outs, [
            None if not _smooth(v) else self._vertex(list(r), list(r.values())) if v.aval.shape == () else r
            for v, r in zip(eqn.outvars, result, strict=True)
        ]


def _row(ends, partials) -> Row:
    row: Row = {}
    for end, partial in zip(ends, partials, strict=True):
        if end is not None:
            row[end] = add(row[end], partial) if end in row else partial
    return row


def _smooth(var) -> bool:
    return jnp.issubdtype(var.aval.dtype, jnp.inexact)


def _needed(jaxpr) -> list:
    """The equations that the outputs depend on."""
    live = {id(a) for a in jaxpr.outvars}
    kept = []
    for eqn in reversed(jaxpr.eqns):
        if any(id(v) in live for v in eqn.outvars):
            kept.append(eqn)
            live |= {id(a) for a in eqn.invars}
    return kept[::-1]


def _bind(eqn, args):
    if eqn.primitive.name in _SIDED and _smooth(eqn.outvars[0]):
        return [_SIDED[eqn.primitive.name](*args)]
    bound = eqn.primitive.get_bind_params(eqn.params)
    # older releases of JAX hand the functions of a custom rule over apart from its parameters
    functions, parameters = bound if isinstance(bound, tuple) else ((), bound)
    out = eqn.primitive.bind(*functions, *args, **parameters)
    return out if eqn.primitive.multiple_results else [out]


def _of(eqn, args, active):
    def call(*operands):
        full = list(args)
        for i, operand in zip(active, operands, strict=True):
            full[i] = operand
        return _bind(eqn, full)

    return call


def number(partial):
    """A partial derivative as a number."""
    return jnp.where(partial.where, 1.0, 0.0) if isinstance(partial, Mask) else partial


def multiply(a, b):
    """The product of two partial derivatives; with one it is not written down."""
    if isinstance(a, float) and isinstance(b, float):
        return a * b
    for one, other in ((a, b), (b, a)):
        if isinstance(one, float) and one == 1.0:
            return other
        if isinstance(one, float) and one == -1.0:
            return -number(other)
    for mask, other in ((a, b), (b, a)):
        if isinstance(mask, Mask):
            if isinstance(other, Mask):
                return Mask(mask.where & other.where)
            return jnp.where(mask.where, other, 0.0)
    return a * b


def add(a, b):
    """The sum of two partial derivatives."""
    return number(a) + number(b)


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


_SIDED = {"max": one_sided_max, "min": one_sided_min}
_RULES = {
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
