"""From a JAX function of scalars to a `Program`."""

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend import core

from edhas_jax.compiler import elementary_functions as series
from edhas_jax.compiler.scalar_ir import COMPARISONS, Dependence, Program


class Untranslatable(Exception):
    """A function uses an operation that has no counterpart here: arrays, whole numbers, inner loops, rare functions."""


_INLINE = ("jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "remat", "checkpoint")
_SAME = ("convert_element_type", "copy", "copy_p", "stop_gradient", "broadcast_in_dim", "reshape", "squeeze")
Functions = Mapping[str, Callable[[Program, int], int]]
SERIES: Functions = {n: getattr(series, n) for n in ("exp", "expm1", "log", "log1p", "sin", "cos", "tanh", "logistic")}


def trace_to_ir(f: Callable[..., Any], dtype, *levels: Any, functions: Functions = SERIES) -> tuple[Program, Any]:
    """The program of `f(*arguments)`: pytrees of scalars in, a pytree of scalars out; every leaf a real number.

    `levels` has the structure of the arguments, a `Dependence` for each leaf. The inputs and outputs of the program are
    numbered in the order of the leaves; the second result is the structure of the output. `functions` says how the
    elementary functions are computed.

    Raises:
        Untranslatable: an operation is beyond this.
    """
    leaves, structure = jax.tree.flatten(levels)
    shape: list[Any] = []

    def flat(*scalars):
        out, of = jax.tree.flatten(f(*jax.tree.unflatten(structure, scalars)))
        shape[:] = [of]
        return [jnp.asarray(v) for v in out]

    closed = jax.make_jaxpr(flat)(*[jax.ShapeDtypeStruct((), dtype)] * len(leaves))
    program = Program(dtype)
    arguments = [program.input(i, level) for i, level in enumerate(leaves)]
    results = _take_in(program, closed.jaxpr, closed.consts, arguments, functions)
    program.outputs = dict(enumerate(results))
    return program.with_shared_roots(), shape[0]


def _take_in(p: Program, jaxpr, consts, arguments: list[int], functions: Functions) -> list[int]:
    known = {v: _constant(p, c) for v, c in zip(jaxpr.constvars, consts, strict=True)}
    known |= zip(jaxpr.invars, arguments, strict=True)

    def node(atom):
        return _constant(p, atom.val) if isinstance(atom, core.Literal) else known[atom]

    for eqn in jaxpr.eqns:
        known |= zip(eqn.outvars, _equation(p, eqn, [node(a) for a in eqn.invars], functions), strict=True)
    return [node(a) for a in jaxpr.outvars]


def _constant(p: Program, value) -> int:
    if np.shape(value):
        raise Untranslatable(f"an array of shape {np.shape(value)}")
    return p.const(np.asarray(value).item())


def _equation(p: Program, eqn, args: list[int], functions: Functions) -> list[int]:
    name = eqn.primitive.name
    if name in _INLINE:
        inner = eqn.params.get("jaxpr") or eqn.params["call_jaxpr"]
        return _take_in(p, getattr(inner, "jaxpr", inner), getattr(inner, "consts", ()), args, functions)
    of = eqn.outvars[0].aval
    if of.shape or not (of.dtype == bool or jnp.issubdtype(of.dtype, jnp.floating)):
        raise Untranslatable(f"`{name}` makes {of.str_short()}")
    if name in _SAME:
        if p.is_logical(args[0]) and of.dtype != bool:
            return [p.select(args[0], p.const(1.0), p.const(0.0))]
        if of.dtype == bool and not p.is_logical(args[0]):
            return [p.compare("ne", args[0], p.const(0.0))]
        return args[:1]
    if name in functions:
        return [functions[name](p, *args)]
    if name in _RULES:
        return [_RULES[name](p, *args)]
    if name == "integer_pow":
        return [p.power(args[0], eqn.params["y"])]
    raise Untranslatable(f"the operation `{name}`")


def _sign(p: Program, x: int) -> int:
    zero, one = p.const(0.0), p.const(1.0)
    return p.select(p.compare("gt", x, zero), one, p.select(p.compare("lt", x, zero), p.const(-1.0), zero))


def _either(p: Program, a: int, b: int) -> int:
    return p.invert(p.both(p.invert(a), p.invert(b)))


def _unary(name: str) -> Callable[[Program, int], int]:
    return lambda p, x: p.unary(name, x)


_RULES: dict[str, Callable[..., int]] = {
    "add": Program.add,
    "add_any": Program.add,
    "sub": Program.sub,
    "mul": Program.mul,
    "neg": Program.neg,
    "div": lambda p, a, b: p.mul(a, p.reciprocal(b)),
    "square": lambda p, a: p.mul(a, a),
    "pow": series.power,
    "exp2": lambda p, a: series.exp(p, p.mul(a, p.const(np.log(2.0)))),
    "max": lambda p, a, b: p.extreme("max", a, b),
    "min": lambda p, a, b: p.extreme("min", a, b),
    "clamp": lambda p, low, x, high: p.extreme("min", p.extreme("max", x, low), high),
    "select_n": lambda p, which, no, yes: p.select(which, yes, no),
    "not": Program.invert,
    "and": Program.both,
    "or": _either,
    "sign": _sign,
    "is_finite": lambda p, x: p.compare("lt", p.unary("abs", x), p.const(np.inf)),
    **{n: _unary(n) for n in ("sqrt", "rsqrt", "abs")},
    **{n: (lambda p, a, b, n=n: p.compare(n, a, b)) for n in (*COMPARISONS, "lt", "le")},
}

__all__ = ["SERIES", "Functions", "Dependence", "Untranslatable", "trace_to_ir"]
