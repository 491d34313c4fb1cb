"""The exact Jacobian of a program of scalars, sparse, written out while the program is traced.

`jax.jacfwd` pushes one dense direction per state; here every scalar carries only the derivatives that are not
structurally zero, so that 17 to 30 states cost about as much as the equations themselves. What comes out are ordinary
JAX scalars: the result can be batched and differentiated again.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.extend import core

Row = dict[str, Any]
_INLINE = ("jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call", "remat", "checkpoint")


def linearize(f: Callable[[Row], Row], y: Row) -> tuple[Row, dict[str, Row]]:
    """Value and Jacobian of `f` at `y`: f(y) and {output: {input: ∂output/∂input}} without structural zeros.

    `f` maps a dict of scalars to a dict of scalars and may close over traced values, which count as constants.
    """
    names = sorted(y)
    leaves = [jnp.asarray(y[n]) for n in names]
    outputs: list[str] = []

    def program(*scalars):
        out = f(dict(zip(names, scalars, strict=True)))
        outputs[:] = sorted(out)
        return [out[n] for n in outputs]

    closed = jax.make_jaxpr(program)(*leaves)
    tangents = [{n: _UNIT} for n in names]
    values, rows = _run(closed.jaxpr, closed.consts, leaves, tangents)
    return dict(zip(outputs, values, strict=True)), dict(zip(outputs, rows, strict=True))


class _Unit:
    """The number one as a derivative: products with it are not written down."""


_UNIT = _Unit()


def _run(jaxpr, consts, arguments, tangents):
    """Evaluate a jaxpr on primal values and sparse tangents, leaving out what no output needs."""
    value: dict[Any, Any] = {}
    slope: dict[Any, Row] = {}
    needed = _needed(jaxpr)
    for var, const in zip(jaxpr.constvars, consts, strict=True):
        value[var] = const
    for var, arg, row in zip(jaxpr.invars, arguments, tangents, strict=True):
        value[var], slope[var] = arg, row

    def read(atom):
        return atom.val if isinstance(atom, core.Literal) else value[atom]

    def row(atom):
        return {} if isinstance(atom, core.Literal) else slope.get(atom, {})

    for eqn in jaxpr.eqns:
        if eqn not in needed:
            continue
        outs, rows = _equation(eqn, [read(a) for a in eqn.invars], [row(a) for a in eqn.invars])
        for var, out, r in zip(eqn.outvars, outs, rows, strict=True):
            value[var] = out
            if r:
                slope[var] = r
    return [read(a) for a in jaxpr.outvars], [{k: _plain(v, read(a)) for k, v in row(a).items()} for a in jaxpr.outvars]


def _needed(jaxpr) -> set:
    """The equations that the outputs depend on."""
    live = {id(a) for a in jaxpr.outvars}
    kept = set()
    for eqn in reversed(jaxpr.eqns):
        if any(id(v) in live for v in eqn.outvars):
            kept.add(eqn)
            live |= {id(a) for a in eqn.invars}
    return kept


def _equation(eqn, args, rows):
    name = eqn.primitive.name
    if name in _INLINE:
        inner = eqn.params.get("jaxpr") or eqn.params.get("call_jaxpr") or eqn.params.get("fun_jaxpr")
        if hasattr(inner, "consts"):
            return _run(inner.jaxpr, inner.consts, args, rows)
        return _run(inner, (), args, rows)
    smooth = any(jnp.issubdtype(v.aval.dtype, jnp.inexact) for v in eqn.outvars)
    if not any(rows) or not smooth or name == "stop_gradient":
        return _bind(eqn, args), [{}] * len(eqn.outvars)
    if name in _RULES:
        out, row = _RULES[name](args, rows)
        return [out], [row]
    return _generic(eqn, args, rows)


def _bind(eqn, args):
    out = eqn.primitive.bind(*args, **eqn.params)
    return out if eqn.primitive.multiple_results else [out]


def _generic(eqn, args, rows):
    """Any other primitive, by its own forward rule: once per operand where all is scalar, else once per direction."""
    names = sorted({n for r in rows for n in r})
    active = [i for i, r in enumerate(rows) if r]

    def call(*operands):
        full = list(args)
        for i, a in zip(active, operands, strict=True):
            full[i] = a
        return _bind(eqn, full)

    primals = [jnp.asarray(args[i]) for i in active]
    zeros = [jnp.zeros_like(p) for p in primals]
    scalar = all(p.shape == () for p in primals) and all(v.aval.shape == () for v in eqn.outvars)
    if scalar and len(active) <= len(names):
        outs, result = None, [{} for _ in eqn.outvars]
        for j, i in enumerate(active):
            directions = [jnp.ones_like(p) if k == j else z for k, (p, z) in enumerate(zip(primals, zeros, strict=True))]
            outs, partials = jax.jvp(call, primals, directions)
            for o, partial in enumerate(partials):
                result[o] = _add(result[o], _scale(partial, rows[i]))
        return outs, result
    outs, result = None, [{} for _ in eqn.outvars]
    for n in names:
        directions = [
            _plain(rows[i][n], p) if n in rows[i] else z for i, p, z in zip(active, primals, zeros, strict=True)
        ]
        outs, partials = jax.jvp(call, primals, directions)
        for o, partial in enumerate(partials):
            result[o][n] = partial
    return outs, result


def _plain(slope, like):
    return jnp.ones_like(like) if slope is _UNIT else slope


def _times(factor, slope):
    return factor if slope is _UNIT else factor * slope


def _scale(factor, row: Row) -> Row:
    return {n: _times(factor, slope) for n, slope in row.items()}


def _negate(row: Row, like) -> Row:
    return {n: -_plain(slope, like) for n, slope in row.items()}


def _add(a: Row, b: Row) -> Row:
    out = dict(a)
    for n, slope in b.items():
        out[n] = _sum(out[n], slope) if n in out else slope
    return out


def _sum(a, b):
    if a is _UNIT:
        a = 2.0 if b is _UNIT else 1.0
        return a if b is _UNIT else a + b
    return a + (1.0 if b is _UNIT else b)


def _rule_add(args, rows):
    return args[0] + args[1], _add(*rows)


def _rule_sub(args, rows):
    return args[0] - args[1], _add(rows[0], _negate(rows[1], args[1]))


def _rule_neg(args, rows):
    return -args[0], _negate(rows[0], args[0])


def _rule_mul(args, rows):
    return args[0] * args[1], _add(_scale(args[1], rows[0]), _scale(args[0], rows[1]))


def _rule_div(args, rows):
    inverse = 1.0 / args[1]
    out = args[0] * inverse
    return out, _add(_scale(inverse, rows[0]), _scale(-out * inverse, rows[1]))


def _rule_square(args, rows):
    return jnp.square(args[0]), _scale(2.0 * args[0], rows[0])


def _rule_sqrt(args, rows):
    out = jnp.sqrt(args[0])
    return out, _scale(0.5 / out, rows[0])


def _rule_abs(args, rows):
    x = args[0]
    return jnp.abs(x), {n: jnp.where(x < 0, -_plain(t, x), _plain(t, x)) for n, t in rows[0].items()}


def _choose(which, if_true: Row, if_false: Row, like) -> Row:
    zero = jnp.zeros_like(like)
    return {
        n: jax.lax.select(which, *(_full(r[n], like) if n in r else zero for r in (if_true, if_false)))
        for n in sorted({*if_true, *if_false})
    }


def _full(slope, like):
    return jnp.asarray(_plain(slope, like), like.dtype)


def _rule_max(args, rows):
    out = jnp.maximum(*args)
    return out, _choose(args[0] > args[1], rows[0], rows[1], out)


def _rule_min(args, rows):
    out = jnp.minimum(*args)
    return out, _choose(args[0] < args[1], rows[0], rows[1], out)


def _rule_select(args, rows):
    which, if_false, if_true = args
    out = jax.lax.select(which, if_true, if_false)
    return out, _choose(which, rows[2], rows[1], out)


_RULES = {
    "add": _rule_add, "add_any": _rule_add, "sub": _rule_sub, "neg": _rule_neg, "mul": _rule_mul, "div": _rule_div,
    "square": _rule_square, "sqrt": _rule_sqrt, "abs": _rule_abs, "max": _rule_max, "min": _rule_min,
}  # fmt: skip


def solve(jacobian: dict[str, Row], right: Row, factor) -> Row:
    """Solve (I − factor · J) k = right by sparse elimination, written out while it is traced.

    The order of elimination is the one of least fill (Markowitz), chosen once from the structure; pivots stay on the
    diagonal, which is safe because `factor · J` is a small multiple of the rates of a dissipative machine.
    """
    names = sorted(right)
    rows = {}
    for i in names:
        rows[i] = {j: -factor * slope for j, slope in jacobian[i].items() if j != i}
        rows[i][i] = 1.0 - factor * jacobian[i][i] if i in jacobian[i] else None
    b = dict(right)
    left = set(names)
    order = []
    while left:
        columns = {n: [i for i in left if i != n and n in rows[i]] for n in left}
        pivot = min(sorted(left), key=lambda n: (len(columns[n]) * (len(rows[n]) - 1), len(columns[n])))
        left.remove(pivot)
        order.append(pivot)
        row = rows[pivot]
        if row[pivot] is not None:
            inverse = 1.0 / row[pivot]
            row = rows[pivot] = {j: inverse * a for j, a in row.items() if j != pivot}
            b[pivot] = inverse * b[pivot]
        else:
            row = rows[pivot] = {j: a for j, a in row.items() if j != pivot}
        for i in columns[pivot]:
            below = rows[i].pop(pivot)
            for j, a in row.items():
                term = below * a
                if j == i and rows[i][i] is None:
                    rows[i][i] = 1.0 - term
                else:
                    rows[i][j] = rows[i][j] - term if j in rows[i] else -term
            b[i] = b[i] - below * b[pivot]
    k: Row = {}
    for n in reversed(order):
        total = b[n]
        for j, a in rows[n].items():
            total = total - a * k[j]
        k[n] = total
    return k
