"""LLVM assembly of the operations of a scalar program; each value is a vector register with one lane per element."""

import dataclasses
import struct
from collections.abc import Callable, Sequence

import numpy as np


@dataclasses.dataclass(frozen=True)
class Processor:
    """The vector instructions that code is generated for.

    Attributes:
        vector_bytes: size of a vector register [bytes].
        has_approximations: whether the AVX-512 approximations of 1/x and 1/√x exist.
        vectors: vectors of lanes that are interleaved in one block. One vector alone waits for its own results; the
            values of more than two no longer fit the first-level cache.
    """

    vector_bytes: int
    has_approximations: bool
    vectors: int = 2

    @classmethod
    def from_features(cls, features: dict[str, bool]) -> "Processor":
        """The processor with these features, by LLVM's names of them."""
        if features.get("avx512f") and features.get("avx512dq"):
            return cls(64, True)
        return cls(32 if features.get("avx") else 16, False)

    def lanes(self, dtype) -> int:
        """Number of lanes in one block."""
        return self.vectors * self.vector_bytes // np.dtype(dtype).itemsize


_BINARY_INSTRUCTIONS = {"add": "fadd", "sub": "fsub", "mul": "fmul"}
_COMPARISON_PREDICATES = {"gt": "ogt", "ge": "oge", "eq": "oeq", "ne": "une"}
# LLVM type, integer type of the same size, bits of the mantissa, bias of the exponent, bit pattern of √½
_FORMATS = {
    np.float32: ("float", "i32", 23, 127, 0x3F3504F3),
    np.float64: ("double", "i64", 52, 1023, 0x3FE6A09E667F3BCD),
}


