"""Intermediate representation of straight-line scalar programs in SSA form, simplified while they are built.

Value numbering computes each common subexpression once, constants are folded, and each divisor has one reciprocal.
"""

import enum
import math
from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np


class Dependence(enum.IntEnum):
    """The most variable quantity that a value depends on; decides where in the loop nest it is computed.

    INVARIANT: loop-invariant inputs and constants. SAMPLE: an input that changes once per sample. STEP: the step number
    (the induction variable). CARRY: the loop-carried state. TANGENT: a derivative within the loop-carried state.
    """

    INVARIANT = 0
    SAMPLE = 1
    STEP = 2
    CARRY = 3
    TANGENT = 4


_LEAVES = ("input", "const", "bool")
# unary operations that the target computes, each with its constant folding
UNARY = {
    "sqrt": lambda x: math.sqrt(x) if x >= 0.0 else math.nan,
    "rsqrt": lambda x: 1.0 / math.sqrt(x) if x > 0.0 else math.inf if x == 0.0 else math.nan,
    "abs": abs,
    "power_of_two": lambda n: 2.0**n,
    "exponent": lambda x: float(math.floor(math.log2(x) + 0.5)),
}
COMPARISONS = ("gt", "ge", "eq", "ne")
BOOLEAN_OPERATIONS = (*COMPARISONS, "not", "and")


