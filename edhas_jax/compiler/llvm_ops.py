"""LLVM assembly for the operations of a program, every value a vector of as many lanes as a register holds."""

import dataclasses
import struct
from collections.abc import Callable, Sequence

import numpy as np


@dataclasses.dataclass(frozen=True)
class Processor:
    """What code is written for: bytes in a vector register, and whether AVX-512's approximations are there.

    `vectors` are marched side by side: one alone waits for its own results, more fill the nearest cache.
    """

    vector_bytes: int
    approximates: bool
    vectors: int = 2

    @classmethod
    def of(cls, features: dict[str, bool]) -> "Processor":
        """From the features as LLVM names them."""
        if features.get("avx512f") and features.get("avx512dq"):
            return cls(64, True)
        return cls(32 if features.get("avx") else 16, False)

    def lanes(self, dtype) -> int:
        """The lanes of one block."""
        return self.vectors * self.vector_bytes // np.dtype(dtype).itemsize


_ARITHMETIC = {"add": "fadd", "sub": "fsub", "mul": "fmul"}
_COMPARE = {"gt": "ogt", "ge": "oge", "eq": "oeq", "ne": "une"}
_BITS = {np.float32: ("float", "i32", 23, 127, 0x3F3504F3), np.float64: ("double", "i64", 52, 1023, 0x3FE6A09E667F3BCD)}


