"""A program as C99 for one lane: functions of plain numbers that need nothing but <math.h>."""

import math
from collections.abc import Callable, Sequence

from edhas_jax.compiler.jaxpr_to_ir import FunctionTable
from edhas_jax.compiler.scalar_ir import Dependence, Program


def _library(name: str) -> Callable[..., int]:
    return lambda p, *args: p.node(name, *args)


# what <math.h> has under these names it computes itself, to the last place; LLVM's vectors need a series instead
_ONE = (
    "exp", "exp2", "expm1", "log", "log1p", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh",
    "asinh", "acosh", "atanh", "cbrt", "erf", "erfc", "floor", "ceil",
)  # fmt: skip
_NAMED = {"pow": "pow", "atan2": "atan2", "rem": "fmod"}
C_LIBRARY: FunctionTable = {
    **{name: _library(name) for name in _ONE},
    **{name: _library(c_name) for name, c_name in _NAMED.items()},
    "logistic": lambda p, x: p.reciprocal(p.add(p.const(1.0), p.node("exp", p.neg(x)))),
}

_CALLED = {*_ONE, *_NAMED.values()}
_INFIX = {"add": "+", "sub": "-", "mul": "*", "gt": ">", "ge": ">=", "eq": "==", "ne": "!=", "and": "&&"}
_FORMS = {
    "neg": "-{0}",
    "not": "!{0}",
    "max": "{0} > {1} ? {0} : {1}",
    "min": "{0} < {1} ? {0} : {1}",
    "select": "{0} ? {1} : {2}",
    "reciprocal": "1.0 / {0}",
    "abs": "fabs({0})",
    "sqrt": "sqrt({0})",
    "rsqrt": "1.0 / sqrt({0})",
    # a large number at 0, as its square times 0 must be 0
    "inverse_root4": "1.0 / sqrt(sqrt({0} == 0.0 ? DBL_MIN : {0}))",
}


def c_function(program: Program, name: str, parameters: str, inputs: Sequence[str]) -> str:
    """The text of `static void NAME(PARAMETERS, double *out)`, which writes output k of the program to `out[k]`.

    `inputs` has a C expression for each input of the program, in terms of the `parameters`; none may read from `out`.
    """
    lines, names = _statements(program, program.schedule(), dict(enumerate(inputs)), {})
    return _function(name, f"{parameters}, double *out", lines, _results(program, names))


def c_function_in_two(program: Program, name: str, parameters: str, inputs: Sequence[str]) -> tuple[str, int]:
    """The same with what is `Dependence.INVARIANT` computed apart: two functions and the number of values between them.

    `static void NAME_fixed(PARAMETERS, double *kept)` is to be called whenever a fixed input has changed;
    `static void NAME(PARAMETERS, const double *kept, double *out)` then computes the rest.
    """
    order = program.schedule()
    fixed = [i for i in order if program.dependence[i] == Dependence.INVARIANT]
    used = {j for i in order if program.dependence[i] != Dependence.INVARIANT for j in program.operands(i)}
    used |= set(program.outputs.values())
    lines, names = _statements(program, fixed, dict(enumerate(inputs)), {})
    kept = [i for i in fixed if i in used and program.nodes[i][0] not in ("input", "const", "bool")]
    stores = [f"kept[{k}] = {names[i]};" for k, i in enumerate(kept)]
    first = _function(f"{name}_fixed", f"{parameters}, double *kept", lines, stores)
    known = {i: names[i] for i in fixed if program.nodes[i][0] in ("input", "const", "bool")}
    known |= {i: f"kept[{k}]" for k, i in enumerate(kept)}
    rest = [i for i in order if program.dependence[i] != Dependence.INVARIANT]
    lines, names = _statements(program, rest, dict(enumerate(inputs)), known)
    second = _function(name, f"{parameters}, const double *kept, double *out", lines, _results(program, names))
    return f"{first}\n{second}", len(kept)


def c_number(value: float) -> str:
    """A number as a C expression that gives it back to the bit."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0.0 else "(-INFINITY)"
    return repr(float(value)) if value >= 0.0 else f"({float(value)!r})"


def _statements(program: Program, order, inputs: dict[int, str], known: dict[int, str]) -> tuple[list[str], dict]:
    """One line for each operation of `order`, and the name of every value; those in `known` have theirs."""
    names, lines = dict(known), []
    for i in order:
        op, *args = program.nodes[i]
        if op == "input":
            names[i] = inputs[args[0]]
        elif op == "const":
            names[i] = c_number(args[0])
        elif op == "bool":
            names[i] = str(int(args[0]))
        else:
            kind, letter = ("int", "b") if program.is_boolean(i) else ("double", "v")
            names[i] = f"{letter}{i}"
            lines.append(f"const {kind} {names[i]} = {_expression(op, [names[j] for j in args])};")
    return lines, names


def _expression(op: str, a: list[str]) -> str:
    if op in _INFIX:
        return f"{a[0]} {_INFIX[op]} {a[1]}"
    if op in _CALLED:
        return f"{op}({', '.join(a)})"
    return _FORMS[op].format(*a)


def _results(program: Program, names: dict[int, str]) -> list[str]:
    return [f"out[{k}] = {names[i]};" for k, i in program.outputs.items()]


def _function(name: str, parameters: str, lines: list[str], results: list[str]) -> str:
    body = "\n    ".join([*lines, *results])
    return f"static void {name}({parameters})\n{{\n    {body}\n}}\n"