class Program:
    """A straight-line program of real and boolean scalars without control flow.

    The methods append operations and return the number of their node; they fold constants, reuse equal nodes and
    rewrite signs, divisions and roots into the cheapest form. The rewriting assumes real arithmetic:

    - x · 0 = 0 and x − x = 0, also where x is infinite or not a number; the sign of zero is not kept;
    - a/b = a · (1/b), which rounds twice; 1/(1/x) = x; 1/√x is one operation;
    - c₁ · (c₂ · x) = (c₁ · c₂) · x for constants, and xⁿ is computed by repeated squaring;
    - addition, multiplication, maximum and minimum are commutative: which operand of max or min is returned where one
      of them is not a number is unspecified.

    Comparisons follow IEEE 754: with an operand that is not a number only `ne` holds.

    Attributes:
        nodes: `nodes[i]` is (operation, operands…), an operand being the number of an earlier node.
        dependence: the `Dependence` of each node.
        outputs: {name of a result: number of its node}.
    """

    def __init__(self, dtype):
        self.type = np.dtype(dtype).type
        self.nodes: list[tuple] = []
        self.dependence: list[Dependence] = []
        self.outputs: dict[Any, int] = {}
        self._number: dict[tuple, int] = {}

    def node(self, operation: str, *operands) -> int:
        """The node of an operation without simplification; equal operations share one node (value numbering)."""
        key = (operation, *operands)
        if key not in self._number:
            self._number[key] = len(self.nodes)
            self.nodes.append(key)
            if operation == "input":
                self.dependence.append(operands[1])
            else:
                nodes = () if operation in _LEAVES else operands
                self.dependence.append(max((self.dependence[i] for i in nodes), default=Dependence.INVARIANT))
        return self._number[key]

    def input(self, name, dependence: Dependence) -> int:
        """An input of the program."""
        return self.node("input", name, dependence)

    def const(self, value) -> int:
        """A constant number, rounded to the precision of the program, or a constant boolean."""
        if isinstance(value, bool | np.bool_):
            return self.node("bool", bool(value))
        return self.node("const", float(self.type(value)))

    def constant_value(self, i: int):
        """The value of node i if it is a constant, else None."""
        return self.nodes[i][1] if self.nodes[i][0] in ("const", "bool") else None

    def neg(self, a: int) -> int:
        """−a."""
        op, *args = self.nodes[a]
        if op == "const":
            return self.const(-args[0])
        if op == "neg":
            return args[0]
        if op == "sub":
            return self.sub(args[1], args[0])
        return self.node("neg", a)

    def add(self, a: int, b: int) -> int:
        """a + b."""
        x, y = self.constant_value(a), self.constant_value(b)
        if x is not None and y is not None:
            return self.const(x + y)
        if x == 0.0 or y == 0.0:
            return b if x == 0.0 else a
        if self.nodes[b][0] == "neg":
            return self.sub(a, self.nodes[b][1])
        if self.nodes[a][0] == "neg":
            return self.sub(b, self.nodes[a][1])
        return self.node("add", *sorted((a, b)))

    def sub(self, a: int, b: int) -> int:
        """a − b."""
        x, y = self.constant_value(a), self.constant_value(b)
        if x is not None and y is not None:
            return self.const(x - y)
        if y == 0.0:
            return a
        if a == b:
            return self.const(0.0)
        if x == 0.0:
            return self.neg(b)
        if self.nodes[b][0] == "neg":
            return self.add(a, self.nodes[b][1])
        if self.nodes[a][0] == "neg":
            return self.neg(self.add(self.nodes[a][1], b))
        return self.node("sub", a, b)

    def mul(self, a: int, b: int) -> int:
        """a · b."""
        x, y = self.constant_value(a), self.constant_value(b)
        if x is not None and y is not None:
            return self.const(x * y)
        if y is not None:
            (a, x), (b, y) = (b, y), (a, x)
        if x == 0.0:
            return a
        if x == 1.0:
            return b
        if x == -1.0:
            return self.neg(b)
        negative = (self.nodes[a][0] == "neg") ^ (self.nodes[b][0] == "neg")
        a, b = (self.nodes[i][1] if self.nodes[i][0] == "neg" else i for i in (a, b))
        if x is not None and x < 0.0:
            a, x, negative = self.const(-x), -x, not negative
        if x is not None and self.nodes[b][0] == "mul":  # c₁ · (c₂ · x) = (c₁ · c₂) · x
            for factor, other in (self.nodes[b][1:], self.nodes[b][:0:-1]):
                if self.constant_value(factor) is not None:
                    a, b = self.const(x * self.constant_value(factor)), other
                    break
        out = self.node("mul", *sorted((a, b)))
        return self.neg(out) if negative else out

    def reciprocal(self, a: int) -> int:
        """1/a."""
        op, *args = self.nodes[a]
        if op == "const":
            return self.const(1.0 / args[0]) if args[0] else self.const(math.copysign(math.inf, args[0]))
        if op == "neg":
            return self.neg(self.reciprocal(args[0]))
        if op == "reciprocal":
            return args[0]
        if op == "sqrt":
            return self.unary("rsqrt", args[0])
        if op == "select" and all(self.constant_value(i) for i in args[1:]):
            return self.select(args[0], *(self.reciprocal(i) for i in args[1:]))
        return self.node("reciprocal", a)

    def integer_power(self, a: int, n: int) -> int:
        """aⁿ for an integer n, by repeated squaring."""
        if n < 0:
            return self.integer_power(self.reciprocal(a), -n)
        if n == 0:
            return self.const(1.0)
        half = self.integer_power(a, n // 2)
        square = self.mul(half, half) if n > 1 else self.const(1.0)
        return self.mul(square, a) if n % 2 else square

    def unary(self, op: str, a: int) -> int:
        """The operation `op` of `UNARY`; nested roots are expressed by x^(−1/4), one operation of the target."""
        if self.constant_value(a) is not None:
            return self.const(UNARY[op](self.constant_value(a)))
        if op == "abs" and self.nodes[a][0] in ("neg", "abs"):
            return self.unary(op, self.nodes[a][1])
        if op in ("sqrt", "rsqrt") and self.nodes[a][0] in ("sqrt", "rsqrt"):
            radicand = self.nodes[a][1]
            inverse_root4 = self.node("inverse_root4", radicand)  # x^(−1/4)
            return inverse_root4 if op != self.nodes[a][0] else self.mul(self.node("sqrt", radicand), inverse_root4)
        return self.node(op, a)

    def min_or_max(self, op: str, a: int, b: int) -> int:
        """The `min` or `max` of a and b, as `op` says."""
        x, y = self.constant_value(a), self.constant_value(b)
        if x is not None and y is not None:
            return self.const(max(x, y) if op == "max" else min(x, y))
        return a if a == b else self.node(op, *sorted((a, b)))

    def compare(self, op: str, a: int, b: int) -> int:
        """The boolean a op b; op is one of gt, ge, lt, le, eq, ne."""
        x, y = self.constant_value(a), self.constant_value(b)
        if x is not None and y is not None:
            return self.const({"gt": x > y, "lt": x < y, "ge": x >= y, "le": x <= y, "eq": x == y, "ne": x != y}[op])
        if op in ("lt", "le"):
            op, a, b = {"lt": "gt", "le": "ge"}[op], b, a
        return self.node(op, a, b)

    def logical_not(self, a: int) -> int:
        """not a."""
        op, *args = self.nodes[a]
        if op == "bool":
            return self.const(not args[0])
        return args[0] if op == "not" else self.node("not", a)

    def logical_and(self, a: int, b: int) -> int:
        """a and b."""
        for operand, other in ((a, b), (b, a)):
            if self.constant_value(operand) is not None:
                return other if self.constant_value(operand) else operand
        return a if a == b else self.node("and", *sorted((a, b)))

    def select(self, condition: int, if_true: int, if_false: int) -> int:
        """`if_true` where `condition` holds, else `if_false`; both are numbers, or both are booleans."""
        if self.constant_value(condition) is not None:
            return if_true if self.constant_value(condition) else if_false
        if self.nodes[condition][0] == "not":
            condition, if_true, if_false = self.nodes[condition][1], if_false, if_true
        if if_true == if_false:
            return if_true
        if self.is_boolean(if_true):
            first = self.logical_not(self.logical_and(condition, if_true))
            second = self.logical_not(self.logical_and(self.logical_not(condition), if_false))
            return self.logical_not(self.logical_and(first, second))
        return self.node("select", condition, if_true, if_false)

    def is_boolean(self, i: int) -> bool:
        """Whether node i is a boolean."""
        return self.nodes[i][0] in (*BOOLEAN_OPERATIONS, "bool")

    def with_shared_roots(self) -> "Program":
        """The same program, with √x and 1/√x computed from x^(−1/4) where that is computed anyway."""
        out = Program(self.type)
        existing = set(self.nodes)
        new: dict[int, int] = {}
        for i in self.schedule():
            op, *args = self.nodes[i]
            if op in _LEAVES:
                new[i] = out.node(op, *args)
            elif op in ("sqrt", "rsqrt") and ("inverse_root4", args[0]) in existing:
                inverse_root4 = out.node("inverse_root4", new[args[0]])
                inverse_root = out.mul(inverse_root4, inverse_root4)
                new[i] = inverse_root if op == "rsqrt" else out.mul(new[args[0]], inverse_root)
            else:
                new[i] = out.node(op, *(new[j] for j in args))
        out.outputs = {n: new[i] for n, i in self.outputs.items()}
        return out

    def schedule(self) -> list[int]:
        """The live nodes in an order of computation: operands first, each shortly before its first use.

        Nodes of `Dependence.TANGENT` keep the order in which they were built, so that a factor that several tangents
        share is used for all of them while it is in a register.
        """
        live = self._postorder(self.outputs.values())
        tangents = sorted(i for i in live if self.dependence[i] == Dependence.TANGENT)
        return self._postorder((*tangents, *self.outputs.values())) if tangents else live

    def _postorder(self, roots: Iterable[int]) -> list[int]:
        """The nodes that `roots` depend on and the roots themselves, by depth-first search."""
        visited: dict[int, None] = {}
        for root in roots:
            stack = [(root, False)]
            while stack:
                i, operands_visited = stack.pop()
                if operands_visited:
                    visited[i] = None
                elif i not in visited:
                    stack.append((i, True))
                    stack.extend((j, False) for j in self.operands(i)[::-1] if j not in visited)
        return list(visited)

    def operands(self, i: int) -> tuple:
        """The nodes that node i is computed from."""
        op, *args = self.nodes[i]
        return () if op in _LEAVES else tuple(args)

    def count_operations(self, dependence: Dependence) -> Counter:
        """The number of operations of each kind among the live nodes of one `Dependence`."""
        live = (i for i in self.schedule() if self.dependence[i] == dependence)
        return Counter(self.nodes[i][0] for i in live if self.nodes[i][0] not in _LEAVES)