class VectorCode:
    """Writes one line for each operation; the methods return the name of the result."""

    def __init__(self, dtype, processor: Processor):
        self.dtype, self.processor = np.dtype(dtype), processor
        self.scalar, self.integer, self.mantissa, self.bias, self.half = _BITS[dtype]
        self.width = processor.vector_bytes // np.dtype(dtype).itemsize
        self.vector, self.mask = f"<{self.width} x {self.scalar}>", f"<{self.width} x i1>"
        self.whole = f"<{self.width} x {self.integer}>"
        self._align = f"align {np.dtype(dtype).itemsize}"
        self._suffix = f"v{self.width}f{8 * np.dtype(dtype).itemsize}"
        self._lines: list[str] = []
        self._called: dict[str, None] = {}
        self._count = 0

    def taken(self) -> list[str]:
        """The lines written since the last call."""
        lines, self._lines = self._lines, []
        return lines

    def declarations(self) -> list[str]:
        """A line for each function that is called."""
        return list(self._called)

    def line(self, text: str) -> str:
        """A line of any text."""
        self._count += 1
        self._lines.append(f"%t{self._count} = {text}")
        return f"%t{self._count}"

    def number(self, value: float) -> str:
        """The same number in all lanes."""
        bits = struct.unpack("<Q", struct.pack("<d", value))[0]
        return self.spread(f"{self.scalar} 0x{bits:016X}")

    def truth(self, value: bool) -> str:
        """The same truth value in all lanes."""
        return self.spread(f"i1 {str(value).lower()}")

    def spread(self, text: str) -> str:
        """The same constant in all lanes."""
        return f"<{', '.join([text] * self.width)}>"

    def splat(self, scalar: str) -> str:
        """The same variable in all lanes."""
        first = self.line(f"insertelement {self.vector} poison, {self.scalar} {scalar}, i64 0")
        zeros = f"<{self.width} x i32> zeroinitializer"
        return self.line(f"shufflevector {self.vector} {first}, {self.vector} poison, {zeros}")

    def load(self, spot: str) -> str:
        """A vector from memory."""
        return self.line(f"load {self.vector}, ptr {spot}, {self._align}")

    def load_scalar(self, spot: str) -> str:
        """A number from memory."""
        return self.line(f"load {self.scalar}, ptr {spot}, {self._align}")

    def store(self, value: str, spot: str) -> None:
        """A vector to memory."""
        self._lines.append(f"store {self.vector} {value}, ptr {spot}, {self._align}")

    def arithmetic(self, op: str, a: str, b: str) -> str:
        """a `add`ed to b, `sub`, `mul`."""
        return self.line(f"{_ARITHMETIC[op]} {self.vector} {a}, {b}")

    def multiply_add(self, a: str, b: str, c: str) -> str:
        """a · b + c, in one operation where the processor has one."""
        return self.call("fmuladd", a, b, c)

    def negative(self, a: str) -> str:
        """−a"""
        return self.line(f"fneg {self.vector} {a}")

    def compare(self, how: str, a: str, b: str) -> str:
        """A truth value, by a predicate of LLVM's `fcmp`."""
        return self.line(f"fcmp {how} {self.vector} {a}, {b}")

    def select(self, which: str, yes: str, no: str) -> str:
        """`yes` where `which` holds, else `no`."""
        return self.line(f"select {self.mask} {which}, {self.vector} {yes}, {self.vector} {no}")

    def call(self, name: str, *a: str) -> str:
        """A function that LLVM knows."""
        function = f"{self.vector} @llvm.{name}.{self._suffix}"
        self._called[f"declare {function}({', '.join([self.vector] * len(a))})"] = None
        return self.line(f"call {function}({', '.join(f'{self.vector} {x}' for x in a)})")

    def approximation(self, name: str, a: str) -> str:
        """Fourteen bits of 1/a (`rcp14`) or 1/√a (`rsqrt14`)."""
        kind = "ps" if self.scalar == "float" else "pd"
        function, mask = f"{self.vector} @llvm.x86.avx512.{name}.{kind}.512", f"i{self.width}"
        self._called[f"declare {function}({self.vector}, {self.vector}, {mask})"] = None
        return self.line(f"call {function}({self.vector} {a}, {self.vector} zeroinitializer, {mask} -1)")

    def refined(self, r: str, factor: Callable[[str], str]) -> str:
        """Newton's rule r · factor(r), as often as the precision asks; r is near its goal and the factor near 1."""
        for _ in range(1 if self.scalar == "float" else 2):
            # at 1/0 and 1/∞ the factor is not a number: bounded, it leaves r as it is
            r = self.arithmetic("mul", r, self.operation("min", (factor(r), self.number(1.5))))
        return r

    def reciprocal(self, a: str) -> str:
        """1/a"""
        if not self.processor.approximates:
            return self.line(f"fdiv {self.vector} {self.number(1.0)}, {a}")
        two = self.number(2.0)
        return self.refined(
            self.approximation("rcp14", a), lambda r: self.multiply_add(self.negative(a), r, two)
        )

    def inverse_root(self, a: str) -> str:
        """1/√a"""
        if not self.processor.approximates:
            return self.reciprocal(self.call("sqrt", a))
        return self._newton_root(self.approximation("rsqrt14", a), a, 2)

    def root(self, a: str) -> str:
        """√a"""
        if not self.processor.approximates:
            return self.call("sqrt", a)
        zero = self.compare("oeq", a, self.number(0.0))
        return self.select(zero, a, self.arithmetic("mul", a, self.inverse_root(a)))

    def inverse_fourth_root(self, a: str) -> str:
        """a^(−1/4); a large number at 0"""
        if not self.processor.approximates:
            return self.reciprocal(self.call("sqrt", self.call("sqrt", a)))
        zero = self.compare("oeq", a, self.number(0.0))
        a = self.select(zero, self.number(float(np.finfo(self.dtype).tiny)), a)
        r = self.approximation("rsqrt14", a)  # times its own inverse root, a^(1/4), it is a^(−1/4)
        return self._newton_root(self.arithmetic("mul", r, self.approximation("rsqrt14", r)), a, 4)

    def _newton_root(self, r: str, a: str, n: int) -> str:
        """a^(−1/n) from r, which is near it: the factor is (1 + 1/n) − a rⁿ/n."""
        constant, scaled = self.number(1.0 + 1.0 / n), self.arithmetic("mul", self.number(1.0 / n), a)

        def factor(r):
            square = self.arithmetic("mul", r, r)
            power = square if n == 2 else self.arithmetic("mul", square, square)
            return self.multiply_add(self.negative(scaled), power, constant)

        return self.refined(r, factor)

    def power_of_two(self, n: str) -> str:
        """2ⁿ for a whole n, put together from its bits."""
        k = self.line(f"fptosi {self.vector} {n} to {self.whole}")
        k = self.line(f"add {self.whole} {k}, {self.spread(f'{self.integer} {self.bias}')}")
        k = self.line(f"shl {self.whole} {k}, {self.spread(f'{self.integer} {self.mantissa}')}")
        return self.line(f"bitcast {self.whole} {k} to {self.vector}")

    def exponent(self, a: str) -> str:
        """The whole k for which a/2ᵏ lies between √½ and √2."""
        k = self.line(f"bitcast {self.vector} {a} to {self.whole}")
        k = self.line(f"sub {self.whole} {k}, {self.spread(f'{self.integer} {self.half}')}")
        k = self.line(f"ashr {self.whole} {k}, {self.spread(f'{self.integer} {self.mantissa}')}")
        return self.line(f"sitofp {self.whole} {k} to {self.vector}")

    def operation(self, op: str, a: Sequence[str]) -> str:
        """Any operation of a `Program`."""
        if op in _ARITHMETIC:
            return self.arithmetic(op, *a)
        if op in _COMPARE:
            return self.compare(_COMPARE[op], *a)
        if op in ("max", "min"):
            return self.select(self.compare("ogt" if op == "max" else "olt", *a), *a)
        if op == "neg":
            return self.negative(a[0])
        if op == "abs":
            return self.call("fabs", a[0])
        if op == "not":
            return self.line(f"xor {self.mask} {a[0]}, {self.truth(True)}")
        if op == "and":
            return self.line(f"and {self.mask} {a[0]}, {a[1]}")
        return {
            "select": self.select, "reciprocal": self.reciprocal, "sqrt": self.root, "rsqrt": self.inverse_root,
            "inverse_root4": self.inverse_fourth_root, "power_of_two": self.power_of_two, "exponent": self.exponent,
        }[op](*a)  # fmt: skip
