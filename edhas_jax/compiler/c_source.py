"""C99 source of a scalar program for one lane: functions of doubles that need nothing but <math.h> and <float.h>."""

import math
from collections.abc import Callable, Sequence

from edhas_jax.compiler.jaxpr_to_ir import FunctionTable
from edhas_jax.compiler.scalar_ir import Dependence, Program


def _library_call(name: str) -> Callable[..., int]:
    return lambda p, *args: p.node(name, *args)


# functions of one argument that have the same name in JAX and in <math.h>
_UNARY_FUNCTIONS = (
    "exp", "exp2", "expm1", "log", "log1p", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh",
    "asinh", "acosh", "atanh", "cbrt", "erf", "erfc", "floor", "ceil",
)  # fmt: skip
# {name of the JAX primitive: name in <math.h>}
_BINARY_FUNCTIONS = {"pow": "pow", "atan2": "atan2", "rem": "fmod"}
# unlike LLVM's vectors, C computes elementary functions by its library and needs no polynomials
C_LIBRARY: FunctionTable = {
    **{name: _library_call(name) for name in _UNARY_FUNCTIONS},
    **{name: _library_call(c_name) for name, c_name in _BINARY_FUNCTIONS.items()},
    "logistic": lambda p, x: p.reciprocal(p.add(p.const(1.0), p.node("exp", p.neg(x)))),
}

_CALLS = {*_UNARY_FUNCTIONS, *_BINARY_FUNCTIONS.values()}
_INFIX_OPERATORS = {"add": "+", "sub": "-", "mul": "*", "gt": ">", "ge": ">=", "eq": "==", "ne": "!=", "and": "&&"}
_TEMPLATES = {
    "neg": "-{0}",
    "not": "!{0}",
    "max": "{0} > {1} ? {0} : {1}",
    "min": "{0} < {1} ? {0} : {1}",
    "select": "{0} ? {1} : {2}",
    "reciprocal": "1.0 / {0}",
    "abs": "fabs({0})",
    "sqrt": "sqrt({0})",
    "rsqrt": "1.0 / sqrt({0})",
    # at 0 a large finite number, because its square times 0 must be 0
    "inverse_root4": "1.0 / sqrt(sqrt({0} == 0.0 ? DBL_MIN : {0}))",
}


def c_function(program: Program, name: str, parameters: str, inputs: Sequence[str]) -> str:
    """The text of `static void NAME(PARAMETERS, double *out)`, which writes output k of the program to `out[k]`.

    Args:
        program: a program in float64.
        name: name of the function.
        parameters: its parameters as a C declaration.
        inputs: for each input of the program a C expression in terms of the parameters; none may read from `out`.

    Returns:
        The C source.
    """
    lines, names = _statements(program, program.schedule(), dict(enumerate(inputs)), {})
    return _function(name, f"{parameters}, double *out", lines, _output_assignments(program, names))


def c_function_with_invariants(
    program: Program, name: str, parameters: str, inputs: Sequence[str]
) -> tuple[str, int]:
    """As `c_function`, with the values of `Dependence.INVARIANT` computed by a function of their own.

    `static void NAME_invariants(PARAMETERS, double *invariants)` is to be called whenever an invariant input has
    changed; `static void NAME(PARAMETERS, const double *invariants, double *out)` then computes the outputs.

    Args:
        program: a program in float64.
        name: name of the second function.
        parameters: parameters of both functions as a C declaration.
        inputs: for each input of the program a C expression in terms of the parameters; none may read from `out`.

    Returns:
        The C source of both functions, and the length of the array `invariants`.
    """
    leaves = ("input", "const", "bool")
    schedule = program.schedule()
    invariant = [i for i in schedule if program.dependence[i] == Dependence.INVARIANT]
    variable = [i for i in schedule if program.dependence[i] != Dependence.INVARIANT]
    used = {j for i in variable for j in program.operands(i)} | set(program.outputs.values())
    lines, names = _statements(program, invariant, dict(enumerate(inputs)), {})
    stored = [i for i in invariant if i in used and program.nodes[i][0] not in leaves]
    stores = [f"invariants[{k}] = {names[i]};" for k, i in enumerate(stored)]
    first = _function(f"{name}_invariants", f"{parameters}, double *invariants", lines, stores)
    known = {i: names[i] for i in invariant if program.nodes[i][0] in leaves}
    known |= {i: f"invariants[{k}]" for k, i in enumerate(stored)}
    lines, names = _statements(program, variable, dict(enumerate(inputs)), known)
    outputs = _output_assignments(program, names)
    second = _function(name, f"{parameters}, const double *invariants, double *out", lines, outputs)
    return f"{first}\n{second}", len(stored)


def c_number(value: float) -> str:
    """A C expression whose value is exactly `value`."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0.0 else "(-INFINITY)"
    return repr(float(value)) if value >= 0.0 else f"({float(value)!r})"


def _statements(program: Program, schedule, inputs: dict[int, str], known: dict[int, str]) -> tuple[list[str], dict]:
    """One line for each operation of `schedule`, and the C expression of every value; `known` has those so far."""
    names, lines = dict(known), []
    for i in schedule:
        op, *args = program.nodes[i]
        if op == "input":
            names[i] = inputs[args[0]]
        elif op == "const":
            names[i] = c_number(args[0])
        elif op == "bool":
            names[i] = str(int(args[0]))
        else:
            c_type, prefix = ("int", "b") if program.is_boolean(i) else ("double", "v")
            names[i] = f"{prefix}{i}"
            lines.append(f"const {c_type} {names[i]} = {_expression(op, [names[j] for j in args])};")
    return lines, names


def _expression(op: str, a: list[str]) -> str:
    """The operation `op` with the operands `a` as a C expression."""
    if op in _INFIX_OPERATORS:
        return f"{a[0]} {_INFIX_OPERATORS[op]} {a[1]}"
    if op in _CALLS:
        return f"{op}({', '.join(a)})"
    return _TEMPLATES[op].format(*a)


def _output_assignments(program: Program, names: dict[int, str]) -> list[str]:
    return [f"out[{k}] = {names[i]};" for k, i in program.outputs.items()]


def _function(name: str, parameters: str, lines: list[str], assignments: list[str]) -> str:
    body = "\n    ".join([*lines, *assignments])
    return f"static void {name}({parameters})\n{{\n    {body}\n}}\n"
