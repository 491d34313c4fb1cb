"""A program of scalars without control flow, simplified while it is built: no value twice, one reciprocal a divisor."""

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


_LEAVES = ("input", "const", "truth")
# operations with one operand that are left to the processor, with what they do to a constant
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
    """`nodes[i]` is (operation, operands…), an operand being the number of another node; `outputs` names the results.

    The methods build operations and return their node; they fold constants, share equal values and turn signs,
    divisions and roots into the cheapest form. Arithmetic is that of reals: x · 0 is 0, x − x is 0.
    """

    def __init__(self, dtype):
        self.type = np.dtype(dtype).type
        self.nodes: list[tuple] = []
        self.dependence: list[Dependence] = []
        self.outputs: dict[Any, int] = {}
        self._number: dict[tuple, int] = {}

    def node(self, operation: str, *operands) -> int:
        """The number of an operation as it stands, the same for the same one."""
        key = (operation, *operands)
        if key not in self._number:
            self._number[key] = len(self.nodes)
            self.nodes.append(key)
            if operation == "input":
                self.dependence.append(operands[1])
            else:
                below = () if operation in _LEAVES else operands
                self.dependence.append(max((self.dependence[i] for i in below), default=Dependence.INVARIANT))
        return self._number[key]

    def input(self, name, dependence: Dependence) -> int:
        """A value that comes from outside."""
        return self.node("input", name, dependence)

    def const(self, value) -> int:
        """A number, or a truth value."""
        if isinstance(value, bool | np.bool_):
            return self.node("truth", bool(value))
        return self.node("const", float(self.type(value)))

    def value(self, i: int):
        """The value of a constant, else None."""
        return self.nodes[i][1] if self.nodes[i][0] in ("const", "truth") else None

    def neg(self, a: int) -> int:
        """−a"""
        op, *args = self.nodes[a]
        if op == "const":
            return self.const(-args[0])
        if op == "neg":
            return args[0]
        if op == "sub":
            return self.sub(args[1], args[0])
        return self.node("neg", a)

    def add(self, a: int, b: int) -> int:
        """a + b"""
        x, y = self.value(a), self.value(b)
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
        """a − b"""
        x, y = self.value(a), self.value(b)
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
        """a · b"""
        x, y = self.value(a), self.value(b)
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
        if x is not None and self.nodes[b][0] == "mul":  # constants come together
            for one, other in (self.nodes[b][1:], self.nodes[b][:0:-1]):
                if self.value(one) is not None:
                    a, b = self.const(x * self.value(one)), other
                    break
        out = self.node("mul", *sorted((a, b)))
        return self.neg(out) if negative else out

    def reciprocal(self, a: int) -> int:
        """1/a"""
        op, *args = self.nodes[a]
        if op == "const":
            return self.const(1.0 / args[0]) if args[0] else self.const(math.copysign(math.inf, args[0]))
        if op == "neg":
            return self.neg(self.reciprocal(args[0]))
        if op == "reciprocal":
            return args[0]
        if op == "sqrt":
            return self.unary("rsqrt", args[0])
        if op == "select" and all(self.value(i) for i in args[1:]):
            return self.select(args[0], *(self.reciprocal(i) for i in args[1:]))
        return self.node("reciprocal", a)

    def power(self, a: int, n: int) -> int:
        """aⁿ for a whole n"""
        if n < 0:
            return self.power(self.reciprocal(a), -n)
        if n == 0:
            return self.const(1.0)
        half = self.power(a, n // 2)
        square = self.mul(half, half) if n > 1 else self.const(1.0)
        return self.mul(square, a) if n % 2 else square

    def unary(self, op: str, a: int) -> int:
        """An operation of `UNARY`."""
        if self.value(a) is not None:
            return self.const(UNARY[op](self.value(a)))
        if op == "abs" and self.nodes[a][0] in ("neg", "abs"):
            return self.unary(op, self.nodes[a][1])
        if op in ("sqrt", "rsqrt") and self.nodes[a][0] in ("sqrt", "rsqrt"):
            inside = self.nodes[a][1]
            fourth = self.node("root4", inside)  # a^(−1/4)
            return fourth if op != self.nodes[a][0] else self.mul(self.node("sqrt", inside), fourth)
        return self.node(op, a)

    def extreme(self, op: str, a: int, b: int) -> int:
        """The `max` or `min` of a and b."""
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self.const(max(x, y) if op == "max" else min(x, y))
        return a if a == b else self.node(op, *sorted((a, b)))

    def compare(self, op: str, a: int, b: int) -> int:
        """A truth value: a op b."""
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self.const({"gt": x > y, "lt": x < y, "ge": x >= y, "le": x <= y, "eq": x == y, "ne": x != y}[op])
        if op in ("lt", "le"):
            op, a, b = {"lt": "gt", "le": "ge"}[op], b, a
        return self.node(op, a, b)

    def invert(self, a: int) -> int:
        """not a"""
        op, *args = self.nodes[a]
        if op == "truth":
            return self.const(not args[0])
        return args[0] if op == "not" else self.node("not", a)

    def both(self, a: int, b: int) -> int:
        """a and b"""
        for one, other in ((a, b), (b, a)):
            if self.value(one) is not None:
                return other if self.value(one) else one
        return a if a == b else self.node("and", *sorted((a, b)))

    def select(self, which: int, yes: int, no: int) -> int:
        """`yes` where `which` holds, else `no`; both numbers or both truth values."""
        if self.value(which) is not None:
            return yes if self.value(which) else no
        if self.nodes[which][0] == "not":
            which, yes, no = self.nodes[which][1], no, yes
        if yes == no:
            return yes
        if self.is_logical(yes):
            return self.invert(
                self.both(self.invert(self.both(which, yes)), self.invert(self.both(self.invert(which), no)))
            )
        return self.node("select", which, yes, no)

    def is_logical(self, i: int) -> bool:
        """Whether node i is a truth value."""
        return self.nodes[i][0] in (*BOOLEAN_OPERATIONS, "truth")

    def with_shared_roots(self) -> "Program":
        """The same program with √a and 1/√a taken from the a^(−1/4) or 1/√a that is computed anyway."""
        out = Program(self.type)
        known = set(self.nodes)
        moved: dict[int, int] = {}
        for i in self.schedule():
            op, *args = self.nodes[i]
            if op in _LEAVES:
                moved[i] = out.node(op, *args)
            elif op in ("sqrt", "rsqrt") and ("root4", args[0]) in known:
                fourth = out.node("root4", moved[args[0]])
                inverse = out.mul(fourth, fourth)
                moved[i] = inverse if op == "rsqrt" else out.mul(moved[args[0]], inverse)
            else:
                moved[i] = out.node(op, *(moved[j] for j in args))
        out.outputs = {n: moved[i] for n, i in self.outputs.items()}
        return out

    def schedule(self) -> list[int]:
        """The nodes the outputs need, operands first, each where it is needed first.

        Tangents stand in the order in which they were built: a factor is then at hand for all directions.
        """
        wanted = self._with_operands(self.outputs.values())
        tangents = sorted(i for i in wanted if self.dependence[i] == Dependence.TANGENT)
        return self._with_operands((*tangents, *self.outputs.values())) if tangents else wanted

    def _with_operands(self, roots: Iterable[int]) -> list[int]:
        seen: dict[int, None] = {}
        for root in roots:
            stack = [(root, False)]
            while stack:
                i, done = stack.pop()
                if done:
                    seen[i] = None
                elif i not in seen:
                    stack.append((i, True))
                    stack.extend((j, False) for j in self.operands(i)[::-1] if j not in seen)
        return list(seen)

    def operands(self, i: int) -> tuple:
        """The nodes that node i is computed from."""
        op, *args = self.nodes[i]
        return () if op in _LEAVES else tuple(args)

    def count_operations(self, dependence: Dependence) -> Counter:
        """How often each operation occurs among the values of one level."""
        return Counter(
            self.nodes[i][0]
            for i in self.schedule()
            if self.dependence[i] == dependence and self.nodes[i][0] not in _LEAVES
        )
