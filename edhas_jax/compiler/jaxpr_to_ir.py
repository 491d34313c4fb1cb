"""Tracing of a JAX function of scalars and its translation to the scalar intermediate representation."""

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend import core

from edhas_jax.compiler import elementary_functions
from edhas_jax.compiler.loop_engine import Untranslatable
from edhas_jax.compiler.scalar_ir import COMPARISONS, Program

_CALL_PRIMITIVES = ("jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "remat", "checkpoint")
_IDENTITIES = ("convert_element_type", "copy", "copy_p", "stop_gradient", "broadcast_in_dim", "reshape", "squeeze")
# {JAX primitive: (program, operand nodes…) -> node of the result}
FunctionTable = Mapping[str, Callable[..., int]]
POLYNOMIAL_FUNCTIONS: FunctionTable = {
    name: getattr(elementary_functions, name)
    for name in ("exp", "expm1", "log", "log1p", "sin", "cos", "tanh", "logistic")
}


def trace_to_ir(
    f: Callable[..., Any], dtype, *dependences: Any, functions: FunctionTable = POLYNOMIAL_FUNCTIONS
) -> tuple[Program, Any]:
    """Trace `f` and translate it to a `Program`.

    The program computes throughout in one precision; conversions between floating-point types within `f` are ignored.
    `Program` names the identities of real arithmetic by which it is simplified.

    Args:
        f: maps pytrees of real scalars to a pytree of real scalars.
        dtype: floating-point type of all numbers.
        *dependences: one pytree for each argument of `f`, with a `Dependence` in place of each leaf.
        functions: how elementary functions are expressed by operations of the program.

    Returns:
        The program, whose inputs and outputs are numbered in the order of the leaves, and the structure of the result
        of `f`.

    Raises:
        Untranslatable: `f` uses an operation that the scalar IR lacks.
    """
    leaves, argument_structure = jax.tree.flatten(dependences)
    structures: list[Any] = []

    def flat_function(*scalars):
        out, structure = jax.tree.flatten(f(*jax.tree.unflatten(argument_structure, scalars)))
        structures[:] = [structure]
        return [jnp.asarray(v) for v in out]

    closed = jax.make_jaxpr(flat_function)(*[jax.ShapeDtypeStruct((), dtype)] * len(leaves))
    program = Program(dtype)
    arguments = [program.input(i, dependence) for i, dependence in enumerate(leaves)]
    results = _translate_jaxpr(program, closed.jaxpr, closed.consts, arguments, functions)
    program.outputs = dict(enumerate(results))
    return program.with_shared_roots(), structures[0]


def _translate_jaxpr(p: Program, jaxpr, consts, arguments: list[int], functions: FunctionTable) -> list[int]:
    """Append the operations of a jaxpr and return the nodes of its results."""
    nodes = {v: _constant(p, c) for v, c in zip(jaxpr.constvars, consts, strict=True)}
    nodes |= zip(jaxpr.invars, arguments, strict=True)

    def node(atom):
        return _constant(p, atom.val) if isinstance(atom, core.Literal) else nodes[atom]

    for eqn in jaxpr.eqns:
        nodes |= zip(eqn.outvars, _translate_equation(p, eqn, [node(a) for a in eqn.invars], functions), strict=True)
    return [node(a) for a in jaxpr.outvars]


def _constant(p: Program, value) -> int:
    if np.shape(value):
        raise Untranslatable(f"an array of shape {np.shape(value)}")
    return p.const(np.asarray(value).item())


def _translate_equation(p: Program, eqn, args: list[int], functions: FunctionTable) -> list[int]:
    """Append the operations of one equation and return the nodes of its results."""
    name = eqn.primitive.name
    if name in _CALL_PRIMITIVES:
        inner = eqn.params.get("jaxpr") or eqn.params["call_jaxpr"]
        return _translate_jaxpr(p, getattr(inner, "jaxpr", inner), getattr(inner, "consts", ()), args, functions)
    result = eqn.outvars[0].aval
    if result.shape or not (result.dtype == bool or jnp.issubdtype(result.dtype, jnp.floating)):
        raise Untranslatable(f"`{name}` makes {result.str_short()}")
    if name in _IDENTITIES:
        if p.is_boolean(args[0]) and result.dtype != bool:
            return [p.select(args[0], p.const(1.0), p.const(0.0))]
        if result.dtype == bool and not p.is_boolean(args[0]):
            return [p.compare("ne", args[0], p.const(0.0))]
        return args[:1]
    if name in functions:
        return [functions[name](p, *args)]
    if name in _RULES:
        return [_RULES[name](p, *args)]
    if name == "integer_pow":
        return [p.integer_power(args[0], eqn.params["y"])]
    raise Untranslatable(f"the operation `{name}`")


def _sign(p: Program, x: int) -> int:
    """−1, 0 or 1."""
    zero, one = p.const(0.0), p.const(1.0)
    return p.select(p.compare("gt", x, zero), one, p.select(p.compare("lt", x, zero), p.const(-1.0), zero))


def _logical_or(p: Program, a: int, b: int) -> int:
    return p.logical_not(p.logical_and(p.logical_not(a), p.logical_not(b)))


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
    "pow": elementary_functions.power,
    "exp2": lambda p, a: elementary_functions.exp(p, p.mul(a, p.const(np.log(2.0)))),
    "max": lambda p, a, b: p.min_or_max("max", a, b),
    "min": lambda p, a, b: p.min_or_max("min", a, b),
    "clamp": lambda p, low, x, high: p.min_or_max("min", p.min_or_max("max", x, low), high),
    "select_n": lambda p, condition, if_false, if_true: p.select(condition, if_true, if_false),
    "not": Program.logical_not,
    "and": Program.logical_and,
    "or": _logical_or,
    "sign": _sign,
    "is_finite": lambda p, x: p.compare("lt", p.unary("abs", x), p.const(np.inf)),
    **{n: _unary(n) for n in ("sqrt", "rsqrt", "abs")},
    **{n: (lambda p, a, b, n=n: p.compare(n, a, b)) for n in (*COMPARISONS, "lt", "le")},
}