class VectorCode:
    """Appends one line of assembly for each operation; the methods return the name of the result."""

    def __init__(self, dtype, processor: Processor):
        self.dtype, self.processor = np.dtype(dtype), processor
        self.scalar, self.integer, self.mantissa_bits, self.exponent_bias, self.root_half_bits = _FORMATS[dtype]
        self.width = processor.vector_bytes // np.dtype(dtype).itemsize
        self.vector, self.mask = f"<{self.width} x {self.scalar}>", f"<{self.width} x i1>"
        self.integer_vector = f"<{self.width} x {self.integer}>"
        self._align = f"align {np.dtype(dtype).itemsize}"
        self._suffix = f"v{self.width}f{8 * np.dtype(dtype).itemsize}"
        self._lines: list[str] = []
        self._declarations: dict[str, None] = {}
        self._count = 0

    def take_lines(self) -> list[str]:
        """The lines appended since the last call of this method."""
        lines, self._lines = self._lines, []
        return lines

    def declarations(self) -> list[str]:
        """The declarations of all called functions."""
        return list(self._declarations)

    def append(self, text: str) -> None:
        """Append an instruction without a result."""
        self._lines.append(text)

    def assign(self, text: str) -> str:
        """Append the assignment of an instruction, given as text, to a new register."""
        self._count += 1
        self._lines.append(f"%t{self._count} = {text}")
        return f"%t{self._count}"

    def number(self, value: float) -> str:
        """A constant number in all lanes."""
        bits = struct.unpack("<Q", struct.pack("<d", value))[0]
        return self.constant(f"{self.scalar} 0x{bits:016X}")

    def boolean(self, value: bool) -> str:
        """A constant boolean in all lanes."""
        return self.constant(f"i1 {str(value).lower()}")

    def constant(self, text: str) -> str:
        """A typed LLVM constant in all lanes."""
        return f"<{', '.join([text] * self.width)}>"

    def splat(self, scalar: str) -> str:
        """A scalar register copied to all lanes."""
        first = self.assign(f"insertelement {self.vector} poison, {self.scalar} {scalar}, i64 0")
        zeros = f"<{self.width} x i32> zeroinitializer"
        return self.assign(f"shufflevector {self.vector} {first}, {self.vector} poison, {zeros}")

    def load(self, address: str) -> str:
        """A vector from memory."""
        return self.assign(f"load {self.vector}, ptr {address}, {self._align}")

    def load_scalar(self, address: str) -> str:
        """A scalar from memory."""
        return self.assign(f"load {self.scalar}, ptr {address}, {self._align}")

    def store(self, value: str, address: str) -> None:
        """Write a vector to memory."""
        self._lines.append(f"store {self.vector} {value}, ptr {address}, {self._align}")

    def arithmetic(self, op: str, a: str, b: str) -> str:
        """a op b, for op `add`, `sub` or `mul`."""
        return self.assign(f"{_BINARY_INSTRUCTIONS[op]} {self.vector} {a}, {b}")

    def multiply_add(self, a: str, b: str, c: str) -> str:
        """a · b + c, contracted to a fused multiply-add where the processor has one."""
        return self.call("fmuladd", a, b, c)

    def neg(self, a: str) -> str:
        """−a."""
        return self.assign(f"fneg {self.vector} {a}")

    def compare(self, predicate: str, a: str, b: str) -> str:
        """The booleans a `predicate` b; the predicates are those of LLVM's `fcmp`."""
        return self.assign(f"fcmp {predicate} {self.vector} {a}, {b}")

    def select(self, condition: str, if_true: str, if_false: str) -> str:
        """`if_true` where `condition` holds, else `if_false`."""
        return self.assign(f"select {self.mask} {condition}, {self.vector} {if_true}, {self.vector} {if_false}")

    def call(self, name: str, *a: str) -> str:
        """The result of an LLVM intrinsic."""
        function = f"{self.vector} @llvm.{name}.{self._suffix}"
        self._declarations[f"declare {function}({', '.join([self.vector] * len(a))})"] = None
        return self.assign(f"call {function}({', '.join(f'{self.vector} {x}' for x in a)})")

    def approximation(self, name: str, a: str) -> str:
        """1/a (`rcp14`) or 1/√a (`rsqrt14`) with a relative error below 2⁻¹⁴."""
        kind = "ps" if self.scalar == "float" else "pd"
        function, mask = f"{self.vector} @llvm.x86.avx512.{name}.{kind}.512", f"i{self.width}"
        self._declarations[f"declare {function}({self.vector}, {self.vector}, {mask})"] = None
        return self.assign(f"call {function}({self.vector} {a}, {self.vector} zeroinitializer, {mask} -1)")

    def newton(self, r: str, factor: Callable[[str], str]) -> str:
        """Newton's iteration r ← r · factor(r) from an approximation r, as often as the precision needs."""
        for _ in range(1 if self.scalar == "float" else 2):
            # at 1/0 and 1/∞ the factor is not a number: the minimum then keeps r at infinity or zero
            r = self.arithmetic("mul", r, self.operation("min", (factor(r), self.number(1.5))))
        return r

    def reciprocal(self, a: str) -> str:
        """1/a."""
        if not self.processor.has_approximations:
            return self.assign(f"fdiv {self.vector} {self.number(1.0)}, {a}")
        two = self.number(2.0)
        return self.newton(
            self.approximation("rcp14", a), lambda r: self.multiply_add(self.neg(a), r, two)
        )

    def inverse_root(self, a: str) -> str:
        """1/√a."""
        if not self.processor.has_approximations:
            return self.reciprocal(self.call("sqrt", a))
        return self._newton_root(self.approximation("rsqrt14", a), a, 2)

    def root(self, a: str) -> str:
        """√a."""
        if not self.processor.has_approximations:
            return self.call("sqrt", a)
        zero = self.compare("oeq", a, self.number(0.0))
        return self.select(zero, a, self.arithmetic("mul", a, self.inverse_root(a)))

    def inverse_fourth_root(self, a: str) -> str:
        """a^(−1/4); at 0 a large finite number by approximations, infinity by exact division."""
        if not self.processor.has_approximations:
            return self.reciprocal(self.call("sqrt", self.call("sqrt", a)))
        zero = self.compare("oeq", a, self.number(0.0))
        a = self.select(zero, self.number(float(np.finfo(self.dtype).tiny)), a)
        r = self.approximation("rsqrt14", a)  # r · 1/√r = a^(−1/2) · a^(1/4)
        return self._newton_root(self.arithmetic("mul", r, self.approximation("rsqrt14", r)), a, 4)

    def _newton_root(self, r: str, a: str, n: int) -> str:
        """a^(−1/n), n = 2 or 4, from its approximation r by Newton's iteration with the factor (1 + 1/n) − a rⁿ/n."""
        constant, scaled = self.number(1.0 + 1.0 / n), self.arithmetic("mul", self.number(1.0 / n), a)

        def factor(r):
            square = self.arithmetic("mul", r, r)
            power = square if n == 2 else self.arithmetic("mul", square, square)
            return self.multiply_add(self.neg(scaled), power, constant)

        return self.newton(r, factor)

    def power_of_two(self, n: str) -> str:
        """2ⁿ for an integer n, by setting the bits of the exponent."""
        k = self.assign(f"fptosi {self.vector} {n} to {self.integer_vector}")
        k = self.assign(f"add {self.integer_vector} {k}, {self.constant(f'{self.integer} {self.exponent_bias}')}")
        k = self.assign(f"shl {self.integer_vector} {k}, {self.constant(f'{self.integer} {self.mantissa_bits}')}")
        return self.assign(f"bitcast {self.integer_vector} {k} to {self.vector}")

    def exponent(self, a: str) -> str:
        """The integer k, as a number, for which a/2ᵏ lies between √½ and √2; a is a positive normal number."""
        k = self.assign(f"bitcast {self.vector} {a} to {self.integer_vector}")
        k = self.assign(f"sub {self.integer_vector} {k}, {self.constant(f'{self.integer} {self.root_half_bits}')}")
        k = self.assign(f"ashr {self.integer_vector} {k}, {self.constant(f'{self.integer} {self.mantissa_bits}')}")
        return self.assign(f"sitofp {self.integer_vector} {k} to {self.vector}")

    def operation(self, op: str, a: Sequence[str]) -> str:
        """The operation `op` of a `Program`, with the registers `a` as operands."""
        if op in _BINARY_INSTRUCTIONS:
            return self.arithmetic(op, *a)
        if op in _COMPARISON_PREDICATES:
            return self.compare(_COMPARISON_PREDICATES[op], *a)
        if op in ("max", "min"):
            return self.select(self.compare("ogt" if op == "max" else "olt", *a), *a)
        if op == "neg":
            return self.neg(a[0])
        if op == "abs":
            return self.call("fabs", a[0])
        if op == "not":
            return self.assign(f"xor {self.mask} {a[0]}, {self.boolean(True)}")
        if op == "and":
            return self.assign(f"and {self.mask} {a[0]}, {a[1]}")
        return {
            "select": self.select, "reciprocal": self.reciprocal, "sqrt": self.root, "rsqrt": self.inverse_root,
            "inverse_root4": self.inverse_fourth_root, "power_of_two": self.power_of_two, "exponent": self.exponent,
        }[op](*a)  # fmt: skip
